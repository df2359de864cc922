"""Find HumanML3D's 22 joints in a skeleton of another program: legs and arms by name, the others by the tree.

Skeletons differ in the number of spine joints, in the place of the pelvis, and in joints that are missing. Joints that
a file has are used unchanged; missing ones are placed at HumanML3D's proportions.
"""
import itertools
from collections.abc import Mapping

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D, SIDES, SMPL
from motion_jax.rigs.joint_names import Limbs, Tree, find_limbs
from motion_jax.shapes import Float, Num

_HEIGHT = dict(zip(HUMANML3D.joints, SMPL.offsets[:, 1]))  # of each joint above its parent, at rest
_SPINE = "spine1", "spine2", "spine3", "neck"
_TRUNK = np.cumsum([-_HEIGHT["left_hip"], *(_HEIGHT[joint] for joint in _SPINE)])  # pelvis to neck, above the hips
# In lengths of a leg: distance of coincident joints; height over the hips of a pelvis that counts as between them.
_COINCIDENT, _LEVEL = 0.01, 0.05
_ASIDE = 0.25                      # least sideways position of a collar, as a share of the shoulder's; SMPL's is 0.39
_SHORTEST, _FOOT = 0.07, (0.07, 0.16)  # in lengths of a leg: shortest foot; down and ahead of a computed foot
# {joint: its names among points without a tree}
_MARKERS = {"head": ("head", "headtop", "tophead", "skull"), "neck": ("neck",)} | {
    f"{side}_foot": tuple(f"{side} {name}" for name in ("bigtoe", "toe", "toebase", "toes", "forefoot", "toetip"))
    for side in SIDES}
_TOES = "toe", "ball", "forefoot", "metatarsal", "foot"


class NamedBody:
  """Finds the joints of HumanML3D in a file: `joints` is {our joint: (T, 3)}, `lacking` the unknown ones."""

  def __init__(self, tree: Tree, positions: Num[np.ndarray, "t n 3"], turned: Num[np.ndarray, "t n 4"] | None,
               known: Mapping[str, list[int]]) -> None:
    self.tree, self.positions, self.turned, self.own = tree, positions, turned, set(known)
    self.joints = {joint: positions[:, indices].mean(1) for joint, indices in known.items()}
    self.at = {joint: indices[0] if len(indices) == 1 else None for joint, indices in known.items()}
    limbs: Limbs = find_limbs(tree, self.at)
    self.label, self.lacking = limbs.label, dict(limbs.missing)
    for joint, index in limbs.joints.items():
      self._take(joint, index)
    if not self.lacking:
      self.leg = np.median([self._length(f"{side}_{a}", f"{side}_{b}") for side in SIDES for a, b in (
          ("hip", "knee"), ("knee", "ankle"))]) * 2
      self._trunk()
    if not self.lacking:
      for side in SIDES:
        self._collar(side)
        self._toes(side)

  def _take(self, joint, index):
    self.joints[joint], self.at[joint] = self.positions[:, index], index

  def _length(self, a, b):
    return np.median(np.linalg.norm(self.joints[a] - self.joints[b], axis=-1))

  def _apart(self, a, b):
    """Whether two joints of the file do not coincide."""
    return np.median(np.linalg.norm(self.positions[:, a] - self.positions[:, b], axis=-1)) > _COINCIDENT * self.leg

  def _fork(self, joint):
    """Lowest common ancestor of a left and right joint."""
    left, right = (self.at[f"{side}_{joint}"] for side in SIDES)
    return None if left is None or right is None else self.tree.fork(left, right)

  # --- pelvis, spine, neck, head ---------------------------------------------------------------------------------

  def _trunk(self):
    joints, pelvis, chest = self.joints, self._fork("hip"), self._fork("shoulder")
    if "pelvis" not in joints and pelvis is not None:
      self._take("pelvis", pelvis)
    if chest is None:  # points of a table or markers, without a tree: identified by name alone
      for joint, names in _MARKERS.items():
        at = next((self.tree.index[name] for name in names if name in self.tree.index), None)
        if joint not in joints and at is not None:
          self._take(joint, at)
    line = self._spine_and_head(pelvis, chest)
    if "head" not in joints:
      if not line:
        self.lacking["head"] = "head"
        return
      self._take("head", line[-1])
    necks = [joint for joint in line[:-1] if "neck" in self.tree.keys[joint]]
    after = [joint for joint in line[:-1] if chest in self.tree.line(joint)[:-1]]
    neck = next(iter(necks or after), None)
    if "neck" not in joints:
      if neck is not None:
        self._take("neck", neck)
      else:
        middle = (joints["left_shoulder"] + joints["right_shoulder"]) / 2
        joints["neck"] = middle + (joints["head"] - middle) / 4
    spines = line[:line.index(neck)] if neck in line else line[:-1]
    self._spine([self.positions[:, joint] for joint in spines])

  def _spine_and_head(self, pelvis, chest):
    """Joints of the file from above the pelvis to the head, coincident ones once."""
    if pelvis is None or chest is None:
      return []
    arms = [self.at[f"{side}_shoulder"] for side in SIDES]
    head = self.at.get("head")
    if head is None:
      above = [bone for level in self.tree.below(chest, arms) for bone in level]
      heads, necks = ([bone for bone in above if word in self.tree.keys[bone]] for word in ("head", "neck"))
      if not heads and not necks:
        return []
      head = heads[0] if heads else necks[-1]  # the neck's End Site is the top of such a head
    below = self.tree.line(pelvis)
    line, last = [], pelvis
    for joint in self.tree.line(head):
      if joint not in below and (self._apart(joint, last) or joint == head):
        line.append(joint)
        last = joint
    return line

  def _spine(self, spines):
    """Sets the spine joints: the file's three, or points at HumanML3D's heights on the line from hips to neck."""
    joints = self.joints
    hips = (joints["left_hip"] + joints["right_hip"]) / 2
    up = rot.unit(joints["neck"] - hips)
    rise = np.median(((joints["pelvis"] - hips) * up).sum(-1)) if "pelvis" in joints else 0
    level = "pelvis" not in self.own and rise < _LEVEL * self.leg
    if not level and len(spines) == 3:
      for joint, place in zip(_SPINE, spines):
        joints.setdefault(joint, place)
      return
    above = [place for place in spines if np.median(((place - hips) * up).sum(-1)) > max(rise, 0)]
    heights = _TRUNK if level else _TRUNK - _TRUNK[0]
    curve = [hips if level else joints["pelvis"], *above, joints["neck"]]
    places = dict(zip(("pelvis", *_SPINE), _along(curve, heights / heights[-1])))
    if level:
      joints["pelvis"] = places["pelvis"]
    for joint in _SPINE:
      joints.setdefault(joint, places[joint])

  # --- collars and toes ------------------------------------------------------------------------------------------

  def _collar(self, side):
    """Sets a collar: the first joint from the chest to a shoulder that is off the middle, else a point as in SMPL.

    Many rigs attach both arms to one point or to the spine and have no collars. Computed collars turn with the chest:
    shrugs and raised arms do not move them.
    """
    joints, joint = self.joints, f"{side}_collar"
    if joint in joints or "spine3" not in joints:
      return
    shoulder, chest = self.at[f"{side}_shoulder"], self._fork("shoulder")
    way = [] if chest is None or shoulder is None else self.tree.line(shoulder)[len(self.tree.line(chest)):-1]
    way = [bone for bone in way if not self.tree.names[bone].startswith("__")]
    if way and self._apart(way[0], shoulder) and self._aside(way[0], side) > _ASIDE:
      self._take(joint, way[0])
    else:
      base = joints["spine3"] + 0.39 * (joints["neck"] - joints["spine3"])
      joints[joint] = self._fixed(base + 0.39 * (joints[f"{side}_shoulder"] - base), chest)

  def _fixed(self, points, index):
    """Points (T, 3) at their median position in the local frame of a joint of the file; unchanged without rotations."""
    if self.turned is None or index is None:
      return points
    turn, origin = self.turned[:, index], self.positions[:, index]
    return origin + rot.rotate(turn, np.median(rot.rotate(rot.conjugate(turn), points - origin), axis=0)[None])

  def _aside(self, index, side):
    """Sideways position of a joint: 0 in the middle of the body, 1 at the shoulder."""
    left, right = self.joints["left_shoulder"], self.joints["right_shoulder"]
    half = (left - right) / 2 * (1 if side == "left" else -1)
    off = self.positions[:, index] - (left + right) / 2
    return np.median((off * half).sum(-1) / np.maximum((half * half).sum(-1), 1e-12))

  def _toes(self, side):
    """Sets the toes: joints of that name below the ankle, else the foot's End Site, else `_made_toes`."""
    joint, ankle, knee = f"{side}_foot", self.joints[f"{side}_ankle"], self.joints[f"{side}_knee"]
    if joint in self.joints:
      return
    shin, index = rot.unit(ankle - knee), self.at[f"{side}_ankle"]
    ends: list[int] = []
    for level in itertools.islice(self.tree.below(index), 3) if index is not None else ():
      names = {i: self.tree.names[i] for i in level}
      ends = ends or [i for i in level if names[i].endswith("_end")]
      toes = [i for i in level if any(word in self.tree.keys[i] for word in _TOES) and "heel" not in self.tree.keys[i]
              and not names[i].endswith("_end")]
      foot = self.positions[:, toes].mean(1) - ankle if toes else np.zeros_like(ankle)
      if np.median(np.linalg.norm(foot, axis=-1)) > _SHORTEST * self.leg:
        self.joints[joint] = ankle + foot
        return
    if ends:
      foot = self.positions[:, ends].mean(1) - ankle
      across = foot - shin * (foot * shin).sum(-1, keepdims=True)
      if np.median(np.linalg.norm(across, axis=-1)) > _SHORTEST * self.leg:
        self.joints[joint] = ankle + foot
        return
    self.joints[joint] = self._made_toes(ankle, shin, index)

  def _made_toes(self, joint, shin, ankle):
    """Toes (T, 3) ahead of an ankle in the direction of the hips; fixed to the ankle if the file has rotations."""
    joints = self.joints
    hips = joints["left_hip"] - joints["right_hip"]
    trunk = joints["neck"] - (joints["left_hip"] + joints["right_hip"]) / 2
    ahead = np.cross(hips, trunk)
    ahead = rot.unit(ahead - shin * (ahead * shin).sum(-1, keepdims=True))
    down, length = (part * self.leg for part in _FOOT)
    return self._fixed(joint + ahead * length + shin * down, ankle)


def _along(curve: list[Float[np.ndarray, "t 3"]], parts: Float[np.ndarray, " n"]) -> list[Float[np.ndarray, "t 3"]]:
  """Points at relative arc lengths (N,) of a polyline through points (T, 3), by its median segment lengths."""
  bones = [np.median(np.linalg.norm(b - a, axis=-1)) for a, b in zip(curve[:-1], curve[1:])]
  ends = np.cumsum([0, *bones])
  points = []
  for part in parts:
    at = part * ends[-1]
    i = int(np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(bones) - 1))
    weight = (at - ends[i]) / max(bones[i], 1e-12)
    points.append(curve[i] + weight * (curve[i + 1] - curve[i]))
  return points
