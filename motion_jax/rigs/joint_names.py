"""Identify joints by the names that many programs give them, and by their position in the tree.

Names are compared as words: `key` gives LeftUpLeg, UpLeg_L, lUpLeg and mixamorig:LeftUpLeg one spelling. Legs and arms
are found by the tables below, three names each, with any common prefix or suffix (Character1_, Bip01, _JNT). Pelvis,
spine, neck, head, collars and toes follow from the tree.
"""
import collections
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from motion_jax.motion.skeleton import SIDES

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\W\d_A-Za-z]+")
_GLUED_SIDE = re.compile(r"(?<![A-Za-z])([LR])(?=[A-Z][A-Za-z]*[a-z])")  # LHipJoint, LUArm
_SIDES = {"left": "left", "l": "left", "right": "right", "r": "right", "c": ""}
_MOST_AFFIXES = 12

# Names of hip, knee, ankle: programs that use them.
LEGS = {
    "upleg leg foot": "Mixamo, HumanIK",
    "hip knee ankle": "Xsens, Vicon, SMPL",
    "thigh shin foot": "Rigify, Poser, Rokoko",
    "thigh calf foot": "3ds Max, Unreal",
    "upperleg lowerleg foot": "Unity, VRM",
    "leg shin foot": "SOMA",
    "upleg loleg foot": "MakeHuman",
    "upleg lowleg foot": "mocopi",
    "upperleg1 lowerleg1 foot": "MakeHuman",
    "legupper1 leglower1 foot1": "SnapMoGen",
    "thighbend shin foot": "Daz Genesis",
    "femur tibia foot": "Acclaim",
    "hip knee foot": "MocapNET",
}
# Names of shoulder (start of the upper arm), elbow, wrist.
ARMS = {
    "arm forearm hand": "Mixamo, HumanIK",
    "shoulder elbow wrist": "Xsens, Vicon, SMPL",
    "upperarm forearm hand": "3ds Max, Rigify",
    "upperarm lowerarm hand": "Unreal, Unity, VRM",
    "shldr forearm hand": "Poser",
    "uarm farm hand": "OptiTrack",
    "uparm loarm hand": "MakeHuman",
    "uparm lowarm hand": "mocopi",
    "upperarm1 lowerarm1 wrist": "MakeHuman",
    "armupper1 armlower1 hand1": "SnapMoGen",
    "shldrbend forearmbend hand": "Daz Genesis",
    "humerus radius wrist": "Acclaim",
    "shoulder elbow hand": "MocapNET",
}
LIMBS = (("hip", "knee", "ankle"), LEGS), (("shoulder", "elbow", "wrist"), ARMS)


class Limbs(NamedTuple):
  """Result of `find_limbs`."""
  joints: dict[str, int]   # {our joint: index}
  label: str               # the programs whose names fit best
  missing: dict[str, str]  # {our joint: the word that those programs have for it}


def key(name: str) -> str:
  """Canonical spelling of a joint's name: its side, if any, then its words without punctuation, in lower case."""
  words = [str(int(word)) if word.isdecimal() else word.lower()
           for word in _WORDS.findall(_GLUED_SIDE.sub(r"\1 ", re.split(r"[:|]", name)[-1]))]
  side = next((_SIDES[word] for word in words if word in _SIDES), "")
  return f"{side} {''.join(word for word in words if word not in _SIDES)}".strip()


def plain(name: str) -> str:
  """A joint's name without punctuation, in lower case."""
  return re.sub(r"[-_ .]", "", name.split(":")[-1].lower())


class Tree:
  """The joints of a file by name and in their tree. parents: index of each parent, -1 for a root; None if unknown."""

  def __init__(self, names: Sequence[str], parents: Sequence[int] | None) -> None:
    self.names, self.is_known = list(names), parents is not None
    self.parents = [-1] * len(names) if parents is None else list(parents)
    self.keys = [key(name) for name in names]
    self.index: dict[str, int] = {}
    for i, name in enumerate(names):
      if not name.startswith("__"):  # MakeHuman's helpers, which share a joint's name
        self.index.setdefault(self.keys[i], i)
    self._children = collections.defaultdict(list)
    for i, parent in enumerate(self.parents):
      self._children[parent].append(i)

  def find(self, name: str) -> int | None:
    """Index of a joint by its exact name, else by its letters (`plain`), else by its words (`key`); or None."""
    for wanted, spellings in ((name, self.names), (plain(name), [plain(joint) for joint in self.names]),
                              (key(name), self.keys)):
      if wanted in spellings:
        return spellings.index(wanted)
    return None

  def line(self, joint: int) -> list[int]:
    """A joint and its ancestors, from the root down."""
    line = []
    while joint >= 0:
      line.append(joint)
      joint = self.parents[joint]
    return line[::-1]

  def below(self, joint: int, without: Sequence[int | None] = ()) -> Iterator[list[int]]:
    """Descendants of a joint by depth: its children, their children, ...; without some joints and their descendants."""
    level = [joint]
    while level := [child for joint_above in level for child in self._children[joint_above] if child not in without]:
      yield level

  def fork(self, a: int, b: int) -> int | None:
    """Lowest common ancestor of two joints, or None."""
    shared = [x for x, y in zip(self.line(a)[:-1], self.line(b)[:-1]) if x == y]
    return shared[-1] if shared else None

  def in_line(self, joints: Sequence[int]) -> bool:
    """Whether each joint is a descendant of the one before it; True if the tree is unknown."""
    return not self.is_known or all(above in self.line(joint)[:-1] for above, joint in zip(joints[:-1], joints[1:]))


def find_limbs(tree: Tree, known: Mapping[str, int | None]) -> Limbs:
  """Finds hips, knees, ankles, shoulders, elbows and wrists by the rows of the tables that fit best.

  known: {our joint: index, or None for a point between joints}, which are not looked for.
  """
  joints: dict[str, int] = {}
  labels: list[list[str]] = []
  missing: dict[str, str] = {}
  for ours, table in LIMBS:
    wanted = [f"{side}_{joint}" for side in SIDES for joint in ours]
    rows = [(_fit(tree, words.split(), affix), words.split(), label) for words, label in table.items()
            for affix in _affixes(tree, words.split())]
    matches, words, label = max(rows, key=lambda row: len(row[0]))  # the first of equals: tables begin with the usual
    places = dict(zip(wanted, [(side, word) for side in SIDES for word in words]))
    joints |= {joint: matches[place] for joint, place in places.items() if place in matches and joint not in known}
    missing |= {joint: place[1] for joint, place in places.items() if place not in matches and joint not in known}
    if matches:
      labels.append(label.split(", "))
  shared = [name for name in labels[0] if all(name in label for label in labels)] if labels else []
  return Limbs(joints, ", ".join(shared) or " and ".join(label[0] for label in labels), missing)


def _affixes(tree, words):
  """Pairs of prefix and suffix of a limb's words in this file: none, and the most frequent ones."""
  around: collections.Counter[tuple[str, str]] = collections.Counter()
  for spelling in tree.index:
    core = spelling.split()[-1] if spelling else ""
    for word in words:
      start = core.find(word)
      if start >= 0:
        around[core[:start], core[start + len(word):]] += 1
  return dict.fromkeys([("", ""), *(affix for affix, _ in around.most_common(_MOST_AFFIXES))])


def _fit(tree, words, affix):
  """{(side, word): index} of the words found with an affix; a side only if its joints form one chain."""
  matches: dict[tuple[str, str], int] = {}
  for side in SIDES:
    indices = [_sided(tree, side, affix[0] + word + affix[1]) for word in words]
    there = [index for index in indices if index is not None]
    if there and tree.in_line(there):
      matches |= {(side, word): index for word, index in zip(words, indices) if index is not None}
  return matches


def _sided(tree, side, core):
  """Index of a joint of one side, whatever its spelling of the side; or None."""
  for spelling in (f"{side} {core}", side + core, core + side, side[0] + core, core + side[0]):
    if spelling in tree.index:
      return tree.index[spelling]
  return None
