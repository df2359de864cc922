"""Neutral pose of feet, collars and head in a motion, which corresponds to the rest pose of a character.

Captures differ in where they place these joints: the bone from ankle to toes of a foot flat on the floor falls by 35 or
by 42 degrees, the collars of a body at ease point up by 8 or by 29, the head is upright or leans forward by 20. A
character's rest pose shows these parts at ease, so its bones turn from there by the difference between the motion and
the motion's own neutral pose. For a character with the motion's own skeleton (`is_own`) nothing is changed.
"""
import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.skeleton import HUMANML3D, SIDES
from motion_jax.shapes import Float

_OF = {name: number for number, name in enumerate(HUMANML3D.joints)}
_SAME = 0.01            # metres by which offsets of the motion's own skeleton may differ
_HANGS = -0.5           # of an upper arm that hangs, the height of its end against its length
_FLAT = np.radians(-38.0)             # of a foot on the floor, where a clip shows none
_FEET = np.radians([-55.0, -20.0])    # what a flat foot may be
_NOD = np.radians(25.0)               # the most that a head at ease leans ahead or back


def is_own(places: Float[np.ndarray, "j 3"], offsets: Float[np.ndarray, "j 3"], known: list[int]) -> bool:
  """Whether a figure in a T-pose, joints (22, 3) of which `known` are there, has the motion's offsets (22, 3)."""
  parents = HUMANML3D.parents
  return all(np.linalg.norm(places[joint] - places[parents[joint]] - offsets[joint]) < _SAME for joint in range(1, 22)
             if joint in known and parents[joint] in known)


def eased(turned: Float[np.ndarray, "t j 4"], joints: Float[np.ndarray, "t j 3"], offsets: Float[np.ndarray, "j 3"],
          fps: float) -> Float[np.ndarray, "t j 4"]:
  """World rotations (T, 22, 4) in which feet, collars and head are relative to their neutral pose, not to a T-pose."""
  result = turned.copy()
  _feet(result, turned, joints, offsets, fps)
  _collars(result, turned)
  chest, neck = turned[:, _OF["spine3"]], turned[:, _OF["neck"]]
  nod = np.clip(np.median(_pitch(rot.multiply(rot.conjugate(chest), neck))), -_NOD, _NOD)
  for name in ("neck", "head"):
    result[:, _OF[name]] = rot.multiply(turned[:, _OF[name]], rot.about_axis(np.array(-nod), "x")[None])
  return result


def _feet(result, turned, joints, offsets, fps):
  stand = feet_stand(joints, fps)
  for side, name in enumerate(SIDES):
    ankle, toes = _OF[f"{name}_ankle"], _OF[f"{name}_foot"]
    bone = joints[:, toes] - joints[:, ankle]
    fall = np.arctan2(bone[:, 1], np.hypot(bone[:, 0], bone[:, 2]))
    flat = stand[:, 2 * side] & stand[:, 2 * side + 1]
    at_ease = np.clip(np.median(fall[flat]) if flat.any() else _FLAT, *_FEET)
    offset = offsets[toes]
    level = rot.about_axis(np.array(at_ease - np.arctan2(offset[1], np.hypot(offset[0], offset[2]))), "x")[None]
    bend = _pitch(rot.multiply(rot.conjugate(turned[:, ankle]), turned[:, toes]))
    bend = bend - (np.median(bend[flat]) if flat.any() else 0)
    result[:, ankle] = rot.multiply(turned[:, ankle], level)
    result[:, toes] = rot.multiply(result[:, ankle], rot.about_axis(bend, "x"))


def _collars(result, turned):
  """Collars at ease are those of arms that hang, of both sides together; where none hangs those of the whole clip."""
  chest = turned[:, _OF["spine3"]]
  vectors, hanging = [], []
  for sign, name in zip((1, -1), SIDES):
    local = rot.continuous(rot.multiply(rot.conjugate(chest), turned[:, _OF[f"{name}_collar"]]))
    vectors.append(rot.to_vector(np.where(local[:, :1] < 0, -local, local)) * [1, sign, sign])
    hanging.append(rot.rotate(turned[:, _OF[f"{name}_shoulder"]], np.array([[sign, 0.0, 0]]))[:, 1] < _HANGS)
  vectors, hanging = np.concatenate(vectors), np.concatenate(hanging)
  ease = np.median(vectors[hanging] if hanging.any() else vectors, axis=0)
  for sign, name in zip((1, -1), SIDES):
    back = rot.from_vector(-ease * [1, sign, sign])
    local = rot.multiply(rot.conjugate(chest), turned[:, _OF[f"{name}_collar"]])
    result[:, _OF[f"{name}_collar"]] = rot.multiply(chest, rot.multiply(local, back[None]))


def _pitch(q):
  """The angle (T,) by which rotations (T, 4) turn about x: z towards -y."""
  return 2 * np.arctan2(q[..., 1], q[..., 0])
