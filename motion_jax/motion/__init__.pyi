from . import representations, rotations
from .cleanup import Cleaner, clean_up
from .contacts import feet_stand
from .pose import Pose, pose_to_joints, to_pose
from .representations import (
  LAYOUTS,
  Representation,
  get_layout,
  layout_for,
  root_path,
  rotations_to_joints,
  to_features,
  to_joints,
)
from .retarget import mirror, with_lengths
from .skeleton import (
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
from .stats import Stats, compute_stats, load_stats, save_stats

__all__ = ["Cleaner", "HUMANML3D", "KIT", "LAYOUTS", "Pose", "Representation", "SKELETONS", "SMPL", "SNAPMOGEN",
           "Skeleton", "Stats", "bone_lengths", "clean_up", "compute_stats", "facing", "feet_stand", "get_layout",
           "layout_for", "load_stats", "mirror", "pose_to_joints", "representations", "root_path", "rotations",
           "rotations_to_joints", "save_stats", "t_pose", "to_features", "to_joints", "to_pose", "with_lengths"]
