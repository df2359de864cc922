"""The rig of .bvh and .glb files: poses of one skeleton, the same for every motion of a model, in metres."""
import functools

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.motion.pose import Pose, pose_to_joints, to_pose, turn_ends
from motion_jax.motion.rigid import fit_pose, rest_offsets
from motion_jax.motion.skeleton import Skeleton


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


def rig_error(clip: Clip) -> tuple[float, float, str]:
  """(mean, worst, joint of the worst) of the distances, millimetres, from the joints of `rigged` to the clip's own."""
  off = pose_to_joints(rigged(clip), clip.skeleton) - np.asarray(clip.joints, np.float64) * clip.skeleton.unit
  distance = 1000 * np.linalg.norm(off, axis=-1)
  joint = clip.skeleton.joints[int(distance.max(0).argmax())]
  return float(distance.mean()), float(distance.max()), joint.replace("_", " ")
