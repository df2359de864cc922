"""motion-jax models and rigs: lists of models and of rigs, and the nearest rig of a file."""
import pathlib
import shlex

from motion_jax.utils.errors import InputError
from motion_jax_studio.cli.reading import MOTION_HELP

_MAKES = "text to motion"


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  models = commands.add_parser("models", help="list the shipped models with size, licence and speed; for a model, its "
                               "abilities and sampling defaults")
  models.add_argument("model", nargs="*", help="run folders or shipped models")
  models.set_defaults(run=_models)

  rigs = commands.add_parser("rigs", help="list the rigs that --rig can write; for a file, the nearest rig and a joint "
                             "mapping to fill in")
  rigs.add_argument("file", nargs="?", help=f"motion file whose joint names to look up: {MOTION_HELP}")
  rigs.add_argument("--write-mapping", metavar="FILE.json", help="write {our joint: the joint of the file} to correct "
                    "and fill in, for --mapping of the commands that read motion")
  rigs.set_defaults(run=_rigs)


def _rigs(args):
  from motion_jax.rigs.rig import all_rigs
  if args.file:
    return _nearest_rig(args)
  if args.write_mapping:
    raise InputError("got --write-mapping without a file, expected motion-jax rigs FILE --write-mapping FILE.json")
  print("--rig NAME writes .bvh and .glb files with the joint names, tree and rest pose of another program:")
  for name, rig in all_rigs().items():
    also = f"; also {', '.join(rig.aliases)}" if rig.aliases else ""
    pose = {"T": "T-pose", "A": "A-pose"}[rig.rest]
    print(f"  {name:<18} {rig.title}: {len(rig.names)} joints, {pose}, from {rig.names[0]}{also}")
  print("Files with these joint names are read without a mapping, and so are many others; an error message says what a "
        "file lacks.")


def _nearest_rig(args):
  import json

  from motion_jax.export.files import named_joints
  from motion_jax.rigs.joint_maps import mapping_template
  from motion_jax.utils.atomic import atomic_path
  path = pathlib.Path(args.file)
  names, positions, parents = named_joints(path)
  mapping, label = mapping_template(names, positions[:1], parents)
  print(f"{path}: {len(names)} joints; nearest: {label or 'no known rig'}")
  for ours, theirs in mapping.items():
    print(f"  {ours:<16} {theirs or '(computed from other joints, or missing)'}")
  if args.write_mapping:
    with atomic_path(args.write_mapping) as temporary:
      temporary.write_text(json.dumps(mapping, indent=1) + "\n")
    print(f"wrote {args.write_mapping}; correct and fill it in, then: motion-jax render "
          f"{shlex.quote(str(path))} --mapping {shlex.quote(args.write_mapping)}")


def _abilities(name):
  import motion_jax as mj
  from motion_jax.models.abilities import ABILITIES
  model = mj.load(name)
  print(f"{model.folder.name}: {model.config.stage}, {model.num_params / 1e6:.1f} M parameters, "
        f"{model.stats.layout.name} features, {model.fps:g} frames a second, up to {model.max_seconds:.4g} s")
  for word, about in ABILITIES.items():
    if model.can(word):
      print(f"  {word:<16} {about}")
  if model.takes_control:
    print(f"  {'control':<16} its network is guided by constraints")
  print("sampled with:")
  for option, value in model.sampling().about().items():
    print(f"  --{option.replace('_', '-'):<21} {value}")


def _models(args):
  import textwrap

  if args.model:
    for name in args.model:
      _abilities(name)
    return

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
