"""Bring hands to named places by turning and bending the arms: out to the sides, ahead, to the face, on the hips.

Places are relative to the body: a hand stays there while the body walks, turns or bends. numpy, whole clips of
`HUMANML3D`'s joints.
"""
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D, SIDES
from motion_jax.shapes import Float, Num

_STRAIGHT = 0.985  # largest distance from shoulder to wrist, relative to the length of the arm
_DETOUR, _BEFORE = 0.5, (0.7, 0.0, 0.7)  # size, in lengths of the arm, and direction of the detour around the shoulder


class _Place(NamedTuple):
  """Position of a wrist relative to a joint: out (away from the other arm), up and ahead, in lengths of the arm."""
  joint: str  # "{}" in it is the side of the arm, "[]" the other side
  away: tuple[float, float, float]
  elbow: tuple[float, float, float]  # direction in which the elbow points: out, up, ahead


PLACES = {
    "side": _Place("{}_shoulder", (0.98, 0.0, 0.08), (0.0, -1.0, -0.3)),
    "front": _Place("{}_shoulder", (-0.08, 0.0, 0.98), (0.4, -1.0, 0.0)),
    "up": _Place("{}_shoulder", (0.12, 0.97, 0.06), (1.0, 0.0, 0.2)),
    "down": _Place("{}_shoulder", (0.2, -0.96, 0.08), (0.4, 0.0, -1.0)),
    "face": _Place("head", (0.13, -0.12, 0.28), (0.6, -1.0, 0.0)),
    "ear": _Place("head", (0.25, -0.02, 0.06), (1.0, -0.6, 0.2)),
    "head": _Place("head", (0.15, 0.26, 0.04), (1.0, -0.1, 0.2)),
    "shoulder": _Place("[]_shoulder", (0.16, 0.0, 0.22), (0.0, -1.0, 0.4)),
    "chest": _Place("spine3", (0.1, 0.15, 0.34), (1.0, -0.6, 0.0)),
    "together": _Place("spine3", (0.05, -0.05, 0.6), (1.0, -0.7, 0.0)),
    "apart": _Place("spine3", (0.55, 0.0, 0.62), (1.0, -0.7, 0.0)),
    "crossed": _Place("spine3", (-0.22, 0.0, 0.42), (1.0, -0.8, 0.0)),
    "stomach": _Place("spine1", (0.1, 0.1, 0.34), (1.0, -0.3, -0.2)),
    "back": _Place("spine1", (0.05, 0.05, -0.3), (1.0, 0.0, -0.6)),
    "hips": _Place("{}_hip", (0.18, 0.24, 0.0), (1.0, 0.0, -0.5)),
    "knees": _Place("{}_knee", (0.0, 0.15, 0.12), (1.0, 0.0, 0.2))}


def bring_hands(joints: Num[np.ndarray, "t j 3"], place: str, sides: Sequence[str], weight: Num[np.ndarray, " t"]
                ) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3) with the hands of some sides brought to one of PLACES. float32.

  weight (T,): 0 leaves an arm unchanged, 1 brings its wrist to the place, within reach; in between the wrist is on its
  way, with a detour in front of and outside the body if the place is on the other side of the shoulder. Bones keep
  their lengths; all other joints stay.
  """
  result, weight = np.array(joints, np.float64), np.asarray(weight, np.float64)[:, None]
  for side in sides:
    shoulder, elbow, wrist = (HUMANML3D.joints.index(f"{side}_{name}") for name in ("shoulder", "elbow", "wrist"))
    bones = [result[:, elbow] - result[:, shoulder], result[:, wrist] - result[:, elbow]]
    arm, goal = result[:, wrist] - result[:, shoulder], target(result, place, side) - result[:, shoulder]
    opposite = 0.5 - 0.5 * (rot.unit(arm) * rot.unit(goal)).sum(-1, keepdims=True)
    detour = _DETOUR * np.linalg.norm(goal, axis=-1, keepdims=True) * opposite * _in_the_world(result, side, _BEFORE)
    line = arm + weight * (goal - arm) + 4 * weight * (1 - weight) * detour
    result[:, elbow], result[:, wrist] = _bent(result[:, shoulder], bones, arm, line, weight,
                                               _in_the_world(result, side, PLACES[place].elbow))
  return result.astype(np.float32)


def target(joints: Num[np.ndarray, "t j 3"], place: str, side: str) -> Float[np.ndarray, "t 3"]:
  """Target position (T, 3) of the wrist of a side for one of PLACES."""
  other = SIDES[1 - SIDES.index(side)]
  shoulder, elbow, wrist, seen_from = (HUMANML3D.joints.index(name) for name in (
      f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist",
      PLACES[place].joint.replace("{}", side).replace("[]", other)))
  length = sum(np.linalg.norm(joints[:, a] - joints[:, b], axis=-1) for a, b in ((shoulder, elbow), (elbow, wrist)))
  return joints[:, seen_from] + length[:, None] * _in_the_world(joints, side, PLACES[place].away)


def distance_to_place(joints: Num[np.ndarray, "t j 3"], place: str, side: str) -> Float[np.ndarray, " t"]:
  """Distance (T,), metres, of the wrist of a side from its target for one of PLACES."""
  wrist = HUMANML3D.joints.index(f"{side}_wrist")
  return np.linalg.norm(joints[:, wrist] - target(joints, place, side), axis=-1)


def _in_the_world(joints, side, direction):
  """A direction (out, up, ahead) of the trunk as vectors (T, 3); out is away from the other arm."""
  at = HUMANML3D.joints.index
  up = rot.unit(joints[:, at("neck")] - joints[:, at("pelvis")])
  across = joints[:, at("left_shoulder")] - joints[:, at("right_shoulder")]
  left = rot.unit(across - (across * up).sum(-1, keepdims=True) * up)
  out, high, ahead = direction
  return (out if side == "left" else -out) * left + high * up + ahead * np.cross(left, up)


def _bent(shoulder, bones, arm, line, weight, hint):
  """(elbow, wrist) (T, 3) of an arm whose wrist is at shoulder + line, within reach of its bones.

  At weight (T, 1) 0 the elbow keeps its direction from the line of the arm, at 1 it points along the hint.
  """
  first, second = (np.linalg.norm(bone, axis=-1, keepdims=True) for bone in bones)
  now = np.linalg.norm(arm, axis=-1, keepdims=True)
  far = np.clip(np.linalg.norm(line, axis=-1, keepdims=True), np.abs(first - second) + 1e-3,
                np.maximum(now, _STRAIGHT * (first + second)))
  way, before = rot.unit(line), rot.unit(arm)
  points = (bones[0] - (bones[0] * before).sum(-1, keepdims=True) * before) / first
  points = points + weight * (hint - points)
  aside = rot.unit(points - (points * way).sum(-1, keepdims=True) * way, 1e-9)
  along = (first**2 - second**2 + far**2) / (2 * far)
  return shoulder + along * way + np.sqrt(np.maximum(first**2 - along**2, 0.0)) * aside, shoulder + far * way
