"""Converts MMCP's constraints to ours: root_path, effector_target and pose_keyframe.

Parts without a counterpart become a note: rotations of a target, and joints that a pose does not name.
"""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.control.constraints import Constraint, EffectorTarget, Keyframe, RootPath
from motion_jax.motion.pose import Pose, pose_to_joints, t_pose
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError

KINDS = ("root_path", "effector_target", "pose_keyframe")
MOST = 64
_FIELDS = {"root_path": {"frames", "positions_xz", "heading_radians"},
           "effector_target": {"joint", "frames", "positions", "rotations"},
           "pose_keyframe": {"frame", "joint_rotations", "root_position", "fill_mode"}}
# Rotations of these joints move no other joint.
_ENDS = {HUMANML3D.joints[joint] for joint in range(22) if joint not in HUMANML3D.parents}


class MmcpError(InputError):
  """A refusal with an HTTP status and a code of MMCP."""

  def __init__(self, status: int, code: str, message: str) -> None:
    super().__init__(message)
    self.status, self.code = status, code


def read(rows: Any, frames: int, fps: float, rate: float = 20.0) -> tuple[list[Constraint], list[str]]:
  """(our constraints, notes about unsupported parts) of a request's constraints.

  frames: length of the motion at fps; rate: frames per second of the model. Raises InputError.
  """
  if rows is None:
    return [], []
  if not isinstance(rows, list) or len(rows) > MOST:
    raise InputError(f"expected a list of at most {MOST} constraints")
  constraints: list[Constraint] = []
  notes: list[str] = []
  for number, row in enumerate(rows):
    kind = row.get("type") if isinstance(row, dict) else None
    if not isinstance(kind, str):
      raise InputError(f"constraint {number} has no type")
    if kind not in KINDS:
      raise MmcpError(400, "unsupported_constraint", f"constraint {number}: got {kind[:40]!r}, this model takes "
                            f"{', '.join(KINDS)}")
    unknown = set(row) - _FIELDS[kind] - {"type"}
    if unknown:
      raise InputError(f"constraint {number} ({kind}): got the unknown field "
                            f"{str(min(unknown))[:40]!r}")
    try:
      constraints += _constraints(kind, row, frames, fps, rate, notes)
    except InputError as error:
      raise error if isinstance(error, MmcpError) else InputError(f"constraint {number} ({kind}): {error}") from None
  return constraints, list(dict.fromkeys(notes))


def _constraints(kind, row, frames, fps, rate, notes) -> list[Constraint]:
  if kind == "pose_keyframe":
    return [_pose(row, frames, fps, notes)]
  times = _frames(row.get("frames"), frames) / fps
  places = row.get("positions_xz" if kind == "root_path" else "positions")
  if not isinstance(places, list) or len(places) != len(times):
    raise InputError(f"expected a position for each of the {len(times)} frames")
  if kind == "root_path":
    step = np.diff(times)
    dense = bool(len(step) and step.max() < 1.5 / fps)  # a position for every frame: the whole path, not way points
    if np.shape(places) != (len(times), 2):
      raise InputError("expected positions_xz of two numbers each")
    heading = row.get("heading_radians")
    if not dense:  # several frames may map to one frame of the model, which keeps the first
      kept = np.unique(np.round(times * rate), return_index=True)[1]
      if isinstance(heading, list) and len(heading) == len(times):
        heading = [heading[i] for i in kept]
      places, times = [places[i] for i in kept], times[kept]
    return [RootPath(places, times, heading=heading, between=dense)]
  if row.get("rotations") is not None:
    notes.append("rotations of an effector_target are ignored, its positions are met")
  name = row.get("joint")
  if name not in HUMANML3D.joints:
    raise MmcpError(400, "unknown_joint", f"got the joint {str(name)[:40]!r}, expected one of the "
                          "canonical_skeleton")
  # Adjacent frames become one target with a curve, for several of them may map to one frame of the model.
  whole, cuts = EffectorTarget(name, times, places), np.flatnonzero(np.diff(times) > 1.5 / rate) + 1
  return [EffectorTarget(name, at, where, between=len(at) > 1)
          for at, where in zip(np.split(times, cuts), np.split(whole.positions, cuts))]


def _pose(row: dict[str, Any], frames: int, fps: float, notes: list[str]) -> Keyframe:
  """A keyframe from joint rotations relative to the parent, on our own bones."""
  time, turns = float(_frames([row.get("frame")], frames)[0] / fps), row.get("joint_rotations")
  if not isinstance(turns, dict) or not turns:
    raise InputError("joint_rotations is missing")
  unknown = set(turns) - set(HUMANML3D.joints)
  if unknown:
    raise MmcpError(400, "unknown_joint", f"got the joint {str(min(unknown))[:40]!r}, expected those of the "
                          "canonical_skeleton")
  missing = sorted(set(HUMANML3D.joints) - set(turns) - _ENDS)
  fill = row.get("fill_mode", "generate")
  if fill not in ("rest", "generate"):
    raise InputError(f"got fill_mode {str(fill)[:40]!r}, expected rest or generate")
  if missing and fill == "generate":
    notes.append("a pose_keyframe of some joints is filled in from the rest pose, as with fill_mode \"rest\"")
  local = np.tile([1.0, 0, 0, 0], (1, 22, 1))
  for name, turn in turns.items():
    values = _numbers(turn, 4, "a rotation")
    length = np.linalg.norm(values)
    if length < 1e-3:
      raise InputError(f"got the rotation {str(turn)[:40]} of {name}, expected a quaternion x, y, z, w")
    local[0, HUMANML3D.joints.index(name)] = (values / length)[[3, 0, 1, 2]]
  root = row.get("root_position")
  place = np.zeros(3) if root is None else _numbers(root, 3, "root_position")
  joints = pose_to_joints(Pose(t_pose(), np.zeros((1, 22, 3)), place[None], local, local))[0]
  if root is None:
    joints[:, 1] -= joints[:, 1].min()  # the lowest joint is on the floor
  return Keyframe(joints, time, "anywhere" if root is None else "world")


def _frames(values: Any, frames: int) -> np.ndarray:
  if not isinstance(values, list) or not values or not all(type(value) is int for value in values):
    raise InputError(f"got the frames {str(values)[:40]}, expected whole numbers")
  if min(values) < 0 or max(values) >= frames:
    raise MmcpError(400, "frame_out_of_range", f"got frame {min(values) if min(values) < 0 else max(values)}, "
                          f"the motion has frames 0 to {frames - 1}")
  return np.array(values, float)


def _numbers(values: Any, count: int, what: str) -> np.ndarray:
  good: Sequence[Any] = values if isinstance(values, list) else ()
  if len(good) != count or not all(type(x) in (int, float) and abs(x) < 1e4 for x in good):
    raise InputError(f"got {what} {str(values)[:40]}, expected {count} numbers")
  return np.array(values, float)
