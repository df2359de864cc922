from .bones import Bones, find_bones
from .joint_arrays import pick_joints
from .joint_maps import map_joints, mapping_template, own_joints, skeleton_of
from .rig import Rig, all_rigs, get_rig

__all__ = ["Bones", "Rig", "all_rigs", "find_bones", "get_rig", "map_joints", "mapping_template", "own_joints",
           "pick_joints", "skeleton_of"]
