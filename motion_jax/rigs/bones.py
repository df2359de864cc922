"""Identify the bones of a character's limbs, spine and neck by their names and their tree.

Motions have 22 joints; a character may have two bones in its neck, five in its spine or no collars.
"""
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.motion.skeleton import SIDES
from motion_jax.rigs.joint_maps import check_mapped_joints, rig_of, template
from motion_jax.rigs.joint_names import LIMBS, Tree, plain
from motion_jax.rigs.named_bodies import NamedBody
from motion_jax.shapes import Float
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import named

LIMB_JOINTS = tuple(f"{side}_{joint}" for ours, _ in LIMBS for side in SIDES for joint in ours)
_NUMBERED = re.compile(r"_\d+$")  # Sketchfab numbers all nodes


class Bones(NamedTuple):
  """Indices of bones in the arguments of `find_bones`."""
  limbs: dict[str, int]      # pelvis and head; of each side hip, knee, ankle, shoulder, elbow, wrist; collar and foot
  #                            (toes) if there are any
  spine: tuple[int, ...]     # from above the pelvis to the chest
  neck: tuple[int, ...]      # from above the chest to below the head
  label: str                 # the program whose names they are


def find_bones(names: Sequence[str], parents: Sequence[int], places: Float[np.ndarray, "n 3"],
               mapping: Mapping[str, str | list[str]] | None = None, known: Mapping[str, int] | None = None) -> Bones:
  """Finds the bones of a body among N bones with names (N,), parents (N,) and rest positions (N, 3).

  mapping: {joint of HumanML3D: bone's name}; omitted joints are found by name. known: {joint: index} stated by the file
  itself. Raises InputError for missing bones, or a mapping that names a bone twice.
  """
  names = [_NUMBERED.sub("", name) for name in names] if _are_numbered(names) else list(names)
  tree = Tree(names, parents)
  known_bones = {joint: [bone] for joint, bone in (known or {}).items()} | _mapped(tree, names, mapping or {})
  rig = None if known_bones else rig_of(names)
  if rig is not None:
    index = {plain(name): i for i, name in reversed(list(enumerate(names)))}
    known_bones = {joint: [index[plain(rig.names[number])]] for joint, number in rig.joints.items()}
  body = NamedBody(tree, np.asarray(places, np.float64)[None], None, known_bones)
  bones = {joint: at for joint, at in body.at.items() if at is not None}
  lacking = [joint for joint in ("pelvis", "head", *LIMB_JOINTS) if joint not in bones]
  if lacking:
    raise InputError(_refusal(body, lacking, names))
  for side in SIDES:
    if f"{side}_foot" not in bones:
      toes = _toes(tree, bones[f"{side}_ankle"])
      if toes is not None:
        bones[f"{side}_foot"] = toes
  chest = tree.fork(bones["left_shoulder"], bones["right_shoulder"])
  for part in ("collar", "foot"):
    pair = [f"{side}_{part}" for side in SIDES]
    if part == "collar":
      for side, joint in zip(SIDES, pair):
        above = tree.parents[bones[f"{side}_shoulder"]]
        if joint not in bones and above != chest:
          bones[joint] = above
  line = tree.line(bones["head"])[:-1]
  line = line[line.index(bones["pelvis"]) + 1:] if bones["pelvis"] in line else []
  end = line.index(chest) + 1 if chest in line else 0
  if "neck" in bones and bones["neck"] in line:
    end = line.index(bones["neck"])
  return Bones(bones, tuple(line[:end]), tuple(line[end:]), rig.title if rig else body.label or "its own names")



def _mapped(tree, names, mapping):
  """{our joint: [bone]} of a mapping of names."""
  check_mapped_joints(mapping)
  several = [joint for joint, entry in mapping.items() if not isinstance(entry, str) and len(entry) != 1]
  if several:
    raise InputError(f"the mapping gives {several[0]} several bones, expected the one that turns it")
  bones = {joint: tree.find(entry if isinstance(entry, str) else entry[0]) for joint, entry in mapping.items()}
  absent = [str(mapping[joint]) for joint, bone in bones.items() if bone is None]
  if absent:
    raise InputError(f"the mapping names the bones {named(sorted(absent))}; the file has {named(names)}")
  for joint, bone in bones.items():
    twice = [other for other, index in bones.items() if index == bone and other != joint]
    if twice:
      raise InputError(f"the mapping gives the bone {names[bone]!r} to {joint} and to {twice[0]}, expected one of them")
  return {joint: [bone] for joint, bone in bones.items()}


def _are_numbered(names):
  """Whether almost all names end in different numbers."""
  ends = [match.group() for match in map(_NUMBERED.search, names) if match]
  return len(ends) > 0.8 * len(names) and len(set(ends)) > 0.8 * len(ends)


def _toes(tree, ankle):
  """The first bone below an ankle that is named as toes, or None."""
  for level in tree.below(ankle):
    toes = [bone for bone in level if any(word in tree.keys[bone] for word in ("toe", "ball", "forefoot"))
            and "end" not in tree.keys[bone]]
    if toes:
      return toes[0]
  return None


def _refusal(body, lacking, names):
  """Error message: missing joints, the program with the most similar names, and the mapping file to write."""
  nearest = f"its bones are nearest to those of {body.label}" if body.label else "its bones are of no rig known here"
  words = [f'{joint} ("{body.lacking[joint]}")' if joint in body.lacking else joint for joint in lacking]
  return (f"{nearest}, without {named(words, 12)}; it has {named(names)}. Fill in a JSON file {template(lacking)} with "
          "its names and give it by --character-mapping FILE.json (mapping=)")
