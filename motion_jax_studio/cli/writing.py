"""Flags of the files that commands write, and the files."""
import argparse
import pathlib
import re
import shlex

from motion_jax.utils import progress, timing
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import FRAME_RATES, real
from motion_jax_studio.cli.reading import value_of

_BVH_UNITS = {"cm": "centimetres", "m": "metres"}
_FILMS = (".mp4", ".gif")
_PICTURES = (*_FILMS, ".png", ".jpg", ".html")
_RIGS = (".bvh", ".glb", ".usda", ".fbx")
_CHARACTERS = (".glb", ".vrm")
_NAMED = (".glb", ".vrma", ".usda", ".fbx")  # files whose animation has a name


class Files(argparse.Action):
  """Output files: repeated flags add up, as if separated by commas."""

  def __call__(self, parser, namespace, values, option_string=None):
    before = getattr(namespace, self.dest)
    setattr(namespace, self.dest, values if before is self.default else f"{before},{values}")


def add_out(parser, default, files):
  """The flag --out of a command that writes motions; files: an example of several."""
  parser.add_argument("--out", default=default, action=Files,
                      help="output files: .npz .npy .bvh .glb .vrma .usda .fbx .mp4 .gif .html .png ..., separated by "
                           f"commas, such as {files}")


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
  parser.add_argument("--bvh-unit", choices=tuple(_BVH_UNITS), default="cm",
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


def add_film(parser, what):
  """The flags of films; what: the files that --trim applies to."""
  film = parser.add_argument_group("films (.mp4, .gif)")
  film.add_argument("--size", metavar="WxH", type=_size, help="size in pixels, width x height (960x540; .gif: 640x360)")
  film.add_argument("--camera", default="auto", help="camera: front, side, top, three-quarter, follow (moves with the "
                    "body), fixed (shows the whole path) or auto (default)")
  film.add_argument("--background", metavar="COLOR", help="background colour: white, black, '#203040' ... (pale grey)")
  film.add_argument("--film-fps", type=real(1, 240), metavar="N",
                    help="frame rate of the film, such as 24, 30 or 60 (default: the motion's); frames are "
                    "interpolated")
  parser.add_argument("--trim", metavar="A:B", help=f"show only this span, {what}: seconds (1.5s:3s), shares "
                      "(25%%:0.5) or frames (30:60); an empty side means that end")


def _size(text):
  width, cross, height = text.lower().partition("x")
  if not (cross and width.isdecimal() and height.isdecimal()):
    raise argparse.ArgumentTypeError(f"got {text!r}, expected WIDTHxHEIGHT in pixels, such as 720x720")
  return int(width), int(height)


# Values of flags that a command does not have.
_FLAGS = dict.fromkeys(("character", "character_mapping", "name", "rig", "out_fps", "pelvis_offset", "trim", "size",
                        "camera", "background", "film_fps")) | dict(
    exact_joints=False, replace_animations=False, t_pose=False, bvh_unit="cm")


class Output:
  """The files of a command: `paths`, checked before the slow part, and the options with which motions are written.

  args: parsed flags, those of `add_rig` and `add_film` where the command has them. out: instead of --out. trims_all:
  --trim applies to all files, not only to films and pictures.
  """

  def __init__(self, args, out=None, trims_all=False):
    with progress.part("starting"):
      from motion_jax.export import check_output
    self._flags, self._trims_all = argparse.Namespace(**_FLAGS | vars(args)), trims_all
    self._film_options = _checked_film(self._flags)
    paths = (out or args.out).split(",")
    if self._flags.rig is not None:
      from motion_jax.rigs.rig import get_rig
      get_rig(self._flags.rig)
    if self._flags.character is not None:
      _print_character(self._flags, paths)
    self.paths = [check_output(path) for path in paths]

  def write(self, clips, colors=None, constraints=()):
    """Writes clips to each of the files, and prints their names. For pictures: colors (T, 3) of the body, and the
    constraints to draw."""
    from motion_jax import export
    spans = [self._span(clip) for clip in clips]
    trimmed = clips if self._flags.trim is None else [
        clip.cut(span.start, span.stop) for clip, span in zip(clips, spans)]
    if constraints:
      from motion_jax.export.scene import drawn_constraints
    with timing.part("files"), progress.part("writing files"):
      written = []
      for path in self.paths:
        is_picture = pathlib.Path(path).suffix.lower() in _PICTURES
        options = self._options(path)
        if is_picture and colors is not None:
          options["colors"] = colors[spans[0]]
        if is_picture and constraints:
          options |= drawn_constraints(constraints, clips, spans, path)
        written += export.save(trimmed if is_picture or self._trims_all else clips, path, **options)
    self._print_rig_error(trimmed if self._trims_all else clips)
    print_files(written)

  def _options(self, path):
    """The options of `export.save` for a file of this format."""
    flags, kind = self._flags, pathlib.Path(path).suffix.lower()
    options = dict(self._film_options) if kind in _FILMS else {}
    if kind not in _PICTURES and flags.out_fps is not None:
      options["fps"] = flags.out_fps
    if kind in _CHARACTERS and flags.character is not None:
      return options | {"file": flags.character, "mapping": flags.character_mapping, "t_pose": flags.t_pose,
                        "name": flags.name, "replace": flags.replace_animations}
    if kind in _NAMED:
      options["name"] = flags.name
    if kind in _RIGS:
      options |= {"exact": flags.exact_joints, "rig": flags.rig, "t_pose": flags.t_pose}
    if path.lower().endswith(".amass.npz") and flags.pelvis_offset:
      options["pelvis_offset"] = flags.pelvis_offset
    return options | ({"unit": _BVH_UNITS[flags.bvh_unit]} if kind == ".bvh" else {})

  def _span(self, clip):
    """The frames of --trim, or all frames."""
    if self._flags.trim is None:
      return slice(0, clip.num_frames)
    from motion_jax.models.shared.spans import spans_of
    with value_of("--trim", self._flags.trim):
      first, past = spans_of([self._flags.trim], clip.num_frames, clip.fps)[0]
    if not 0 <= first < past:
      raise InputError(f"got --trim {self._flags.trim} for a motion of {clip.seconds:.1f} s, expected A:B with A "
                       "before B and within it, such as 0.5s:2s")
    return slice(first, past)

  def _print_rig_error(self, clips):
    """Prints the joint error of .bvh and .glb files if it is half a millimetre or more."""
    from motion_jax import export
    kinds = {kind for path in self.paths if (kind := pathlib.Path(path).suffix.lower()) in _RIGS}
    kinds -= set(_CHARACTERS) if self._flags.character is not None else set()
    if not kinds or self._flags.exact_joints:
      return
    errors = [export.rig_error(clip) for clip in clips]
    mean, (_, worst, joint) = sum(error for error, *_ in errors) / len(errors), max(errors, key=lambda row: row[1])
    if worst >= 0.5:
      print(f"{' and '.join(sorted(kinds))}: the skeleton only rotates; joints are {mean:.1f} mm from the motion on "
            f"average, {worst:.0f} mm at most ({joint}); --exact-joints keeps them in place")


def _print_character(flags, paths):
  """Reads the file of --character before the slow part."""
  if flags.rig is not None:
    raise InputError("got --rig and --character; a character keeps its own bones, give one of them")
  if not any(path.lower().endswith(_CHARACTERS) for path in paths):
    raise InputError(f"got --character, and no file of --out that ends in {' or '.join(_CHARACTERS)}; name one, such "
                     "as --out animated.glb")
  from motion_jax.export import check_character
  print(f"{flags.character}: {check_character(flags.character, flags.character_mapping).about}")


def _checked_film(flags):
  """The options of `export.save` for films."""
  options = {name: value for name, value in (("camera", flags.camera), ("size", flags.size), (
      "background", flags.background), ("fps", flags.film_fps)) if value is not None}
  if options:
    from motion_jax.export.video import check_film
  for name, value in options.items():
    given = "x".join(map(str, value)) if name == "size" else value
    with value_of("--film-fps" if name == "fps" else f"--{name}", given):
      check_film(**{name: value})
  return options


def print_files(written):
  print("wrote " + ", ".join(map(str, written)))
  first = str(written[0])
  if first.endswith(".html"):
    print(f"open {first} in a browser; no network is needed")
  elif first.endswith((".npz", ".npy", ".bvh")):
    print(f"see it: motion-jax render {shlex.quote(first)}")
