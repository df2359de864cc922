"""Flags that name a training config and its data."""
from motion_jax.utils.errors import InputError


def add_config(parser):
  """The flags that name a training config and its data, and --config.FIELD=VALUE."""
  parser.add_argument("--config", required=True, metavar="NAME[:SIZE]", help="config, such as "
                      "cmdm_denoiser:tiny: a shipped one, or a Python file with get_config(size)")
  parser.add_argument("--data", nargs="+", metavar="DIR", help="data folders, several are combined; short for "
                      "--config.data.folder")
  parser.set_defaults(overrides=[])


def config_of(args):
  """The config that the flags of `add_config` name."""
  from motion_jax.utils import config_files
  from motion_jax_studio.cli import overrides
  config = config_files.load(args.config)
  if args.data and "passes" in config:
    raise InputError(f"got --data with the recipe {args.config!r}, whose passes name their archives; give the "
                     "folder that holds these by --config.archives=FOLDER")
  if args.data:
    if overrides.names_any(args.overrides, "data.folder", "data.folders"):
      raise InputError("got --data and --config.data.folder; give one of them")
    with config.unlocked():
      single = len(args.data) == 1
      config.data.update(folder=args.data[0] if single else "", folders=() if single else tuple(args.data))
  return overrides.applied(args.overrides, config)
