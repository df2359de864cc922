"""Flags of constraints: files, paths, poses, targets, kept parts, loops (docs/control.md)."""
import re

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import real, shortened
from motion_jax_studio.cli import generation_flags as flags
from motion_jax_studio.cli import shared

_METRES = real(-1e4, 1e4, "metres")
_AT = re.compile(r"(?P<at>[0-9.]+)(?P<seconds>s?):(?P<file>.+?)(@(?P<frame>[0-9]+))?")
_TARGET = re.compile(r"(?P<joint>\w+)@(?P<at>[0-9.]+)s?:(?P<place>[^:]+?)(?P<root>:root)?")


def add_to(parser):
  """Adds the flags of constraints to a command that generates motion."""
  group = parser.add_argument_group("constraints (docs/control.md)")
  group.add_argument("--control", metavar="FILE.json", help="constraint file, in our format or Kimodo's")
  group.add_argument("--path", metavar="\"X,Z X,Z ...\"", help="path of the pelvis: a smooth curve through points "
                     "in metres, at constant speed, or with times in seconds as in \"0,0:0 2,0:1.5 2,3:4\"")
  group.add_argument("--keyframe", action="append", metavar="AT:FILE", help="pose keyframe: the pose of a motion file "
                     "(first frame, or FILE@FRAME) at frame AT, or at a time as in 3s:pose.npz; repeatable")
  group.add_argument("--target", action="append", metavar="JOINT@S:X,Y,Z", help="target position of a joint, such as "
                     "left_hand, at S seconds; with the suffix :root relative to the body: left, up, forward; "
                     "repeatable")
  group.add_argument("--keep-parts", metavar="PARTS:FILE", help="keep body parts (legs, torso, left_arm, right_arm, "
                     "head, with commas) of this motion file; the prompt controls the others")
  shared.add_mapping(group)
  group.add_argument("--loop", action="store_true", help="make a cycle: the last frame, at the clip's length, is the "
                     "first pose again (docs/game-engines.md)")
  group.add_argument("--in-place", action="store_true", help="keep the root over x = z = 0, as on a treadmill; its "
                     "speed is printed")


def constraints_of(args, model):
  """The constraints of the flags of `add_to`, at the model's frame rate."""
  from motion_jax.control import constraints as kinds
  constraints = read_file(args, model) if args.control else []
  if args.path:
    with shared.value_of("--path", args.path):
      constraints.append(_path(args.path, kinds))
  for text in args.keyframe or ():
    given = _AT.fullmatch(text)
    if not given:
      raise InputError(f"got --keyframe {shortened(text)}, expected AT:FILE, such as 60:pose.npz or 3s:pose.npz@12")
    with shared.value_of("--keyframe", text):
      at = real(0, 3600, "seconds" if given["seconds"] else "frames")(given["at"])
      joints, _ = _joints(given["file"], int(given["frame"] or 0), model, args)
      constraints.append(kinds.Keyframe(joints, at if given["seconds"] else at / model.fps))
  for text in args.target or ():
    given = _TARGET.fullmatch(text)
    with shared.value_of("--target", text):
      place = [_METRES(x) for x in given["place"].split(",")] if given else ()
      if len(place) != 3:
        raise InputError(f"got --target {shortened(text)}, expected JOINT@SECONDS:X,Y,Z, such as "
                         "left_hand@2.5:0.3,1.4,0.2")
      constraints.append(kinds.EffectorTarget(given["joint"], [real(0, 3600, "seconds")(given["at"])], [place],
                                        "root" if given["root"] else "world"))
  if args.keep_parts:
    parts, colon, path = args.keep_parts.partition(":")
    if not colon:
      raise InputError(f"got --keep-parts {shortened(args.keep_parts)}, expected PARTS:FILE, such as "
                       "legs,torso:walk.npz")
    joints, fps = _joints(path, -1, model, args)
    constraints.append(kinds.KeepParts(joints, tuple(part.strip() for part in parts.split(",")), fps))
  constraints += [kinds.Loop()] if args.loop else []
  return constraints + ([kinds.InPlace()] if args.in_place else [])


def read_file(args, model):
  """The constraints of the file of --control."""
  from motion_jax.control import files
  return files.load(args.control, lambda path, frame: _joints(path, frame, model, args)[0])


def regenerate_parts(args, clip, pipeline, sampling):
  """The motions of `edit --keep-parts`: body parts of the clip are kept, the prompt controls the others."""
  from motion_jax.control.constraints import KeepParts
  from motion_jax.models.shared.known_motion import at_rate
  from motion_jax.models.shared.spans import spans_of
  if args.task or args.keep:
    raise InputError("got --keep-parts with --task or --keep; use --change for the span in which the other "
                     "parts are regenerated")
  model = pipeline.model
  joints = at_rate(clip, model.fps, model.stats.layout.skeleton)
  with shared.value_of("--change", " ".join(args.change or [])):
    spans = [[first / model.fps, past / model.fps]
             for first, past in spans_of(args.change or [], len(joints), model.fps)] or None
  parts = tuple(part.strip() for part in args.keep_parts.split(","))
  seeds = [args.seed + i for i in range(args.num_samples)]
  return pipeline([args.prompt] * args.num_samples, seeds=seeds, without=flags.without_of(args),
                  control=[KeepParts(joints, parts, model.fps, spans)], **sampling)


def drawn(constraints, motions):
  """The constraints for drawing on each motion: `ControlSignal`s (1, T)."""
  from motion_jax.control.compiling import compile
  return [compile(constraints, motion.num_frames, motion.fps, motion.joints) for motion in motions]


def drawn_options(out, signals, constraints):
  """The options of `export.save` that draw constraints, a signal or a list of them; {} for None."""
  from motion_jax.export import scene
  if signals is None or not out.lower().endswith(shared.PICTURES):
    return {}
  return {"control": signals} | ({"way_points": scene.way_points(constraints)} if out.lower().endswith(".html") else {})


def _path(text, kinds):
  points, times = [], []
  for word in text.split():
    place, colon, at = word.partition(":")
    points.append([_METRES(x) for x in place.split(",")])
    times += [real(0, 3600, "seconds")(at)] if colon else []
    if len(points[-1]) not in (2, 3) or len(points[-1]) != len(points[0]):
      raise InputError(f"got {shortened(word)!r} in --path, expected X,Z (or X,Y,Z) of each point, in metres")
  if not points or times and len(times) != len(points):
    raise InputError(f"got --path {shortened(text)!r}, expected points such as \"0,0 2,0 2,3\", with seconds after "
                     "all of them or none")
  return kinds.RootPath(points, times or None)


def _joints(path, frame, model, args):
  """(joints of a frame (22, 3), or with -1 of all frames (T, 22, 3), frames a second), on the model's body."""
  from motion_jax import export
  from motion_jax.models.shared.known_motion import on_our_body
  clip = export.load(path, mapping=args.mapping)
  joints = on_our_body(clip, model.fps, model.stats.layout.skeleton)
  if frame < 0:
    return joints, model.fps
  at = round(frame * model.fps / clip.fps)
  if at >= len(joints):
    raise InputError(f"got frame {frame} of {path}, which has {clip.num_frames}")
  return joints[at], model.fps
