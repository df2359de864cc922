"""Rigged characters for the page's viewer: what programs export, what is wrong with some, and a motion that fits."""
import numpy as np
import pytest

from motion_jax.data.clip import Clip
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D
from tests.export import characters as boxes
from tests.export.characters import mirrored, rig_joints, two_bodies, with_vrm

BENDS = {"pelvis": ("y", 0.9), "spine1": ("x", 0.3), "left_hip": ("x", -1.4), "left_knee": ("x", 1.2),
         "right_hip": ("x", -0.3), "right_knee": ("x", 0.5), "left_shoulder": ("z", 0.9), "right_shoulder": ("z", 1.1),
         "right_elbow": ("y", 1.3), "neck": ("x", 0.2)}


def moving(rest):
  """A clip of a body with these joints at rest (22, 3) that kicks, raises its arms, turns and bows."""
  frames = []
  for w in np.sin(np.linspace(0, 3, 30)):
    turned, at = [], np.zeros((22, 3))
    for j, (joint, parent) in enumerate(zip(HUMANML3D.joints, HUMANML3D.parents)):
      axis, angle = BENDS.get(joint, ("x", 0.0))
      above = turned[parent] if j else np.array([1.0, 0, 0, 0])
      turned.append(rot.multiply(above, rot.about_axis(np.array(angle * w), axis)))
      at[j] = at[parent] + rot.rotate(above, rest[j] - rest[parent]) if j else 0
    frames.append(at)
  joints = frames + np.linspace([0, 0, 0], [0.5, 0, 1], 30)[:, None]
  return Clip((joints - [0, joints[..., 1].min(), 0]).astype(np.float32), 20.0)


CHARACTERS = {  # what each is: names, rest pose, unit, axes
    "mixamo.glb": dict(scale=0.01, rolls=2, armature=np.array([np.sqrt(0.5), -np.sqrt(0.5), 0, 0])),
    "unreal.glb": dict(rig="ue5", rolls=1), "unity.glb": dict(rig="unity", size=0.4),
    "one.vrm": dict(rig="vrm", change=with_vrm(1)),
    "zero.vrm": dict(rig="vrm", change=with_vrm(0), raised={rig_joints("vrm")["pelvis"]: (0.0, 0.0, 1.0, 0.0)}),
    "short.glb": dict(rig="lafan", size=3.0, leave_out=("Head", "Neck"))}
REFUSED = {  # a file's name: what is wrong with it, or how its bytes are damaged, and words of the sentence
    "skin.glb": (dict(change=lambda document: document.pop("skins")), "has no skin"),
    "legs.glb": (dict(leave_out=("LeftLeg", "LeftFoot")), "has no left leg"),
    "two.glb": (dict(change=two_bodies), "has two humanoids"), "mirrored.glb": (dict(change=mirrored), "is mirrored"),
    "cut.glb": (lambda data: data[:3000], "is cut off"),
    "none.glb": (lambda data: b"no glb at all, but long enough", "is no binary glTF"),
    "broken.glb": (lambda data: data.replace(b'"asset"', b'"asset", '), "not valid")}


def character(folder, rest, **about):
  """The bytes of a character with the proportions of joints at rest (22, 3)."""
  with pytest.MonkeyPatch.context() as patch:
    patch.setattr(boxes, "HALF", 1e-4)  # soles where the motion has the floor
    boxes.write_character(folder / "body.glb", Clip(rest[None].repeat(2, axis=0), 20.0), **about)
  return (folder / "body.glb").read_bytes()
