"""motion-jax render and models: what there is to see."""
import pathlib

from motion_jax.cli.shared import (
    FILMS,
    add_bvh_unit,
    add_film,
    add_reading,
    bvh_options,
    film_options,
    read_motion,
    tell_files,
    trimmed,
)


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  render = commands.add_parser("render", help="show any npz, npy, bvh or amc file as mp4, gif, html, png, glb or bvh")
  render.add_argument("file", help="an .npz, .npy, .bvh or .amc file")
  render.add_argument("--out", help="file to write (FILE with .html)")
  add_reading(render)
  add_bvh_unit(render)
  add_film(render, "in whatever kind of file")
  render.set_defaults(run=_render)

  models = commands.add_parser("models", help="the models that ship")
  models.set_defaults(run=_models)


def _render(args):
  from motion_jax import export
  out = args.out or str(pathlib.Path(args.file).with_suffix(".html"))
  export.check_output(out)
  film = film_options(args) if out.lower().endswith(FILMS) else {}
  clip = read_motion(args.file, args)
  print(f"{args.file}: {clip.num_frames} frames, {clip.seconds:.1f} s at {clip.fps:g} frames a second")
  clip = trimmed(args, clip)
  tell_files(export.save(clip, out, **film, **bvh_options(args, out)))


def _models(args):
  from motion_jax.runs import PRETRAINED, shipped_names
  for name in shipped_names():
    print(f"{name}\t{PRETRAINED / name / 'README.md'}")
