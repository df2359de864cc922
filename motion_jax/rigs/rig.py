"""Rigs of other programs: names, tree, unit and rest pose, one JSON file each, for all that writes or reads skeletons.

A file names the trunk from pelvis to head, a leg and an arm, "+" standing for the side. Below each name stands the
joint of HumanML3D's 22 that is in its place: "-" is a joint in between, which keeps still, "end" the tip of a chain.
"turn_with" names joints that turn with another one than that in whose place they are, where a rig has fewer.
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
  """N joints, parents before children.

  joints: {joint of the skeleton: number here}; between: (N,) for a joint of no place of its own (joint before, joint
  after, share of the way), for a tip (joint before, None, 0); rest: "T" or "A"; unit: metres per unit of its files;
  turn_with: {number here: joint of the skeleton that it turns with, another than the one in whose place it is}.
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
    """Where the joints (N, 3) are in a T-pose of the skeleton's offsets (J, 3), the pelvis at the origin."""
    ours = np.zeros_like(offsets)
    for chain in skeleton.chains:
      for parent, joint in zip(chain[:-1], chain[1:]):
        ours[joint] = ours[parent] + offsets[joint]
    at = {name: ours[j] for j, name in enumerate(skeleton.joints)}
    of = {number: name for name, number in self.joints.items()}
    found = np.zeros((len(self.names), 3))
    for number, place in enumerate(self.between):
      if number in of:
        found[number] = at[of[number]]
      elif place is not None:
        before, after, share = place
        found[number] = at[before] + (tip(before) if after is None else share * (at[after] - at[before]))
    return found

  def followed(self, skeleton: Skeleton = HUMANML3D) -> list[int]:
    """The joint of the skeleton with which each of the N joints turns; -1 for a root that does not."""
    of = {number: skeleton.joints.index(name) for name, number in self.joints.items()}
    of |= {number: skeleton.joints.index(name) for number, name in self.turn_with.items()}
    return [of.get(number, -1 if place is None else skeleton.joints.index(place[0]))
            for number, place in enumerate(self.between)]

  def arm_rest(self, skeleton: Skeleton = HUMANML3D) -> Float[np.ndarray, "j 4"]:
    """How each joint of the skeleton (J, 4) is turned in this rig's rest pose, seen from a T-pose."""
    turned = np.tile([1.0, 0, 0, 0], (skeleton.num_joints, 1))
    if self.rest == "A":
      for j, name in enumerate(skeleton.joints):
        if name.endswith(("shoulder", "elbow", "wrist")):
          turned[j] = rot.about_axis(np.array(-_A_POSE * side_and_kind(name)[0]), "z")
    return turned


def tip(joint: str) -> Float[np.ndarray, " 3"]:
  """From a joint to the end of its limb in a T-pose, metres."""
  side, kind = side_and_kind(joint)
  return np.array(TIPS.get(kind, (0, 0.05, 0))) * [side or 1, 1, 1]


def of_skeleton(skeleton: Skeleton) -> Rig:
  """The rig that a skeleton is by itself, in centimetres."""
  count = skeleton.num_joints
  return Rig(skeleton.name, skeleton.name, (), skeleton.joints, skeleton.parents,
             {name: j for j, name in enumerate(skeleton.joints)}, (None,) * count)


@functools.cache
def all_rigs() -> dict[str, Rig]:
  """{name: rig} of all rigs, by name."""
  found = {path.stem: _read(path) for path in _FOLDER.glob("*.json")}
  found[KIT.name] = of_skeleton(KIT)._replace(title="KIT-ML, 21 joints", aliases=("kit-ml",))
  return dict(sorted(found.items()))


def get_rig(name: str) -> Rig:
  """A rig by its name or another name of it. Raises InputError that lists them."""
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
    """Adds the joints `numbers` of a chain, all by default; ours: what stands in the places of its words."""
    own = [i for i, joint in enumerate(ours) if joint not in ("-", "end")]
    for i in numbers or range(len(words)):
      place: tuple[str, str | None, float] | None = None
      if i not in own:
        first, after = max((j for j in own if j < i), default=None), next((j for j in own if j > i), None)
        if first is None:  # a limb that begins where it hangs
          place = ("pelvis", "pelvis", 0.0)
        else:
          place = (side + ours[first], None, 0.0) if after is None else (
              side + ours[first], side + ours[after], (i - first) / (after - first))
      parent = at[words[i]] = add(words[i], parent, place)
      if i in own:
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
