"""motion-jax render and models: what there is to see."""
import pathlib

from motion_jax.cli import shared


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  render = commands.add_parser("render", help="show any npz, npy, bvh or amc file as mp4, gif, html, png, glb or bvh")
  render.add_argument("file", help="an .npz, .npy, .bvh or .amc file")
  shared.add_out(render, None, "walk.mp4,walk.glb (FILE with .html)")
  shared.add_reading(render)
  shared.add_rig(render)
  shared.add_film(render, "in whatever kind of file")
  render.set_defaults(run=_render)

  models = commands.add_parser("models", help="the models that ship")
  models.set_defaults(run=_models)


def _render(args):
  outputs = shared.outputs_of(args, args.out or str(pathlib.Path(args.file).with_suffix(".html")))
  clip = shared.read_motion(args.file, args)
  print(f"{args.file}: {clip.num_frames} frames, {clip.seconds:.1f} s at {clip.fps:g} frames a second")
  shared.save(args, [shared.trimmed(args, clip)], outputs)


def _models(args):
  from motion_jax.runs import PRETRAINED, shipped_names
  for name in shipped_names():
    print(f"{name}\t{PRETRAINED / name / 'README.md'}")
