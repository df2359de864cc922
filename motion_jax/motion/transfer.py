"""Transfer motions between skeletons: from HumanML3D's 22 joints to KIT's, SMPL's or SnapMoGen's, and back.

Every bone turns as its counterpart does, from a T-pose that both skeletons share; the path is scaled by the length of
the legs. Feet may slide a little where proportions differ; `retarget` avoids that for 22 joints.
"""
import numpy as np

from motion_jax.motion import inverse
from motion_jax.motion.pose import to_pose
from motion_jax.motion.skeleton import HUMANML3D, SMPL, SNAPMOGEN, Skeleton, t_pose
from motion_jax.shapes import Array, Float, Num

# {joint of another skeleton: joint of HumanML3D that it turns with}
_LIKE = {"root": "pelvis", "torso_low": "spine1", "torso_high": "spine3", "neck2": "neck", "left_heel": "left_ankle",
         "right_heel": "right_ankle"}


def from_22(joints: Num[Array, "t 22 3"], target: Skeleton, fps: float = 20.0) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, 22, 3), metres, to joints (T, J, 3) of the skeleton target in its own unit, on the floor. float64."""
  joints = np.asarray(joints, np.float64)
  pose = to_pose(joints, HUMANML3D, fps)
  turned = pose.turned[:, [HUMANML3D.joints.index(_LIKE.get(name, name)) for name in target.joints]]
  body = target if target in (SMPL, SNAPMOGEN) else _at_rest(target)
  legs = lambda skeleton: skeleton.bone_lengths[list(skeleton.leg_bones)].sum()
  moved = inverse.forward(joints[:, 0] * (legs(target) / legs(HUMANML3D)), turned, body)
  feet = list(target.left_feet + target.right_feet)
  moved[..., 1] -= moved[:, feet, 1].min() - joints[:, [7, 10, 8, 11], 1].min() / target.unit
  return moved


def to_22(joints: Num[Array, "*lead j 3"], source: Skeleton = SNAPMOGEN) -> Float[np.ndarray, "*lead 22 3"]:
  """Joints (..., 24, 3) of SnapMoGen, centimetres, to the 22 joints (..., 22, 3) of the same names, metres.

  The second neck joint and the second root are left out, as drawing and export know 22 joints.
  """
  number = [source.joints.index("root" if name == "pelvis" else name) for name in HUMANML3D.joints]
  return np.asarray(joints)[..., number, :] * source.unit


def _at_rest(skeleton: Skeleton) -> Skeleton:
  """The skeleton with the T-pose of `pose` as its rest; KIT's rest directions are no pose of a body."""
  offsets = t_pose(skeleton)
  return inverse.with_rest(skeleton, offsets)
