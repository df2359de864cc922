"""Flags and functions of several commands."""
import argparse
import contextlib
import pathlib
import re
import shlex
import warnings

from motion_jax.utils import progress
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import FRAME_RATES, real, shortened

BVH_UNITS = {"cm": "centimetres", "m": "metres"}
FILMS = (".mp4", ".gif")
PICTURES = (*FILMS, ".png", ".jpg", ".html")
RIGS = (".bvh", ".glb", ".usda", ".fbx")
CHARACTERS = (".glb", ".vrm")
NAMED = (".glb", ".vrma", ".usda", ".fbx")  # files whose animation has a name
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


class Files(argparse.Action):
  """Output files: repeated flags add up, as if separated by commas."""

  def __call__(self, parser, namespace, values, option_string=None):
    before = getattr(namespace, self.dest)
    setattr(namespace, self.dest, values if before is self.default else f"{before},{values}")


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
  """The option of all commands that read .bvh and .amc files."""
  parser.add_argument("--mapping", metavar="FILE.json", help="joint names of a file that are not recognized: {our "
                      "joint: their joint, or a list to average}, or a rig's name; motion-jax rigs FILE writes one to "
                      "fill in")


def read_motion(path, args):
  """The Clip of a motion file, read as the options say."""
  from motion_jax import export
  return export.load(path, fps=args.fps, unit=args.unit, up=args.up, mapping=args.mapping)


def cache_compiled_code():
  """Keeps traced and compiled functions on disk for the next run."""
  from motion_jax.utils import cache
  cache.keep_in_user_cache()


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


def add_out(parser, default, files):
  """The flag --out of a command that writes motions; files: an example of several."""
  parser.add_argument("--out", default=default, action=Files,
                      help="output files: .npz .npy .bvh .glb .vrma .usda .fbx .mp4 .gif .html .png ..., separated by "
                           f"commas, such as {files}")


def outputs_of(args, out=None):
  """The files of --out, or out, checked before the slow part."""
  with progress.part("starting"):
    from motion_jax.export import check_output
  film_options(args)
  if getattr(args, "rig", None) is not None:
    from motion_jax.rigs.rig import get_rig
    get_rig(args.rig)
  _check_character(args, (out or args.out).split(","))
  return [check_output(part) for part in (out or args.out).split(",")]


def _check_character(args, outputs):
  """Reads the character of --character before the slow part."""
  file = getattr(args, "character", None)
  if file is None:
    return
  if args.rig is not None:
    raise InputError("got --rig and --character; a character keeps its own bones, give one of them")
  if not any(out.lower().endswith(CHARACTERS) for out in outputs):
    raise InputError(f"got --character, and no file of --out that ends in {' or '.join(CHARACTERS)}; name one, such as "
                     "--out animated.glb")
  from motion_jax.export import check_character
  print(f"{file}: {check_character(file, args.character_mapping).about}")


def add_rig(parser):
  """The flags of files with a rig."""
  parser.add_argument("--character", metavar="FILE", help="your own rigged character, .glb, .gltf or .vrm: each .glb "
                      "or .vrm of --out is a copy of it, with the motions added in front of its own animations")
  parser.add_argument("--replace-animations", action="store_true", help="drop the animations that the file of "
                      "--character has")
  parser.add_argument("--name", type=_clip_name, metavar="NAME", help="name of the animation in .glb, .vrma, .usda, "
                      ".fbx and --character (default: the prompt, with _ for spaces)")
  parser.add_argument("--character-mapping", metavar="FILE.json", help="bone names of a character that are not "
                      "recognized: {our joint: its bone}; an error message lists them")
  parser.add_argument("--rig", metavar="NAME", help="joint names, tree and rest pose of another program in .bvh, .glb, "
                      ".usda and .fbx: mixamo, unity, ue5, vrm, rigify ...; motion-jax rigs lists them (default: those "
                      "of HumanML3D)")
  parser.add_argument("--t-pose", action="store_true", help="add a first frame that is a T-pose to .bvh, .glb, .usda, "
                      ".fbx and --character")
  parser.add_argument("--out-fps", type=real(*FRAME_RATES), metavar="N", help="frame rate of the written motion files, "
                      "such as 24, 25, 30, 50, 60 or 120, by interpolation; loops stay loops (default: the motion's)")
  parser.add_argument("--bvh-unit", choices=tuple(BVH_UNITS), default="cm",
                      help="unit of .bvh files: cm (common; in Blender import with scale 0.01) or m")
  parser.add_argument("--pelvis-offset", metavar="X,Y,Z", type=_three, help="for .amass.npz, the rest position of your "
                      "body model's pelvis in metres, which its forward kinematics adds to trans (0,0,0)")
  parser.add_argument("--exact-joints", action="store_true",
                      help="in .bvh, .glb, .usda and .fbx, keep exact joint positions with position channels below the "
                           "root, which some programs misread; default: joints only rotate, and the error is printed")


def _clip_name(text):
  if not re.fullmatch(r"[\w.-]{1,60}", text):
    raise argparse.ArgumentTypeError(f"got {text[:70]!r}, expected up to 60 letters, digits, _, - and ., such as Walk")
  return text


def _three(text):
  numbers = [real(-10, 10, "metres")(part) for part in text.split(",")]
  if len(numbers) != 3:
    raise argparse.ArgumentTypeError(f"got {text!r}, expected three numbers X,Y,Z in metres, such as 0,-0.35,0.01")
  return tuple(numbers)


def save(args, clips, outputs):
  """Writes clips to each of the outputs, and prints the files."""
  from motion_jax import export
  written = [path for out in outputs for path in export.save(clips, out, **file_options(args, out))]
  print_rig_error(args, clips, outputs)
  print_files(written)


def file_options(args, out):
  """The options of `export.save` for a file of this format."""
  kind = pathlib.Path(out).suffix.lower()
  options = film_options(args) if kind in FILMS else {}
  if kind not in PICTURES and args.out_fps is not None:
    options["fps"] = args.out_fps
  if kind in CHARACTERS and args.character is not None:
    return options | {"file": args.character, "mapping": args.character_mapping, "t_pose": args.t_pose,
                    "name": args.name, "replace": args.replace_animations}
  if kind in NAMED:
    options["name"] = args.name
  if kind in RIGS:
    options |= {"exact": args.exact_joints, "rig": args.rig, "t_pose": args.t_pose}
  if out.lower().endswith(".amass.npz") and args.pelvis_offset:
    options["pelvis_offset"] = args.pelvis_offset
  if kind == ".bvh":
    options["unit"] = BVH_UNITS[args.bvh_unit]
  return options


def print_rig_error(args, clips, outputs):
  """Prints the joint error of .bvh and .glb files if it is half a millimetre or more."""
  from motion_jax import export
  kinds = sorted({kind for out in outputs if (kind := pathlib.Path(out).suffix.lower()) in RIGS} - (
      set(CHARACTERS) if args.character is not None else set()))
  if not kinds or args.exact_joints:
    return
  errors = [export.rig_error(clip) for clip in clips]
  mean, (_, worst, joint) = sum(error for error, *_ in errors) / len(errors), max(errors, key=lambda row: row[1])
  if worst < 0.5:
    return
  print(f"{' and '.join(kinds)}: the skeleton only rotates; joints are {mean:.1f} mm from the motion on average, "
        f"{worst:.0f} mm at most ({joint}); --exact-joints keeps them in place")


def add_film(parser, what):
  """The flags of films; what: the files that --trim applies to."""
  film = parser.add_argument_group("films (.mp4, .gif)")
  film.add_argument("--size", metavar="WxH", help="size in pixels, width x height (960x540; .gif: "
                    "640x360)")
  film.add_argument("--camera", default="auto", help="camera: front, side, top, three-quarter, follow (moves with the "
                    "body), fixed (shows the whole path) or auto (default)")
  film.add_argument("--background", metavar="COLOR", help="background colour: white, black, '#203040' ... (pale grey)")
  film.add_argument("--film-fps", type=real(1, 240), metavar="N",
                    help="frame rate of the film, such as 24, 30 or 60 (default: the motion's); frames are "
                    "interpolated")
  parser.add_argument("--trim", metavar="A:B", help=f"show only this span, {what}: seconds (1.5s:3s), shares "
                      "(25%%:0.5) or frames (30:60); an empty side means that end")


def film_options(args):
  """The options of `export.save` for films, checked before the slow part."""
  from motion_jax.export.video import check_film
  if not hasattr(args, "film_fps"):  # a command without these flags
    return {}
  options = {"camera": args.camera}
  if args.size is not None:
    width, cross, height = args.size.lower().partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
      raise InputError(f"got --size {args.size}, expected WIDTHxHEIGHT in pixels, such as 720x720")
    options["size"] = (int(width), int(height))
  if args.background is not None:
    options["background"] = args.background
  if args.film_fps is not None:
    options["fps"] = args.film_fps
  for name, value in options.items():
    flag = "--film-fps" if name == "fps" else f"--{name}"
    with value_of(flag, getattr(args, flag[2:].replace("-", "_"))):
      check_film(**{name: value})
  return options


def span_of(args, clip) -> slice:
  """The frames of --trim, or all frames."""
  if args.trim is None:
    return slice(0, clip.num_frames)
  from motion_jax.models.shared.spans import spans_of
  with value_of("--trim", args.trim):
    first, past = spans_of([args.trim], clip.num_frames, clip.fps)[0]
  if not 0 <= first < past:
    raise InputError(f"got --trim {args.trim} for a motion of {clip.seconds:.1f} s, expected A:B with A before B and "
                     "within it, such as 0.5s:2s")
  return slice(first, past)


def trimmed(args, clip):
  """The part of a clip that --trim names."""
  if args.trim is None:
    return clip
  part = span_of(args, clip)
  return clip.cut(part.start, part.stop)


def print_notes(notes):
  """Give notes as warnings, which the command line prints once each."""
  for note in notes:
    warnings.warn(note, stacklevel=2)


def print_files(written):
  print("wrote " + ", ".join(map(str, written)))
  first = str(written[0])
  if first.endswith(".html"):
    print(f"open {first} in a browser; no network is needed")
  elif first.endswith((".npz", ".npy", ".bvh")):
    print(f"see it: motion-jax render {shlex.quote(first)}")
