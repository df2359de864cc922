"""Motion without learning: skeletons, rotations, features, statistics, retargeting, cleanup."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.motion import representations, rotations
  from motion_jax.motion.cleanup import Cleaner, clean_up
  from motion_jax.motion.contacts import feet_stand
  from motion_jax.motion.pose import Pose, pose_to_joints, to_pose
  from motion_jax.motion.representations import (
    LAYOUTS,
    Representation,
    get_layout,
    layout_for,
    root_path,
    rotations_to_joints,
    to_features,
    to_joints,
  )
  from motion_jax.motion.retarget import mirror, with_lengths
  from motion_jax.motion.skeleton import (
    HUMANML3D,
    KIT,
    SKELETONS,
    SMPL,
    SNAPMOGEN,
    Skeleton,
    bone_lengths,
    facing,
    t_pose,
  )
  from motion_jax.motion.stats import Stats, compute_stats, load_stats, save_stats

__all__ = ["Cleaner", "HUMANML3D", "KIT", "LAYOUTS", "Pose", "Representation", "SKELETONS", "SMPL", "SNAPMOGEN",
           "Skeleton", "Stats", "bone_lengths", "clean_up", "compute_stats", "facing", "feet_stand", "get_layout",
           "layout_for", "load_stats", "mirror", "pose_to_joints", "representations", "root_path", "rotations",
           "rotations_to_joints", "save_stats", "t_pose", "to_features", "to_joints", "to_pose", "with_lengths"]

__getattr__, __dir__ = lazy.attach(__name__)
