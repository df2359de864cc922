"""The rig of exported files: poses of one skeleton, the same for every motion of a model, on any table of names."""
import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from motion_jax.data.clip import Clip
from motion_jax.motion import rigs
from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import Pose, pose_to_joints, to_pose, turn_ends
from motion_jax.motion.retarget import floor_height
from motion_jax.motion.rigid import fit_pose, rest_offsets
from motion_jax.motion.rigs import Rig
from motion_jax.motion.skeleton import Skeleton
from motion_jax.utils.errors import InputError


def rigged(clip: Clip, exact: bool = False) -> Pose:
  """The Pose of a clip's rig, metres: the nearest that rotations and a moving root can be, `shifts` zero.

  exact: `shifts` hold the remaining offsets, so that every joint is where the clip has it.
  """
  joints = np.ascontiguousarray(clip.joints, np.float64)
  return _rigged(joints.tobytes(), clip.skeleton, clip.fps, exact)


@functools.lru_cache(maxsize=8)  # a .bvh and a .glb of one clip, and the distance that is reported
def _rigged(joints: bytes, skeleton: Skeleton, fps: float, exact: bool) -> Pose:
  places, unit = np.frombuffer(joints).reshape(-1, skeleton.num_joints, 3), skeleton.unit
  rest = rest_offsets(places, skeleton, fps)
  pose = turn_ends((to_pose if exact else fit_pose)(places, skeleton, fps, rest), places * unit, skeleton)
  return pose._replace(offsets=pose.offsets * unit, shifts=pose.shifts * unit, root=pose.root * unit)


class RigMotion(NamedTuple):
  """A motion on the N joints of a rig, metres, y up. Rotations turn from the rig's rest pose, where none is turned."""
  rig: Rig
  offsets: Float[np.ndarray, "n 3"]      # from the parent at rest; a root's is zero
  tips: Float[np.ndarray, "n 3"]         # from each joint to the end of its limb at rest, for joints without children
  shifts: Float[np.ndarray, "t n 3"]     # further than the offset: what rotations cannot reach
  root: Float[np.ndarray, "t 3"]         # position of the pelvis
  rotations: Float[np.ndarray, "t n 4"]  # quaternions (w, x, y, z) relative to the parent; signs continuous in time
  turned: Float[np.ndarray, "t n 4"]     # the same in the world

  @property
  def pelvis(self) -> int:
    """The joint that `root` is the place of."""
    return next(iter(self.rig.joints.values()))


def on_rig(clip: Clip, rig: str | Rig | None = None, exact: bool = False, t_pose: bool = False) -> RigMotion:
  """A clip on the joints of a rig, which keeps the body's own proportions; None: the clip's skeleton as it is.

  Every joint turns with the one of the clip whose place it has; joints in between keep still. t_pose: one more frame
  before the motion, a T-pose on the floor, facing +z. Raises InputError for a rig of 22 joints and a clip of another
  skeleton.
  """
  skeleton = clip.skeleton
  rig = rigs.of_skeleton(skeleton) if rig is None else rigs.get_rig(rig) if isinstance(rig, str) else rig
  if not set(rig.joints) <= set(skeleton.joints):
    raise InputError(f"got rig {rig.name!r} for a motion of {skeleton.num_joints} joints ({skeleton.name}), expected "
                     f"HumanML3D's 22; skeleton {skeleton.name!r} is written without a rig, as .bvh or .glb")
  pose = rigged(clip, exact)
  return pose_on_rig(_after_t_pose(pose, skeleton) if t_pose else pose, rig, skeleton)


def pose_on_rig(pose: Pose, rig: Rig, skeleton: Skeleton) -> RigMotion:
  """A pose of a skeleton that has the rig's joints, metres, on the rig."""
  rest, followed, parents = rig.arm_rest(skeleton), np.array(rig.followed(skeleton)), np.array(rig.parents)
  turned = rot.multiply(pose.turned, rot.conjugate(rest)[None])[:, followed]
  turned[:, followed < 0] = [1, 0, 0, 0]
  above = np.maximum(parents, 0)
  local = rot.multiply(rot.conjugate(turned[:, above]), turned)
  local[:, parents < 0] = turned[:, parents < 0]
  leaning = rest[followed[above]]  # how the parent's bone is turned at rest
  places = rig.places(pose.offsets, skeleton)
  offsets = rot.rotate(leaning, places - places[above])
  offsets[parents < 0] = 0
  shifts = np.zeros((*turned.shape[:2], 3))
  for name, number in rig.joints.items():
    shifts[:, number] = rot.rotate(leaning[number][None], pose.shifts[:, skeleton.joints.index(name)])
  ends = np.array([rigs.tip(skeleton.joints[joint]) * (1 if number in rig.joints.values() else 0.1)
                   for number, joint in enumerate(followed)])
  return RigMotion(rig, offsets, rot.rotate(rest[followed], ends), shifts, pose.root, rot.continuous(local),
                   rot.continuous(turned))


def _after_t_pose(pose: Pose, skeleton: Skeleton) -> Pose:
  """A Pose, metres, after one more frame: the T-pose, its feet as high as those that stand in the motion."""
  still = lambda q: rot.continuous(np.concatenate([np.broadcast_to([1.0, 0, 0, 0], (1, *q.shape[1:])), q]))
  floor = floor_height(pose_to_joints(pose, skeleton), skeleton)
  low = rigs.of_skeleton(skeleton).places(pose.offsets, skeleton)[:, 1].min()
  root = np.concatenate([[[pose.root[0, 0], floor - low, pose.root[0, 2]]], pose.root])
  return pose._replace(root=root, rotations=still(pose.rotations), turned=still(pose.turned),
                       shifts=np.concatenate([np.zeros_like(pose.shifts[:1]), pose.shifts]))


def rig_error(clip: Clip) -> tuple[float, float, str]:
  """(mean, worst, joint of the worst) of the distances, millimetres, from the joints of `rigged` to the clip's own."""
  off = pose_to_joints(rigged(clip), clip.skeleton) - np.asarray(clip.joints, np.float64) * clip.skeleton.unit
  distance = 1000 * np.linalg.norm(off, axis=-1)
  joint = clip.skeleton.joints[int(distance.max(0).argmax())]
  return float(distance.mean()), float(distance.max()), joint.replace("_", " ")
