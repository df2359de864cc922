"""Which bones of a character are which parts of a body, by their names and their tree.

Motions know 22 joints; a character may have two bones in its neck, five in its spine or no collars. `find_bones` names
the one bone of every limb, and the bones of trunk and neck in their order.
"""
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.motion.skeleton import HUMANML3D, SIDES
from motion_jax.rigs.joint_maps import rig_of
from motion_jax.rigs.joint_names import LIMBS, Tree, plain
from motion_jax.rigs.named_bodies import NamedBody
from motion_jax.shapes import Float
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import named

LIMB_JOINTS = tuple(f"{side}_{joint}" for ours, _ in LIMBS for side in SIDES for joint in ours)
_NUMBERED = re.compile(r"_\d+$")  # Sketchfab numbers all nodes


class Bones(NamedTuple):
  """Numbers of bones in the lists that `find_bones` got."""
  limbs: dict[str, int]      # pelvis and head; of each side hip, knee, ankle, shoulder, elbow, wrist; collar and foot
  #                            (toes) where there are any
  spine: tuple[int, ...]     # from above the pelvis to the chest
  neck: tuple[int, ...]      # from above the chest to below the head
  label: str                 # whose names they are


def find_bones(names: Sequence[str], parents: Sequence[int], places: Float[np.ndarray, "n 3"],
               mapping: Mapping[str, str | list[str]] | None = None, known: Mapping[str, int] | None = None) -> Bones:
  """The bones of a body among N bones, of names (N,), parents (N,) and places at rest (N, 3).

  mapping: {joint of HumanML3D: bone's name}; what it leaves out is looked for by name. known: {joint: number} that the
  file itself states. Raises InputError that states what is missing, or that a mapping names a bone twice.
  """
  names = [_NUMBERED.sub("", name) for name in names] if _are_numbered(names) else list(names)
  tree = Tree(names, parents)
  own = {joint: [bone] for joint, bone in (known or {}).items()} | _mapped(tree, names, mapping or {})
  rig = None if own else rig_of(names)
  if rig is not None:
    index = {plain(name): i for i, name in reversed(list(enumerate(names)))}
    own = {joint: [index[plain(rig.names[number])]] for joint, number in rig.joints.items()}
  body = NamedBody(tree, np.asarray(places, np.float64)[None], None, own)
  found = {joint: at for joint, at in body.at.items() if at is not None}
  lacking = [joint for joint in ("pelvis", "head", *LIMB_JOINTS) if joint not in found]
  if lacking:
    raise InputError(_refusal(body, lacking, names))
  for side in SIDES:
    if f"{side}_foot" not in found:
      toes = _toes(tree, found[f"{side}_ankle"])
      if toes is not None:
        found[f"{side}_foot"] = toes
  chest = tree.fork(found["left_shoulder"], found["right_shoulder"])
  for part in ("collar", "foot"):
    pair = [f"{side}_{part}" for side in SIDES]
    if part == "collar":
      for side, joint in zip(SIDES, pair):
        above = tree.parents[found[f"{side}_shoulder"]]
        if joint not in found and above != chest:
          found[joint] = above
  line = tree.line(found["head"])[:-1]
  line = line[line.index(found["pelvis"]) + 1:] if found["pelvis"] in line else []
  end = line.index(chest) + 1 if chest in line else 0
  if "neck" in found and found["neck"] in line:
    end = line.index(found["neck"])
  return Bones(found, tuple(line[:end]), tuple(line[end:]), rig.title if rig else body.label or "its own names")


def template(lacking: Sequence[str]) -> str:
  """A mapping file to fill in, as JSON."""
  return "{" + ", ".join(f'"{joint}": "..."' for joint in lacking) + "}"


def _mapped(tree, names, mapping):
  """{our joint: [bone]} of a mapping's own names."""
  foreign = [joint for joint in mapping if joint not in HUMANML3D.joints]
  if foreign:
    raise InputError(f"the mapping names {named(foreign)}, expected our joints {', '.join(HUMANML3D.joints)}")
  several = [joint for joint, entry in mapping.items() if not isinstance(entry, str) and len(entry) != 1]
  if several:
    raise InputError(f"the mapping gives {several[0]} several bones, expected the one that turns it")
  found = {joint: tree.find(entry if isinstance(entry, str) else entry[0]) for joint, entry in mapping.items()}
  absent = [str(mapping[joint]) for joint, bone in found.items() if bone is None]
  if absent:
    raise InputError(f"the mapping names the bones {named(sorted(absent))}; the file has {named(names)}")
  for joint, bone in found.items():
    twice = [other for other, index in found.items() if index == bone and other != joint]
    if twice:
      raise InputError(f"the mapping gives the bone {names[bone]!r} to {joint} and to {twice[0]}, expected one of them")
  return {joint: [bone] for joint, bone in found.items()}


def _are_numbered(names):
  """Whether almost all names end in numbers of their own."""
  ends = [match.group() for match in map(_NUMBERED.search, names) if match]
  return len(ends) > 0.8 * len(names) and len(set(ends)) > 0.8 * len(ends)


def _toes(tree, ankle):
  """The bone of the toes: below an ankle the first that is named so, else an only child that has children."""
  for level in tree.below(ankle):
    toes = [bone for bone in level if any(word in tree.keys[bone] for word in ("toe", "ball", "forefoot"))
            and "end" not in tree.keys[bone]]
    if toes:
      return toes[0]
  return None


def _refusal(body, lacking, names):
  """What is missing, whose names are nearest, and the mapping file that helps."""
  nearest = f"its bones are nearest to those of {body.label}" if body.label else "its bones are of no rig known here"
  words = [f'{joint} ("{body.lacking[joint]}")' if joint in body.lacking else joint for joint in lacking]
  return (f"{nearest}, without {named(words, 12)}; it has {named(names)}. Fill in a JSON file {template(lacking)} with "
          "its names and give it by --character-mapping FILE.json (mapping=)")
