"""motion-jax render and blend: motion files become other files."""
import pathlib

from motion_jax.utils.numerals import real
from motion_jax_studio.cli import reading, writing


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  render = commands.add_parser("render", help="convert a motion file to a film, a picture, a page or another format")
  render.add_argument("file", help=f"motion file: {reading.MOTION_HELP}")
  render.set_defaults(run=_render)
  blend = commands.add_parser("blend", help="blend from one motion into another")
  blend.add_argument("first", help=f"first motion: {reading.MOTION_HELP}")
  blend.add_argument("second", help="second motion; it is moved and rotated on the ground to follow the first")
  blend.add_argument("--seconds", type=real(0.1, 10, "seconds"), default=1.0, help="length of the transition (1)")
  blend.set_defaults(run=_blend)
  for parser, out, files in ((render, None, "walk.mp4,walk.glb (FILE with .html)"),
                             (blend, "blended.html", "both.mp4,both.bvh")):
    writing.add_out(parser, out, files)
    reading.add_reading(parser)
    writing.add_rig(parser)
    writing.add_film(parser, "in every output format")


def _render(args):
  output = writing.Output(args, args.out or str(pathlib.Path(args.file).with_suffix(".html")), trims_all=True)
  clip = reading.read_motion(args.file, args)
  print(f"{args.file}: {clip.num_frames} frames, {clip.seconds:.1f} s at {clip.fps:g} frames a second")
  output.write([clip])


def _blend(args):
  from motion_jax_studio.blending import blended
  output = writing.Output(args, trims_all=True)
  first, second = (reading.read_motion(path, args) for path in (args.first, args.second))
  clip, border = blended(first, second, args.seconds)
  print(f"{args.first} blends into {args.second} at {border:.2f} s, within {args.seconds:g} s")
  output.write([clip.replace(source=f"{args.first}, then {args.second}")])
