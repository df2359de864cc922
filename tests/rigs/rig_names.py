"""Joint names as other programs write them: each word of `joint_names.LEGS` and `ARMS`, with where it was seen.

A row: the trunk from pelvis to head, a leg from hip to toes, an arm from collar to wrist, and the joint of the trunk
that arms hang on. "+" is the word for left or right: Left, l, L; "-" is a joint that the kind lacks.
"""
from typing import NamedTuple

import numpy as np

from motion_jax.motion.skeleton import HUMANML3D, SMPL


class Rig(NamedTuple):
  trunk: str
  leg: str
  arm: str
  chest: str
  sides: tuple[str, str] = ("Left", "Right")


_LR, _lr = ("L", "R"), ("l", "r")
_IK = "+UpLeg +Leg +Foot +ToeBase", "+Shoulder +Arm +ForeArm +Hand"
_ANKLE = "+Hip +Knee +Ankle +Toe", "+Collar +Shoulder +Elbow +Wrist"


def _prefixed(prefix, rig):
  put = lambda names: " ".join(name if name == "-" else prefix + name for name in names.split())
  return Rig(*map(put, rig[:4]), rig.sides)


_MIXAMO = Rig("Hips Spine Spine1 Spine2 Neck Head HeadTop_End", *_IK, "Spine2")
_BIPED = Rig("Pelvis Spine Spine1 Spine2 Neck Head", "+~Thigh +~Calf +~Foot +~Toe0",
             "+~Clavicle +~UpperArm +~Forearm +~Hand", "Neck", _LR)
_SMPL = Rig("Pelvis Spine1 Spine2 Spine3 Neck Head", "+_Hip +_Knee +_Ankle +_Foot",
            "+_Collar +_Shoulder +_Elbow +_Wrist", "Spine3", _LR)

# "~" is a blank. Seen in files of these repositories where one is named, else in the program's documentation.
RIGS = {
    "Mixamo, 20tab/bvh-python:tests/test_freebvh.bvh": _prefixed("mixamorig:", _MIXAMO),
    "Mixamo in three.js": _prefixed("mixamorig", _MIXAMO),
    "CMU's bones in BVH": Rig("root lowerback upperback thorax lowerneck upperneck head", "+femur +tibia +foot +toes",
                              "+clavicle +humerus +radius +wrist", "thorax", _lr),
    "Xsens, 100STYLE, VictorS-67/pybvh:bvh_data/bvh_test2.bvh": Rig(
        "Hips Chest Chest2 Chest3 Chest4 Neck Head", *_ANKLE, "Chest4"),
    "Vicon, mocapdata.com, OlafHaag/bvh-toolbox:test_mocapbank.bvh": Rig(
        "Hips Chest Chest2 Neck Head", "+Hip +Knee +Ankle -", "+Collar +Shoulder +Elbow +Wrist", "Chest2"),
    "OptiTrack": Rig("Hip Ab Chest Neck Head", "+Thigh +Shin +Foot +Toe", "+Shoulder +UArm +FArm +Hand", "Chest", _LR),
    "Human3.6M": Rig("Hip Spine Thorax Neck Head", "+Hip +Knee +Ankle -", "- +Shoulder +Elbow +Wrist", "Thorax", _LR),
    "MakeHuman 1.1, makehumancommunity/makehuman:benchmark.bvh": Rig(
        "root spine05 spine04 spine03 spine02 spine01 neck01 neck02 neck03 head",
        "upperleg01.+ lowerleg01.+ foot.+ toe1-1.+", "clavicle.+ upperarm01.+ lowerarm01.+ wrist.+", "spine01", _LR),
    "MocapNET, FORTH-ModelBasedTracker/MocapNET:CMU_Sample_05_01.bvh": Rig(
        "hip abdomen chest neck neck1 head", "+hip +knee +foot toe1-1.+", "+collar +shoulder +elbow +hand", "chest",
        _lr),
    "Poser, Daz, Second Life": Rig("hip abdomen chest neck head", "+Thigh +Shin +Foot +Toe",
                                   "+Collar +Shldr +ForeArm +Hand", "chest", _lr),
    "Daz Genesis 8": Rig("hip abdomenLower abdomenUpper chestLower chestUpper neckLower neckUpper head",
                         "+ThighBend +Shin +Foot +Toe", "+Collar +ShldrBend +ForearmBend +Hand", "chestUpper", _lr),
    "SnapMoGen": Rig("ROOT C_spine0001_bind_JNT C_spine0002_bind_JNT C_spine0003_bind_JNT C_neck0001_bind_JNT "
                     "C_neck0002_bind_JNT C_head_bind_JNT",
                     "+_legUpper0001_bind_JNT +_legLower0001_bind_JNT +_foot0001_bind_JNT +_foot0002_bind_JNT",
                     "+_clavicle_bind_JNT +_armUpper0001_bind_JNT +_armLower0001_bind_JNT +_hand0001_bind_JNT",
                     "C_spine0003_bind_JNT", _LR),
    "SOMA, nv-tlabs/kimodo:kimodo/skeleton/definitions.py": Rig(
        "Hips Spine1 Spine2 Chest Neck1 Neck2 Head HeadEnd", "+Leg +Shin +Foot +ToeBase",
        "+Shoulder +Arm +ForeArm +Hand", "Chest"),
    "SMPL": _SMPL,
    "3ds Max biped": _prefixed("Bip01~", _BIPED),
    "Unity": Rig("Hips Spine Chest UpperChest Neck Head", "+UpperLeg +LowerLeg +Foot +Toes",
                 "+Shoulder +UpperArm +LowerArm +Hand", "UpperChest"),
    "mocopi": Rig("root torso_1 torso_2 torso_3 torso_4 torso_5 torso_6 torso_7 neck_1 neck_2 head",
                  "+_up_leg +_low_leg +_foot +_toes", "+_shoulder +_up_arm +_low_arm +_hand", "torso_7", _lr),
    "Kinect": Rig("SpineBase SpineMid SpineShoulder Neck Head", "Hip+ Knee+ Ankle+ Foot+",
                  "- Shoulder+ Elbow+ Wrist+", "SpineShoulder"),
}


def pose():
  """A body in a T-pose, (22, 3): metres, y up, facing +z."""
  joints = np.zeros((22, 3))
  for chain in HUMANML3D.chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      joints[joint] = joints[parent] + SMPL.offsets[joint]
  return joints + [0.0, 0.95, 0.0]


def build(rig):
  """(names, parents, places (N, 3), {our joint: index}) of a rig, with fingers and End Sites, on the body of `pose`."""
  body = dict(zip(HUMANML3D.joints, pose()))
  names, parents, places, where = [], [], [], {}

  def add(name, parent, place):
    names.append(name.replace("~", " ").split(":")[-1])
    parents.append(parent)
    places.append(place)
    return len(names) - 1

  trunk = rig.trunk.split()
  heads = next((i for i, name in enumerate(trunk) if "head" in name.lower()), len(trunk) - 1)
  necks = next((i for i, name in enumerate(trunk) if "neck" in name.lower()), heads)
  line = [body[joint] for joint in ("pelvis", "spine1", "spine2", "spine3", "neck", "head")]
  # 0 for the pelvis, 4 for the neck, 5 for the head
  parts = np.interp(np.arange(len(trunk)), [0, necks, heads, heads + 1], [0, 4 if necks < heads else 5, 5, 6])
  at = {}
  for i, (name, part) in enumerate(zip(trunk, parts)):
    low = min(int(part), 4)
    at[name] = add(name, at[trunk[i - 1]] if i else -1, line[low] + (part - low) * (line[low + 1] - line[low]))
  if not names[-1].endswith("_end"):
    add(f"{names[-1]}_end", len(names) - 1, places[-1] + [0, 0.1, 0])
  where["pelvis"], where["head"] = 0, at[trunk[heads]]
  for side, word in zip(("left", "right"), rig.sides):
    for kinds, row, last in ((("hip", "knee", "ankle", "foot"), rig.leg, 0),
                             (("collar", "shoulder", "elbow", "wrist"), rig.arm, at[rig.chest])):
      for kind, name in zip(kinds, row.split()):
        if name != "-":
          last = where[f"{side}_{kind}"] = add(name.replace("+", word), last, body[f"{side}_{kind}"])
      if kinds[0] == "collar":
        add(f"{word}HandIndex1", last, places[-1] + [0.08 if side == "left" else -0.08, 0, 0])
      add(f"{names[-1]}_end", len(names) - 1, places[-1] + [0, 0, 0.02])
  return names, parents, np.array(places), where
