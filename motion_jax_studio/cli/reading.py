"""Flags of the motion files that commands read, and the files."""
import contextlib

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import FRAME_RATES, real, shortened

# What export.load reads; a constant, so that --help starts fast.
MOTION_FILES = (".npz", ".npy", ".bvh", ".amc", ".csv", ".trc", ".c3d", ".glb", ".gltf", ".vrm", ".vrma",
                ".fbx", ".usd", ".usda", ".usdc")
MOTION_HELP = ", ".join(MOTION_FILES[:-1]) + f" or {MOTION_FILES[-1]}"


@contextlib.contextmanager
def value_of(flag, value):
  """Add the flag and its value to errors of the block, for values that are read after the command line is parsed."""
  try:
    yield
  except ValueError as error:
    raise InputError(str(error) if flag in str(error) else f"in {flag} {shortened(str(value))}: {error}") from None


def add_reading(parser):
  """Options of all commands that read a motion file."""
  parser.add_argument("--fps", type=real(*FRAME_RATES), metavar="F",
                      help="frame rate of the file, overrides the one in it (.npy and .amc have none: 20, 120)")
  parser.add_argument("--unit", choices=("auto", "m", "cm", "mm", "in", "ft"), default="auto",
                      help="unit of the joint coordinates; auto detects it from bone lengths")
  parser.add_argument("--up", choices=("x", "y", "z", "-x", "-y", "-z"), metavar="AXIS",
                      help="up axis of the file: x, y, z, or a downward one as in --up=-y (y; for .bvh and .amc it is "
                           "detected)")
  add_mapping(parser)


def add_mapping(parser):
  """The option of all commands that read files with joint names."""
  parser.add_argument("--mapping", metavar="FILE.json", help="joint names of a file that are not recognized: {our "
                      "joint: their joint, or a list to average}, or a rig's name; motion-jax rigs FILE writes one to "
                      "fill in")


def read_motion(path, args):
  """The Clip of a motion file, read as the options of `add_reading` say."""
  from motion_jax import export
  return export.load(path, fps=args.fps, unit=args.unit, up=args.up, mapping=args.mapping)
