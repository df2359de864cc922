"""The mannequin bound to a rig: what files with a mesh hold."""
from typing import NamedTuple

import numpy as np

from motion_jax.export.body import make_figure
from motion_jax.export.mesh import Skin, make_skins, rest_joints
from motion_jax.export.rig import RigMotion, on_rig, rigged
from motion_jax.motion import rotations as rot
from motion_jax.shapes import Float


class Binding(NamedTuple):
  """The mannequin on the N joints of a rig, metres, y up."""
  motion: RigMotion
  carriers: list[int]                   # the joint of the rig for each joint that `skins` name by number
  skins: list[Skin]
  rest: Float[np.ndarray, "n 3"]        # where the rig's joints are in the T-pose, soles at y = 0
  inverse: Float[np.ndarray, "n 4 4"]   # from the T-pose, in which the mesh is, to the frame of each joint


def bind(clip, exact=False, rig=None, t_pose=False) -> Binding:
  """The mannequin of a clip on a rig (`export.rig.on_rig`), bound in the T-pose even where the rig rests otherwise."""
  skeleton = clip.skeleton
  pose, moved = rigged(clip, exact), on_rig(clip, rig, exact, t_pose)
  ours = rest_joints(pose.offsets, skeleton)
  followed = moved.rig.followed(skeleton)
  turned = np.array(followed)
  rest = moved.rig.places(pose.offsets, skeleton) + np.where(turned[:, None] < 0, 0, ours[0])  # a root is on the floor
  inverse = np.tile(np.eye(4), (len(rest), 1, 1))
  inverse[turned >= 0, :3, :3] = rot.to_matrix(moved.rig.arm_rest(skeleton))[turned[turned >= 0]]
  inverse[:, :3, 3] = -np.einsum("jab,jb->ja", inverse[:, :3, :3], rest)
  carriers = [moved.rig.joints.get(name, followed.index(j) if j in followed else 0)
              for j, name in enumerate(skeleton.joints)]
  return Binding(moved, carriers,
                 make_skins(make_figure(clip, pose).parts, ours, skeleton), rest, inverse)
