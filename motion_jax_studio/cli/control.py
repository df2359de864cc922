"""Flags of constraints: files, paths, poses, targets, kept parts, loops (docs/control.md)."""
import re
from typing import NamedTuple

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import real, shortened
from motion_jax_studio.cli.parser import typed
from motion_jax_studio.cli.reading import add_mapping

_METRES = real(-1e4, 1e4, "metres")
_SECONDS = real(0, 3600, "seconds")
_AT = re.compile(r"(?P<at>[0-9.]+)(?P<seconds>s?):(?P<file>.+?)(@(?P<frame>[0-9]+))?")
_TARGET = re.compile(r"(?P<joint>\w+)@(?P<at>[0-9.]+)s?:(?P<place>[^:]+?)(?P<root>:root)?")


class _Keyframe(NamedTuple):
  """The pose of a frame of a motion file, at a time in frames or seconds."""
  at: float
  in_seconds: bool
  file: str
  frame: int


def add_to(parser):
  """Adds the flags of constraints to a command that generates motion."""
  group = parser.add_argument_group("constraints (docs/control.md)")
  group.add_argument("--control", metavar="FILE.json", help="constraint file, in our format or Kimodo's")
  group.add_argument("--path", metavar="\"X,Z X,Z ...\"", type=typed(_path), help="path of the pelvis: a smooth curve "
                     "through points in metres, at constant speed, or with times in seconds as in \"0,0:0 2,0:1.5 "
                     "2,3:4\"")
  group.add_argument("--keyframe", action="append", metavar="AT:FILE", default=[], type=typed(_keyframe),
                     help="pose keyframe: the pose of a motion file (first frame, or FILE@FRAME) at frame AT, or at a "
                     "time as in 3s:pose.npz; repeatable")
  group.add_argument("--target", action="append", metavar="JOINT@S:X,Y,Z", default=[], type=typed(_target),
                     help="target position of a joint, such as left_hand, at S seconds; with the suffix :root relative "
                     "to the body: left, up, forward; repeatable")
  group.add_argument("--keep-parts", metavar="PARTS:FILE", type=typed(_parts_of_file), help="keep body parts (legs, "
                     "torso, left_arm, right_arm, head, with commas) of this motion file; the prompt controls the "
                     "others")
  add_mapping(group)
  group.add_argument("--loop", action="store_true", help="make a cycle: the last frame, at the clip's length, is the "
                     "first pose again (docs/game-engines.md)")
  group.add_argument("--in-place", action="store_true", help="keep the root over x = z = 0, as on a treadmill; its "
                     "speed is printed")


def constraints_of(args, model):
  """The constraints of the flags of `add_to`, at the model's frame rate."""
  from motion_jax.control import constraints as kinds
  joints_of = lambda path, frame=None: _joints(path, frame, model, args.mapping)
  constraints = read_file(args, model) if args.control else []
  constraints += [args.path] if args.path else []
  constraints += [kinds.Keyframe(joints_of(pose.file, pose.frame), pose.at if pose.in_seconds else pose.at / model.fps)
                  for pose in args.keyframe]
  constraints += args.target
  if args.keep_parts:
    parts, path = args.keep_parts
    constraints.append(kinds.KeepParts(joints_of(path), parts, model.fps))
  return constraints + [kinds.Loop()] * args.loop + [kinds.InPlace()] * args.in_place


def read_file(args, model):
  """The constraints of the file of --control."""
  from motion_jax.control import files
  return files.load(args.control, lambda path, frame=None: _joints(path, frame, model, args.mapping))


def parts_of(text):
  """Names of body parts, separated by commas."""
  return tuple(part.strip() for part in text.split(","))


def _parts_of_file(text):
  parts, colon, path = text.partition(":")
  if not colon:
    raise InputError(f"got {shortened(text)}, expected PARTS:FILE, such as legs,torso:walk.npz")
  return parts_of(parts), path


def _keyframe(text):
  given = _AT.fullmatch(text)
  if not given:
    raise InputError(f"got {shortened(text)}, expected AT:FILE, such as 60:pose.npz or 3s:pose.npz@12")
  at = real(0, 3600, "seconds" if given["seconds"] else "frames")(given["at"])
  return _Keyframe(at, bool(given["seconds"]), given["file"], int(given["frame"] or 0))


def _target(text):
  from motion_jax.control.constraints import EffectorTarget
  given = _TARGET.fullmatch(text)
  place = [_METRES(x) for x in given["place"].split(",")] if given else ()
  if len(place) != 3:
    raise InputError(f"got {shortened(text)}, expected JOINT@SECONDS:X,Y,Z, such as left_hand@2.5:0.3,1.4,0.2")
  return EffectorTarget(given["joint"], [_SECONDS(given["at"])], [place], "root" if given["root"] else "world")


def _path(text):
  from motion_jax.control.constraints import RootPath
  points, times = [], []
  for word in text.split():
    place, colon, at = word.partition(":")
    points.append([_METRES(x) for x in place.split(",")])
    times += [_SECONDS(at)] if colon else []
    if len(points[-1]) not in (2, 3) or len(points[-1]) != len(points[0]):
      raise InputError(f"got {shortened(word)!r}, expected X,Z (or X,Y,Z) of each point, in metres")
  if not points or times and len(times) != len(points):
    raise InputError(f"got {shortened(text)!r}, expected points such as \"0,0 2,0 2,3\", with seconds after all of "
                     "them or none")
  return RootPath(points, times or None)


def _joints(path, frame, model, mapping):
  """Joints of a frame of a file (22, 3), or of all frames (T, 22, 3) for None, at the model's rate on its body."""
  from motion_jax import export
  from motion_jax.models.shared.known_motion import on_our_body
  clip = export.load(path, mapping=mapping)
  joints = on_our_body(clip, model.fps, model.stats.layout.skeleton)
  if frame is None:
    return joints
  at = round(frame * model.fps / clip.fps)
  if at >= len(joints):
    raise InputError(f"got frame {frame} of {path}, which has {clip.num_frames}")
  return joints[at]
