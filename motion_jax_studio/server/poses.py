"""Poses in addition to the joints of a stream (docs/protocol.md): a robot's configurations or a rig's rotations."""
from typing import Any

import numpy as np

from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.utils.errors import InputError

RATE = 50.0


class Poses:
  """Converts blocks of joints to pose rows; `about` describes the values of a row."""

  def __init__(self, pose: str, skeleton: Skeleton, source_fps: float) -> None:
    """pose: "robot:g1" or "rig:NAME". Raises InputError for another pose, and for a skeleton other than HumanML3D's."""
    kind, _, name = pose.partition(":")
    if kind not in _MAKERS or not name:
      raise InputError(f"got the pose {pose[:60]!r}, expected robot:g1 or rig:NAME, such as rig:unity")
    if skeleton is not HUMANML3D:
      raise InputError(f"got pose {pose!r} of a model of skeleton {skeleton.name}, expected a model of HumanML3D's 22 "
                       "joints")
    self._stream, about = _MAKERS[kind](name, source_fps)
    self.about: dict[str, Any] = {"kind": kind, "name": name, "fps": RATE, "quaternion_order": "wxyz"} | about
    self.count = 0  # rows so far

  def push(self, joints: np.ndarray, last: bool = False) -> np.ndarray:
    """Add joints (T, 22, 3); returns the rows (N, W) float32 that are final by then. last: no joints follow."""
    rows = self._stream.push(joints)
    if last:
      rows = np.concatenate([rows, self._stream.finish()])
    self.count += len(rows)
    return rows.astype(np.float32)


def _robot(name, source_fps):
  from motion_jax import robots
  from motion_jax.robots.targets import DELAY
  if name not in robots.SHIPPED:
    raise InputError(f"got robot {name[:60]!r}, expected {', '.join(robots.SHIPPED)}")
  robot = robots.load(name)
  return robots.Stream(robot, source_fps, RATE), {
      "joints": list(robot.joints), "row": "qpos: root x y z, root w x y z, an angle for each joint",
      "axes": "z up, x ahead, y left", "delay": DELAY}


def _rig(name, source_fps):
  from motion_jax.export.rig_stream import RigStream
  stream = RigStream(name, source_fps, RATE)
  return stream, {
      "joints": list(stream.rig.names), "parents": list(stream.rig.parents), "rest": stream.rig.rest,
      "offsets": stream.offsets.round(5).tolist(),
      "row": "root x y z, then w x y z for each joint, relative to its parent, identity at rest",
      "axes": "y up, z ahead, x left", "delay": stream.delay}


_MAKERS = {"robot": _robot, "rig": _rig}
