"""motion-jax render and models: what there is to see."""
import pathlib

from motion_studio.cli import shared

_MAKES = "text to motion"


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  render = commands.add_parser("render", help="convert a motion file to mp4, gif, html, png, glb or bvh")
  render.add_argument("file", help=f"motion file: {shared.MOTION_HELP}")
  shared.add_out(render, None, "walk.mp4,walk.glb (FILE with .html)")
  shared.add_reading(render)
  shared.add_rig(render)
  shared.add_film(render, "in every output format")
  render.set_defaults(run=_render)

  models = commands.add_parser("models", help="list the shipped models with size, licence and speed")
  models.set_defaults(run=_models)

  rigs = commands.add_parser("rigs", help="list the rigs that motion is written for by --rig")
  rigs.set_defaults(run=_rigs)


def _render(args):
  outputs = shared.outputs_of(args, args.out or str(pathlib.Path(args.file).with_suffix(".html")))
  clip = shared.read_motion(args.file, args)
  print(f"{args.file}: {clip.num_frames} frames, {clip.seconds:.1f} s at {clip.fps:g} frames a second")
  shared.save(args, [shared.trimmed(args, clip)], outputs)


def _rigs(args):
  from motion_jax.motion.rigs import all_rigs
  print("--rig NAME writes .bvh and .glb files with the joint names, tree and rest pose of another program:")
  for name, rig in all_rigs().items():
    also = f"; also {', '.join(rig.aliases)}" if rig.aliases else ""
    pose = {"T": "T-pose", "A": "A-pose"}[rig.rest]
    print(f"  {name:<18} {rig.title}: {len(rig.names)} joints, {pose}, from {rig.names[0]}{also}")
  print("Files with these joint names are read without a mapping, and so are many others; an error message says what a "
        "file lacks.")


def _models(args):
  import textwrap

  from motion_jax import runs
  groups = {}
  for name in sorted(runs.shipped_names(), key=lambda name: name != "cmdm-small"):  # the default is the first
    about = runs.about(name)
    size = f"{runs.num_params(name) / 1e6:.1f} M parameters"
    facts = "; ".join(filter(None, (size, about["licence"], about["speed"])))
    groups.setdefault(about["for"], []).append((name, about["does"], facts))
  for purpose in sorted(groups, key=lambda purpose: purpose != _MAKES):
    print(f"{purpose}:")
    for name, does, facts in groups[purpose]:
      print(f"  {name:<20} {facts}")
      print(textwrap.fill(does, 110, initial_indent=" " * 23, subsequent_indent=" " * 23, break_on_hyphens=False))
  print(f"\n--model takes those of {_MAKES}. Parameters are those of the network and its tokenizer, without the text "
        f"encoder.\nWhat each knows and was trained on: {runs.PRETRAINED}/NAME/README.md")
