"""A rigged character of a glTF file: its bones by the parts of a body, at rest, in the frame and size of motions."""
import collections
import dataclasses
import functools
import re
import warnings

import numpy as np

from motion_jax.data.mocap.gltf import Document, Unreadable, take_apart
from motion_jax.data.mocap.gltf_motion import bones_of, joints_of, nearest
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D, SIDES
from motion_jax.rigs.bones import Bones, find_bones
from motion_jax.rigs.rig import get_rig
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import named

LEGS = HUMANML3D.bone_lengths[[4, 7, 5, 8]].sum() / 2  # thigh and shin, metres
_UPRIGHT = np.cos(np.radians(45))
_CROOKED = 0.1            # of a leg: how far a rest pose's left side may be from its right one, on average
_ANKLE = 0.08             # of a leg: the height of an ankle over its sole, where the mesh does not show it
_MOST_POINTS = 64         # of a sole
_SAME_PLACE = 0.01        # of the size of all bones: how far those of a second skeleton may be from the first one's
_UNEVEN = 0.02            # by which the scales of a bone may differ


@dataclasses.dataclass(frozen=True, eq=False)
class Figure:
  """A character's M bones in the frame of motions: y up, facing +z, legs as long as HumanML3D's, the floor at y = 0.

  To the file's world: frame.rotate(place) * scale + origin.
  """
  document: Document
  nodes: list[int]         # of each bone
  parts: dict[str, int]    # {joint of HumanML3D: bone}; spine and neck are those of `bones`
  bones: Bones             # spine and neck, as numbers of bones
  parents: list[int]       # the parent of each bone in a body, -1 for the pelvis; parents come first
  offsets: np.ndarray      # (M, 3) from that bone, in its turned frame
  turned: np.ndarray       # (M, 4) world rotations in the reference pose
  places: np.ndarray       # (M, 3) in the reference pose
  soles: dict[int, np.ndarray]  # {bone of a foot or of toes: points (P, 3) of its sole in its turned frame}
  out: np.ndarray          # (4,) rotation to the file's world
  scale: float
  origin: np.ndarray       # (3,)
  root: int | None         # the node of the bone that carries the whole body, above that of the pelvis
  copies: list[tuple[int, int]]  # (bone, node) of further skeletons that move with this one, such as those of clothes

  @property
  def about(self) -> str:
    """The bones that were recognized, in one line."""
    return (f"{len(self.nodes)} of its bones are moved, by the names of {self.bones.label}; its legs are "
            f"{self.scale * LEGS:.3g} long")


def read_figure(path, mapping=None) -> Figure:
  """The character of a .glb, .gltf or .vrm file.

  mapping: {joint of HumanML3D: bone's name} where names are not known. Raises InputError for a file without a skin, or
  with two bodies, for missing bones and mirrored ones.
  """
  document = Document(path)
  joints = joints_of(document)
  if not joints:
    raise InputError(f"{path}: it has no skin, so its mesh follows no bones; expected a rigged character, for instance "
                     "from Mixamo or VRoid")
  stated = _human_bones(document)
  bones = {*bones_of(document), *stated.values()} & document.shown
  nodes = [node for node in document.order if node in bones]
  rest = document.world(*document.rest())
  parents = [nearest(document, node, nodes) for node in nodes]
  names = [document.name(node) for node in nodes]
  find = lambda chosen, **how: find_bones([names[i] for i in chosen], [nearest(document, nodes[i], [
      nodes[k] for k in chosen]) for i in chosen], rest[[nodes[i] for i in chosen], :3, 3], **how)
  try:
    known = {joint: nodes.index(node) for joint, node in stated.items() if node in bones}
    match = find(range(len(nodes)), mapping=mapping, known=known)
  except InputError as error:
    raise InputError(f"{path}: {error}") from None
  copies = _copies(path, nodes, names, parents, rest, match, find)
  above = [node for node in _above(document, nodes[match.limbs["pelvis"]]) if node in joints]
  return _built(document, nodes, names, match, rest, above[-1] if above else None, copies)


def _above(document, node):
  """The nodes above a node, the next one first."""
  while (node := document.parents[node]) >= 0:
    yield node


def _human_bones(document):
  """{joint of HumanML3D: node} as VRM 1.0 and 0.x state it."""
  with document.checked():
    extensions = document.json.get("extensions", {})
    human = {}
    if "VRMC_vrm" in extensions:
      human = {bone: about["node"] for bone, about in extensions["VRMC_vrm"]["humanoid"]["humanBones"].items()}
    elif "VRM" in extensions:
      human = {about["bone"]: about["node"] for about in extensions["VRM"]["humanoid"]["humanBones"]}
    rig = get_rig("vrm")
    stated = {joint: human[rig.names[number]] for joint, number in rig.joints.items() if rig.names[number] in human}
    for node in stated.values():
      document.nodes[node]
    return {joint: node for joint, node in stated.items() if node >= 0}


def _copies(path, nodes, names, parents, rest, bones, find):
  """{node of the body: nodes of further skeletons with the same name and place}, such as skeletons of clothes, whole or
  in part.

  Raises InputError for a second body.
  """
  pelvis, places, copies = bones.limbs["pelvis"], rest[nodes, :3, 3], {}
  body = [i for i in range(len(nodes)) if pelvis in _line(parents, i)]
  groups = collections.defaultdict(list)  # {the topmost bone of a skeleton: its bones}
  for i in range(len(nodes)):
    if i not in body and i not in bones.limbs.values():
      groups[_line(parents, i)[-1]].append(i)
  apart = lambda i, k: np.linalg.norm(places[i] - places[k])
  for group in groups.values():
    twins = {}
    for i in group:
      same = [k for k in body if _unmarked(names[k]) == _unmarked(names[i])]
      twins |= {i: min(same, key=functools.partial(apart, i))} if same else {}
    if all(apart(*pair) < _SAME_PLACE * np.ptp(places, axis=0).max() for pair in twins.items()):
      for i, k in twins.items():
        copies.setdefault(nodes[k], []).append(nodes[i])
        group.remove(i)
  left = [i for group in groups.values() for i in group]
  try:
    other = left[find(left).limbs["pelvis"]]
  except InputError:
    return copies
  raise InputError(f"{path}: it holds two bodies, below {names[pelvis]!r} and {names[other]!r}, expected one; delete "
                   "one of them and export the file again")


def _unmarked(name):
  """A bone's name without what programs put around that of a copy: clothes:Hips, Hips.001, Hips_1."""
  return re.sub(r"[._]\d+$", "", name.rpartition(":")[2])


def _line(parents, i):
  """A bone and those above it."""
  line = []
  while i >= 0:
    line.append(i)
    i = parents[i]
  return line


def _built(document, nodes, names, match, rest, root, copies):
  path = document.path
  # Of the trunk counts what lies on the way to the head: a bone called so elsewhere follows no joint.
  limbs = {joint: number for joint, number in match.limbs.items() if joint not in (
      "spine1", "spine2", "spine3", "neck")}
  numbers = list(dict.fromkeys([limbs["pelvis"], *match.spine, *match.neck, *limbs.values()]))
  parts = {joint: numbers.index(number) for joint, number in limbs.items()}
  bones = Bones(parts, tuple(map(numbers.index, match.spine)), tuple(map(numbers.index, match.neck)), match.label)
  parents = _body_parents(parts, bones, len(numbers))
  order = sorted(range(len(numbers)), key=lambda bone: _depth(parents, bone))
  back = {bone: place for place, bone in enumerate(order)}
  nodes = [nodes[numbers[bone]] for bone in order]
  parents = [-1 if parents[bone] < 0 else back[parents[bone]] for bone in order]
  parts = {joint: back[bone] for joint, bone in parts.items()}
  bones = Bones(parts, tuple(back[bone] for bone in bones.spine), tuple(back[bone] for bone in bones.neck), bones.label)
  _check_scales(document, nodes, rest)
  still, turned_still, _ = take_apart(rest[nodes])
  places, turned = _reference(document, nodes, parts, still, turned_still)
  legs = np.mean([np.linalg.norm(places[parts[f"{side}_{a}"]] - places[parts[f"{side}_{b}"]])
                  for side in SIDES for a, b in (("hip", "knee"), ("knee", "ankle"))]) * 2
  if not legs > 1e-6 or not np.isfinite(legs):
    raise InputError(f"{path}: its legs have no length, all of hip, knee and ankle lie in one point; give the right "
                     "bones by --character-mapping FILE.json (mapping=)")
  frame, out = _frames(places, parts)
  scale = legs / LEGS
  above = np.maximum(parents, 0)
  offsets = rot.rotate(rot.conjugate(turned_still[above]), still - still[above]) / scale
  soles, floor = _soles(document, nodes, parts, rest, still, turned_still, scale, frame)
  inward = rot.conjugate(frame)[None]
  aligned = rot.rotate(inward, places)
  hips = aligned[[parts["left_hip"], parts["right_hip"]]].mean(0)
  base = np.array([hips[0], floor, hips[2]])
  missing = [joint for joint in ("left_collar", "right_collar", "left_foot", "right_foot") if joint not in parts]
  if missing or not bones.spine or not bones.neck:
    words = [joint.replace("foot", "toes").replace("_", " ") for joint in missing]
    words += ["spine"] * (not bones.spine) + ["neck"] * (not bones.neck)
    warnings.warn(f"{path}: it has no bones for {named(words, 8)}, which stay as they are", stacklevel=4)
  return Figure(document, nodes, parts, bones, parents, offsets, rot.multiply(inward, turned), (aligned - base) / scale,
                soles, out, scale, rot.rotate(frame, base) if np.allclose(frame, out) else
                rot.rotate(out, base) * [1, 0, 1], None if root in nodes else root,
                [(bone, twin) for bone, node in enumerate(nodes) for twin in copies.get(node, ())])


def _body_parents(parts, bones, count):
  """The parent of each bone in a body."""
  parents = [-1] * count
  trunk = [parts["pelvis"], *bones.spine]
  chest = trunk[-1]
  lines = [trunk, [chest, *bones.neck, parts["head"]]]
  for above, joints in ((parts["pelvis"], ("hip", "knee", "ankle", "foot")),
                        (chest, ("collar", "shoulder", "elbow", "wrist"))):
    lines += [[above, *(parts[f"{side}_{joint}"] for joint in joints if f"{side}_{joint}" in parts)] for side in SIDES]
  for line in lines:
    for above, bone in zip(line[:-1], line[1:]):
      parents[bone] = above
  return parents


def _depth(parents, bone):
  depth = 0
  while (bone := parents[bone]) >= 0:
    depth += 1
  return depth


def _check_scales(document, nodes, rest):
  """Raises InputError for mirrored bones, and warns of bones stretched along one axis."""
  for node in nodes:
    linear = rest[node, :3, :3]
    sizes = np.linalg.norm(linear, axis=0)
    if not np.isfinite(linear).all() or sizes.min() < 1e-9:
      raise InputError(f"{document.path}: the bone {document.name(node)!r} is scaled to nothing; give it a scale other "
                       "than 0")
    if np.linalg.det(linear) < 0:
      raise InputError(f"{document.path}: the bone {document.name(node)!r} is mirrored by a negative scale, which "
                       "makes left right; apply the scale in the program that it comes from")
    if sizes.max() > (1 + _UNEVEN) * sizes.min():
      warnings.warn(f"{document.path}: the bone {document.name(node)!r} is stretched by uneven scales, which shear it "
                    "where it turns; apply the scale in the program that it comes from", stacklevel=6)
      return


def _reference(document, nodes, parts, places, turned):
  """Places and rotations of a pose that stands straight: the nodes' own, or that in which the skin was bound."""
  if _asymmetry(places, parts) < _CROOKED:
    return places, turned
  bound = _bind_pose(document, nodes)
  if bound is None or _asymmetry(bound[0], parts) >= _asymmetry(places, parts):
    return places, turned
  return bound


def _asymmetry(places, parts):
  """Mean distance of a pose's left side from its mirrored right side, in leg lengths."""
  pairs = [(parts[joint], parts["right" + joint[4:]]) for joint in parts if joint.startswith("left")
           and "right" + joint[4:] in parts]
  left, right = (places[list(side)] for side in zip(*pairs))
  frame = _axes(places, parts)
  middle = places[[parts["left_hip"], parts["right_hip"]]].mean(0)
  leg = sum(np.linalg.norm(places[parts[f"left_{a}"]] - places[parts[f"left_{b}"]]) for a, b in (
      ("hip", "knee"), ("knee", "ankle")))
  off = (left - middle) @ frame * [-1, 1, 1] - (right - middle) @ frame
  return np.linalg.norm(off, axis=-1).mean() / max(leg, 1e-9)


def _bind_pose(document, nodes):
  """Places (M, 3) and rotations (M, 4) of bones where their skin was bound; None if a bone has no bind matrix."""
  matrices = {}
  try:
    with document.checked():
      for skin in document.json.get("skins", ()):
        if (inverse := document.bind_matrices(skin)) is not None:
          for joint, matrix in zip(skin["joints"], inverse):
            matrices.setdefault(joint, matrix)
  except Unreadable:
    return None
  if not set(nodes) <= set(matrices):
    return None
  inverse_bind = np.array([matrices[node] for node in nodes])
  if not (np.abs(np.linalg.det(inverse_bind)) > 1e-12).all():
    return None
  top = document.parents[nodes[0]]
  above = document.world(*document.rest())[top] if top >= 0 else np.eye(4)
  places, turned, _ = take_apart(above @ np.linalg.inv(inverse_bind))
  return places, turned


def _axes(places, parts):
  """A matrix (3, 3) whose columns point to the body's left, up and ahead."""
  trunk = places[[parts["left_shoulder"], parts["right_shoulder"]]].mean(0) - places[
      [parts["left_hip"], parts["right_hip"]]].mean(0)
  up = rot.unit(trunk, eps=1e-12)
  across = _across(places, parts)
  left = rot.unit(across - up * (across @ up), eps=1e-12)
  return np.stack([left, up, np.cross(left, up)], -1)


def _across(places, parts):
  """From right to left hip, or shoulder where the hips are in one point."""
  hips, shoulders = (places[parts[f"left_{joint}"]] - places[parts[f"right_{joint}"]] for joint in ("hip", "shoulder"))
  return hips if np.linalg.norm(hips) > 0.05 * np.linalg.norm(shoulders) else shoulders


def _frames(places, parts):
  """Rotations (4,) of the motions' frame to the reference pose's, and to the file's world as a body stands there.

  A body that stands keeps what it leans; one that lies in the file is stood up.
  """
  axes = _axes(places, parts)
  if axes[1, 1] > _UPRIGHT:
    across = _across(places, parts)
    turn = rot.about_axis(np.array(np.arctan2(-across[2], across[0])), "y")
    return turn, turn
  frame = rot.from_matrix(axes)
  return frame, rot.multiply(rot.between(axes[:, 1], np.array([0.0, 1, 0])), frame)


def _soles(document, nodes, parts, rest, still, turned, scale, frame):
  """{bone: points (P, 3) of its sole in its turned frame, our metres}, and the height of the floor in the file's unit.

  The lowest vertices that follow the bones of a foot; without a mesh that can be read, points below ankle and toes.
  """
  inward = rot.conjugate(frame)
  feet = [parts[f"{side}_{joint}"] for side in SIDES for joint in ("ankle", "foot") if f"{side}_{joint}" in parts]
  try:
    with document.checked():
      points = _vertices(document, {nodes[bone]: bone for bone in feet}, rest)
  except Unreadable:
    points = {}
  heights = {bone: rot.rotate(inward[None], places)[:, 1] for bone, places in points.items()}
  soles = {}
  for side in SIDES:
    foot_bones = [parts[f"{side}_{joint}"] for joint in ("ankle", "foot") if f"{side}_{joint}" in parts]
    shown = [bone for bone in foot_bones if bone in heights]
    if not shown:
      continue
    low = min(heights[bone].min() for bone in shown)
    for bone in shown:
      near = heights[bone] < low + 0.03 * scale
      chosen = points[bone][near]
      if len(chosen):
        soles[bone] = chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), _MOST_POINTS)).astype(int)]
  if soles:
    floor = min(rot.rotate(inward[None], places)[:, 1].min() for places in soles.values())
  else:
    level = rot.rotate(inward[None], still)[:, 1]
    ankles = level[[parts["left_ankle"], parts["right_ankle"]]].min()
    floor = min(ankles - _ANKLE * LEGS * scale, level[feet].min())
    if 0 <= level[feet].min() < 2 * _ANKLE * LEGS * scale:
      floor = 0.0
    up = rot.rotate(frame, np.array([0.0, 1, 0]))
    soles = {bone: (still[bone] - (level[bone] - floor) * up)[None] for bone in feet}
  return {bone: rot.rotate(rot.conjugate(turned[bone])[None], places - still[bone]) / scale
          for bone, places in soles.items()}, float(floor)


def _vertices(document, feet, rest):
  """{bone: positions (P, 3) in the world of the vertices that follow it, or its children, most}."""
  owner = {}
  for node in document.order:
    owner[node] = feet.get(node, owner.get(document.parents[node]))
  by_bone = {}
  for node in document.nodes:
    if "skin" not in node or "mesh" not in node:
      continue
    skin = document.json["skins"][node["skin"]]
    joints = skin["joints"]
    matrices = rest[joints]
    if (inverse := document.bind_matrices(skin)) is not None:
      matrices = matrices @ inverse
    bones = np.array([-1 if owner[joint] is None else owner[joint] for joint in joints])
    for primitive in document.json["meshes"][node["mesh"]]["primitives"]:
      names = primitive["attributes"]
      if not {"POSITION", "JOINTS_0", "WEIGHTS_0"} <= set(names):
        continue
      if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
        raise Unreadable(f"{document.path}: its mesh is compressed (Draco)")
      where, weights = document.array(names["JOINTS_0"]).astype(int), document.array(names["WEIGHTS_0"])
      if where.size and where.max() >= len(joints):
        raise InputError(f"{document.path}: a vertex follows joint {where.max()} of a skin of {len(joints)}; export "
                         "the file again")
      most = bones[np.take_along_axis(where, weights.argmax(1)[:, None], 1)[:, 0]]
      chosen = np.flatnonzero(most >= 0)
      if not len(chosen):
        continue
      places = np.concatenate([document.array(names["POSITION"])[chosen], np.ones((len(chosen), 1))], 1)
      share = weights[chosen] / np.maximum(weights[chosen].sum(1, keepdims=True), 1e-9)
      moved = np.einsum("pk,pkij,pj->pi", share, matrices[where[chosen]], places)[:, :3]
      for bone in np.unique(most[chosen]):
        by_bone.setdefault(int(bone), []).append(moved[most[chosen] == bone])
  return {bone: np.concatenate(parts) for bone, parts in by_bone.items()}
