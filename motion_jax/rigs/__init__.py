"""Skeletons of other programs: their joint names, trees and rest poses, and the maps to HumanML3D's 22 joints."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.rigs.bones import Bones, find_bones
  from motion_jax.rigs.joint_arrays import pick_joints
  from motion_jax.rigs.joint_maps import map_joints, mapping_template, own_joints, skeleton_of
  from motion_jax.rigs.rig import Rig, all_rigs, get_rig

__all__ = ["Bones", "Rig", "all_rigs", "find_bones", "get_rig", "map_joints", "mapping_template", "own_joints",
           "pick_joints", "skeleton_of"]

__getattr__, __dir__ = lazy.attach(__name__)
