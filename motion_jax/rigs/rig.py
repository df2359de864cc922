"""Rigs of other programs, one JSON file each: names, tree, unit and rest pose, for readers and writers of skeletons.

A file names the trunk from pelvis to head, a leg and an arm, with "+" for the side. Each name has the corresponding
joint of HumanML3D's 22: "-" is an intermediate joint, which does not turn, "end" the tip of a chain. "turn_with" names
joints that turn with a joint other than the corresponding one, in rigs with fewer joints.
"""
import functools
import json
import pathlib
import types
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import TIPS
from motion_jax.motion.skeleton import HUMANML3D, KIT, SIDES, Skeleton, side_and_kind
from motion_jax.shapes import Float
from motion_jax.utils.errors import InputError
from motion_jax.utils.nearest import did_you_mean

_FOLDER = pathlib.Path(__file__).parent / "tables"
_A_POSE = np.radians(45)  # of the arms below the horizontal, in an A-pose


class Rig(NamedTuple):
  """A skeleton of another program: N joints, parents before children.

  joints: {joint of our skeleton: index here}; between (N,): for an intermediate joint (joint before, joint after, share
  of the distance), for a tip (joint before, None, 0), else None; rest: "T" or "A"; unit: metres per unit of its files;
  turn_with: {index here: joint of our skeleton that it turns with, if not the corresponding one}.
  """
  name: str
  title: str
  aliases: tuple[str, ...]
  names: tuple[str, ...]
  parents: tuple[int, ...]
  joints: dict[str, int]
  between: tuple[tuple[str, str | None, float] | None, ...]
  rest: str = "T"
  unit: float = 0.01
  turn_with: Mapping[int, str] = types.MappingProxyType({})

  def places(self, offsets: Float[np.ndarray, "j 3"], skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, "n 3"]:
    """Joint positions (N, 3) in a T-pose with the skeleton's offsets (J, 3), the pelvis at the origin."""
    ours = np.zeros_like(offsets)
    for chain in skeleton.chains:
      for parent, joint in zip(chain[:-1], chain[1:]):
        ours[joint] = ours[parent] + offsets[joint]
    at = {name: ours[j] for j, name in enumerate(skeleton.joints)}
    of = {number: name for name, number in self.joints.items()}
    places = np.zeros((len(self.names), 3))
    for number, place in enumerate(self.between):
      if number in of:
        places[number] = at[of[number]]
      elif place is not None:
        before, after, share = place
        places[number] = at[before] + (tip(before) if after is None else share * (at[after] - at[before]))
    return places

  def followed(self, skeleton: Skeleton = HUMANML3D) -> list[int]:
    """For each of the N joints the index of the skeleton's joint that it turns with; -1 for a root without one."""
    of = {number: skeleton.joints.index(name) for name, number in self.joints.items()}
    of |= {number: skeleton.joints.index(name) for number, name in self.turn_with.items()}
    return [of.get(number, -1 if place is None else skeleton.joints.index(place[0]))
            for number, place in enumerate(self.between)]

  def arm_rest(self, skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, "j 4"]:
    """Rotations (J, 4) of the skeleton's joints from a T-pose to this rig's rest pose."""
    turned = np.tile([1.0, 0, 0, 0], (skeleton.num_joints, 1))
    if self.rest == "A":
      for j, name in enumerate(skeleton.joints):
        if name.endswith(("shoulder", "elbow", "wrist")):
          turned[j] = rot.about_axis(np.array(-_A_POSE * side_and_kind(name)[0]), "z")
    return turned


def tip(joint: str) -> Float[np.ndarray, " 3"]:
  """Offset (3,) from a joint to the tip of its limb in a T-pose, metres."""
  side, kind = side_and_kind(joint)
  return np.array(TIPS.get(kind, (0, 0.05, 0))) * [side or 1, 1, 1]


def of_skeleton(skeleton: Skeleton) -> Rig:
  """A skeleton as a rig, in centimetres."""
  count = skeleton.num_joints
  return Rig(skeleton.name, skeleton.name, (), skeleton.joints, skeleton.parents,
             {name: j for j, name in enumerate(skeleton.joints)}, (None,) * count)


@functools.cache
def all_rigs() -> dict[str, Rig]:
  """All rigs, {name: rig}, sorted by name."""
  rigs = {path.stem: _read(path) for path in _FOLDER.glob("*.json")}
  rigs[KIT.name] = of_skeleton(KIT)._replace(title="KIT-ML, 21 joints", aliases=("kit-ml",))
  return dict(sorted(rigs.items()))


def get_rig(name: str) -> Rig:
  """A rig by its name or an alias. Raises InputError that lists the names."""
  for rig in all_rigs().values():
    if name.lower() in (rig.name, *rig.aliases):
      return rig
  known = [word for rig in all_rigs().values() for word in (rig.name, *rig.aliases)]
  raise InputError(f"got rig {name[:60]!r}{did_you_mean(name[:60], known)}, expected one of {', '.join(all_rigs())} "
                   "(motion-jax rigs says what each is)")


def _read(path):
  about = json.loads(path.read_text())
  names, parents, between, joints = [], [], [], {}

  def add(name, parent, place=None):
    names.append(name)
    parents.append(parent)
    between.append(place)
    return len(names) - 1

  def chain(words, ours, parent, side="", numbers=None):
    """Adds the joints `numbers` of a chain, by default all; ours: the corresponding joints of its words."""
    placed = [i for i, joint in enumerate(ours) if joint not in ("-", "end")]
    for i in numbers or range(len(words)):
      place: tuple[str, str | None, float] | None = None
      if i not in placed:
        first, after = max((j for j in placed if j < i), default=None), next((j for j in placed if j > i), None)
        if first is None:  # a limb that begins at its parent
          place = ("pelvis", "pelvis", 0.0)
        else:
          place = (side + ours[first], None, 0.0) if after is None else (
              side + ours[first], side + ours[after], (i - first) / (after - first))
      parent = at[words[i]] = add(words[i], parent, place)
      if i in placed:
        joints[side + ours[i]] = parent

  at: dict[str, int] = {}
  root = add(about["root"], -1) if about["root"] else -1
  row = lambda kind, side="": [about["prefix"] + word.replace("+", side) for word in about[kind].split()]
  kept = {kind: about[f"{kind}_joints"].split() for kind in ("trunk", "leg", "arm")}
  trunk = row("trunk")
  chain(trunk, kept["trunk"], root, numbers=[0])
  legs = joints["pelvis"]
  if about.get("legs_hang_on"):
    legs = at[about["legs_hang_on"]] = add(about["legs_hang_on"], legs, ("pelvis", "pelvis", 0.0))
  for word, side in zip(about["sides"], SIDES):
    chain(row("leg", word), kept["leg"], legs, f"{side}_")
  chain(trunk, kept["trunk"], joints["pelvis"], numbers=range(1, len(trunk)))
  for word, side in zip(about["sides"], SIDES):
    chain(row("arm", word), kept["arm"], at[about["prefix"] + about["arms_hang_on"]], f"{side}_")
  return Rig(path.stem, about["title"], tuple(about["aliases"]), tuple(names), tuple(parents), joints, tuple(between),
             about["rest"], about["unit"], {at[name]: joint for name, joint in about.get("turn_with", {}).items()})
