"""Map the joints of a file to HumanML3D's 22: exact tables for some skeletons, joint names for all others.

An entry of a table is a name, a list of names to average, or a `Derived` joint for one that the other skeleton lacks
(the SMPL pelvis is higher than most hips, for example). All other files are read by `joint_names` and `named_bodies`.
"""
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D, SKELETONS, Skeleton
from motion_jax.rigs.joint_names import Tree, plain
from motion_jax.rigs.named_bodies import NamedBody
from motion_jax.rigs.rig import Rig, all_rigs
from motion_jax.shapes import Array, Float, Num
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import named, shortened


class Derived(NamedTuple):
  """A joint computed from the joints of a file: make(Source) -> (T, 3)."""
  needs: tuple[str, ...]
  make: Callable[["Source"], np.ndarray]


Entry = str | list[str] | Derived


class Source:
  """Joints of a file by name: `s["Hips"]` is (T, 3)."""

  def __init__(self, names: Sequence[str], positions: Num[np.ndarray, "t n 3"],
               turned: Num[np.ndarray, "t n 4"] | None = None) -> None:
    self.index: dict[str, int] = {}
    for i, name in enumerate(names):
      self.index.setdefault(plain(name), i)
    self.positions, self.turned = positions, turned

  def __contains__(self, name: str) -> bool:
    return plain(name) in self.index

  def __getitem__(self, name: str) -> Float[np.ndarray, "t 3"]:
    return self.positions[:, self.index[plain(name)]]

  def length(self, a: str, b: str) -> float:
    """Distance between two joints, median over the clip."""
    return np.median(np.linalg.norm(self[a] - self[b], axis=-1))

  def between(self, a: str, b: str, part: float) -> Float[np.ndarray, "t 3"]:
    """Linear interpolation from joint a (part 0) to joint b (part 1)."""
    return self[a] + part * (self[b] - self[a])

  def turn(self, name: str) -> Num[np.ndarray, "t 4"]:
    if self.turned is None:
      raise ValueError(f"this table needs the rotation of joint {name!r}, got positions only; give map_joints turned=, "
                       "or a mapping of names")
    return self.turned[:, self.index[plain(name)]]

  def at(self, name: str, offset: Sequence[float] | np.ndarray) -> Float[np.ndarray, "t 3"]:
    """Point at an offset (3,) or (T, 3) in the local frame of a joint."""
    return self[name] + rot.rotate(self.turn(name), np.asarray(offset, np.float64))


def _sided(middle, left, swap):
  """A table from the entries of the trunk and of the left side; swap turns a left name into a right one."""
  right = {}
  for joint, entry in left.items():
    other = [swap(name) for name in entry] if isinstance(entry, list) else swap(entry)
    right["right" + joint[4:]] = other
  return middle | left | right


def _asf_side(left):
  """CMU's ASF/AMC. Offsets scale with the left leg; collars are lower and closer to the neck than clavicles."""
  s, name = ("l", "left") if left else ("r", "right")
  leg = lambda f: f.length("lhipjoint", "lfemur") + f.length("lfemur", "ltibia")
  legs = ("lhipjoint", "lfemur", "ltibia")

  def collar(f):
    local = rot.rotate(rot.conjugate(f.turn("thorax")), f[s + "clavicle"] - f["thorax"])
    return f.at("thorax", local * [0.37, 1, 0.37] - np.array([0, 0.05487, 0]) * leg(f))

  def wrist(f):  # CMU's wrist bone extends into the hand
    along = rot.unit(f[s + "radius"] - f[s + "humerus"])
    return f[s + "humerus"] + 0.95 * f.length(s + "clavicle", s + "humerus") * along

  return {f"{name}_hip": s + "hipjoint", f"{name}_knee": s + "femur", f"{name}_ankle": s + "tibia",
          f"{name}_foot": s + "foot", f"{name}_shoulder": s + "clavicle", f"{name}_elbow": s + "humerus",
          f"{name}_collar": Derived(("thorax", s + "clavicle", *legs), collar),
          f"{name}_wrist": Derived((s + "radius", s + "humerus", s + "clavicle"), wrist)}, leg, legs


def _cmu_asf():
  left, leg, legs = _asf_side(True)
  up = lambda f, joint, part: rot.rotate(f.turn(joint), np.array([0, part, 0]) * leg(f))
  return left | _asf_side(False)[0] | {
      "pelvis": Derived(("root", "lhipjoint", "rhipjoint", *legs),
                     lambda f: f.between("lhipjoint", "rhipjoint", 0.5) + up(f, "root", 0.1061)),
      "spine1": "lowerback", "spine2": "upperback",
      "spine3": Derived(("upperback", "thorax", *legs), lambda f: f["upperback"] + up(f, "thorax", 0.0683)),
      "neck": ["lowerneck", "upperneck"],
      "head": Derived(("upperneck", "head", *legs), lambda f: f.between("upperneck", "head", 0.5) +
                   rot.rotate(f.turn("head"), np.array([0, 0, 0.05487]) * leg(f)))}


def _cmu_bvh():
  """CMU's BVH files by B. Hahne (cgspeed), Daz-friendly; offsets in centimetres of its figure, whose thigh is 36.8272.
  """
  unit = lambda f: f.length("lThigh", "lShin") / 36.8272
  at = lambda joint, *offset: Derived((joint, "lThigh", "lShin"), lambda f: f.at(joint, np.array(offset) * unit(f)))
  table = {"pelvis": at("hip", 0, 11.3, -1.0), "spine1": at("abdomen", 0, 1.5, 0), "spine2": at("chest", 0, 2.5, 0),
           "spine3": at("chest", 0, 8.0, -0.8), "neck": "neck", "head": at("head", 0.24, 1.5, 0)}
  for name, s, sign in (("left", "l", 1), ("right", "r", -1)):
    table |= {f"{name}_hip": s + "Thigh", f"{name}_knee": s + "Shin", f"{name}_ankle": s + "Foot",
              f"{name}_foot": s + "Foot_end", f"{name}_collar": at("chest", sign * 5.0, 13.5, -2.4),
              f"{name}_shoulder": s + "Shldr", f"{name}_elbow": s + "ForeArm",
              # The figure's hand is bent forward from the line of the forearm.
              f"{name}_wrist": at(s + "ForeArm", sign * 23.61, -1.43, 0.41)}
  return table


_BANDAI = _sided(
    {"pelvis": Derived(("Hips", "Spine"), lambda f: f.between("Hips", "Spine", 0.40036)), "spine1": "Spine",
     "spine2": "Chest", "spine3": Derived(("Chest", "Neck"), lambda f: f.between("Chest", "Neck", 0.24424)),
     "neck": "Neck", "head": "Head"},
    {"left_hip": "UpperLeg_L", "left_knee": "LowerLeg_L", "left_ankle": "Foot_L", "left_foot": "Toes_L",
     "left_collar": "Shoulder_L", "left_shoulder": "UpperArm_L", "left_elbow": "LowerArm_L", "left_wrist": "Hand_L"},
    lambda name: name[:-1] + "R")

_to_right = lambda name: name.replace("L_", "R_")

TABLES: dict[str, Mapping[str, Entry]] = {
    "cmu_asf": _cmu_asf(),
    "cmu_bvh": _cmu_bvh(),
    "bandai": _BANDAI,
    "smpl": _sided({"pelvis": "Pelvis", "spine1": "Spine1", "spine2": "Spine2", "spine3": "Spine3", "neck": "Neck",
                    "head": "Head"},
                   {f"left_{ours}": f"L_{theirs}" for ours, theirs in (
                       ("hip", "Hip"), ("knee", "Knee"), ("ankle", "Ankle"), ("foot", "Foot"), ("collar", "Collar"),
                       ("shoulder", "Shoulder"), ("elbow", "Elbow"), ("wrist", "Wrist"))}, _to_right),
    "humanml3d": {joint: joint for joint in HUMANML3D.joints},
}


def map_joints(names: Sequence[str], positions: Num[Array, "t n 3"], mapping: str | Mapping[str, Entry] | None = None,
               turned: Num[np.ndarray, "t n 4"] | None = None, parents: Sequence[int] | None = None
               ) -> tuple[Float[np.ndarray, "t 22 3"], str]:
  """Selects HumanML3D's 22 joints from a file's: positions (T, N, 3) -> (joints (T, 22, 3), name of the table used).

  mapping: a key of TABLES, a rig's name, a dict {our joint: their joint or a list to average}, or None to identify
  joints by name. Joints that a dict omits are found by name and by the tree of parents (N,) (-1 for a root). turned
  (T, N, 4): world rotations of the joints, needed by the CMU tables. Raises ValueError that lists the missing joints
  and those of the file.
  """
  source = Source(names, np.asarray(positions, np.float64), turned)
  if isinstance(mapping, str):
    if mapping in TABLES:
      return _by_table(source, names, mapping), mapping
    known = {word: rig for rig in all_rigs().values() for word in (rig.name, *rig.aliases)}
    if mapping not in known:
      raise ValueError(f"got mapping {shortened(mapping)!r}, expected one of "
                       f"{', '.join(dict.fromkeys([*TABLES, *known]))}, or a dict of joint names")
    named_rig = known[mapping]
    mapping = {joint: named_rig.names[number] for joint, number in named_rig.joints.items()}
  label = None if mapping else table_of(source)
  if label:
    return _by_table(source, names, label), label
  rig = None if mapping else rig_of(names)
  if rig is not None and _raised(source, rig):
    return np.stack([source[rig.names[rig.joints[joint]]] for joint in HUMANML3D.joints], axis=1), rig.title
  return _by_names(source, names, mapping or {}, parents)


def table_of(source: Source) -> str:
  """Key of the first table whose joints a file has completely, or ""."""
  for label, table in TABLES.items():
    if all(name in source for entry in table.values() for name in _needs(entry)):
      # In BVH files converted from ASF skeletons joints are at the start of bones, not at their end.
      if label == "cmu_asf" and not source.length("root", "lhipjoint") > 1e-6:
        continue
      # Bandai's files have the pelvis between the hips; files that this library writes for the rig have it above them.
      if label == "bandai" and "joint_Root" in source and _raised(source, all_rigs()["bandai"]):
        continue
      return label
  return ""


def rig_of(names: Sequence[str]) -> Rig | None:
  """The largest rig with intermediate joints whose names a file has completely, or None.

  Rigs without intermediate joints are identified by `joint_names`, with and without prefixes.
  """
  keys = {plain(name) for name in names}
  candidates = [rig for rig in all_rigs().values() if len(rig.names) > len(rig.joints) == HUMANML3D.num_joints
           and keys >= set(map(plain, rig.names))]
  return max(candidates, key=lambda rig: len(rig.names), default=None)


def _raised(source, rig):
  """Whether the pelvis is above the hips, as in HumanML3D; otherwise `NamedBody` places it and the spine."""
  at = {joint: rig.names[number] for joint, number in rig.joints.items()}
  hips = source.between(at["left_hip"], at["right_hip"], 0.5)
  leg = source.length(at["left_hip"], at["left_knee"]) + source.length(at["left_knee"], at["left_ankle"])
  return np.median(np.linalg.norm(source[at["pelvis"]] - hips, axis=-1)) > 0.05 * leg


def skeleton_of(names: Sequence[str]) -> Skeleton:
  """The skeleton with exactly these joint names, ignoring End Sites; HumanML3D if there is none."""
  keys = {plain(name) for name in names if not name.endswith("_end")}
  return next((skeleton for skeleton in SKELETONS.values() if keys == set(map(plain, skeleton.joints))),
              HUMANML3D)


def own_joints(names: Sequence[str], positions: Num[Array, "t n 3"], skeleton: Skeleton
               ) -> Float[np.ndarray, "t j 3"]:
  """A skeleton's joints (T, J, 3) from a file with the skeleton's joint names."""
  source = Source(names, np.asarray(positions, np.float64))
  return np.stack([source[joint] for joint in skeleton.joints], axis=1)


def check_mapped_joints(mapping: Mapping[str, Any]) -> None:
  """Raises InputError for keys of a mapping that are no joints of HumanML3D."""
  foreign = [joint for joint in mapping if joint not in HUMANML3D.joints]
  if foreign:
    raise InputError(f"the mapping names {named(foreign)}, expected our joints {', '.join(HUMANML3D.joints)}")


def template(lacking: Sequence[str]) -> str:
  """A mapping file to fill in, as JSON."""
  return "{" + ", ".join(f'"{joint}": "..."' for joint in lacking) + "}"


def _by_table(source, names, label):
  table = TABLES[label]
  missing = sorted({name for entry in table.values() for name in _needs(entry) if name not in source})
  if missing:
    raise ValueError(f"mapping {label!r} needs the joints {named(missing)}; the file has {named(names)}")
  return np.stack([_place(source, table[joint]) for joint in HUMANML3D.joints], axis=1)


def _by_names(source, names, mapping, parents):
  check_mapped_joints(mapping)
  tree = Tree(names, parents)
  indices = {joint: {name: tree.find(name) for name in _needs(entry)} for joint, entry in mapping.items()}
  absent = [name for places in indices.values() for name, index in places.items() if index is None]
  if absent:
    raise ValueError(f"the mapping names the joints {named(sorted(absent))}; the file has {named(names)}")
  mapped = {joint: [index for index in places.values() if index is not None] for joint, places in indices.items()}
  body = NamedBody(tree, source.positions, source.turned, mapped)
  lacking = [joint for joint in HUMANML3D.joints if joint not in body.joints]
  if lacking:
    raise ValueError(_refusal(body, lacking, names))
  label = "own" if mapping else body.label
  return np.stack([body.joints[joint] for joint in HUMANML3D.joints], axis=1), label


def mapping_template(names: Sequence[str], positions: Num[Array, "t n 3"], parents: Sequence[int] | None = None
                     ) -> tuple[dict[str, str], str]:
  """A mapping to complete, {our joint: the file's joint, "" if unknown}, and the program with the nearest names."""
  source = Source(names, np.asarray(positions, np.float64))
  label = table_of(source)
  named_once = {joint: entry for joint, entry in TABLES.get(label, {}).items() if isinstance(entry, str)}
  if len(named_once) == HUMANML3D.num_joints:
    return {joint: names[source.index[plain(entry)]] for joint, entry in named_once.items()}, label
  rig = rig_of(names)
  if rig is not None:
    name_of = {plain(name): name for name in reversed(names)}
    return {joint: name_of[plain(rig.names[rig.joints[joint]])] for joint in HUMANML3D.joints}, rig.title
  body = NamedBody(Tree(names, parents), source.positions, None, {})
  indices = {joint: body.at.get(joint) for joint in HUMANML3D.joints}
  return {joint: "" if index is None else names[index] for joint, index in indices.items()}, body.label


def _refusal(body, lacking, names):
  """Error message: missing joints, the program with the most similar names, and the mapping file to write."""
  wanted = [joint for joint in HUMANML3D.joints if joint in body.lacking] or lacking
  if body.label:
    missing = [f'{joint} ("{body.lacking[joint]}")' if joint in body.lacking else joint for joint in wanted]
    what = f"its joints are nearest to those of {body.label}, without {named(missing)}"
  else:
    what = "its joint names are of no skeleton that is known"
  return (f"{what}; the file has {named(names)}. Write a JSON file {template(wanted)} with the names that it has, and "
          "give it by --mapping FILE.json (mapping=); motion-jax rigs FILE --write-mapping FILE.json begins one")


def _needs(entry):
  if isinstance(entry, Derived):
    return entry.needs
  return (entry,) if isinstance(entry, str) else tuple(entry)


def _place(source, entry):
  if isinstance(entry, Derived):
    return entry.make(source)
  return np.mean([source[name] for name in _needs(entry)], axis=0)
