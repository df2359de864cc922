"""Small rigged characters: a box on each bone, of any names, rest pose, rolls, unit and axes."""
import base64
import functools
import json
import struct

import numpy as np

from motion_jax.export.html import resting_body
from motion_jax.motion import rotations as rot
from motion_jax.motion.rigs import get_rig
from motion_jax.motion.skeleton import HUMANML3D

# A red pixel, for what a page's security policy lets a texture be.
_PNG = base64.b64decode("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR4nGP4z8DwHwAFAAH/iZk9HQAA"
                        "AABJRU5ErkJggg==")
_BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.03
_FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                   [0, 6, 4], [1, 5, 7], [1, 7, 3]])


@functools.cache
def _offsets():
  """Offsets (22, 3) of the page's own body in its T-pose."""
  rest = np.array(resting_body()["rest"])
  return rest - rest[np.maximum(HUMANML3D.parents, 0)]


def places(turned):
  """Joints (22, 3) of the page's own body whose bones are turned (22, 4) in the world, seen from the T-pose."""
  offsets, found = _offsets(), np.zeros((22, 3))
  for j, parent in enumerate(HUMANML3D.parents[1:], 1):
    found[j] = found[parent] + rot.rotate(turned[parent][None], offsets[j][None])[0]
  return found


def character(rig="mixamo", *, arms=0.0, unit=1.0, rolls=False, back=False, scale=1.0, vrm=None, without=(),
              twice=False, skin=True):
  """The bytes of a .glb of the mannequin's proportions.

  arms: how far they hang below the horizontal, rad. unit: of the nodes, metres, under a root that is scaled by it.
  rolls: arbitrary rest rotations. back: it looks along -z. scale: of the whole body. vrm: 0 or 1, bones without telling
  names and the extension that tells them. without: joints that it lacks. twice: a second armature. skin: whether bound.
  """
  rig, skeleton = get_rig(rig), HUMANML3D
  names = [rig.names[rig.joints[joint]] for joint in skeleton.joints]
  turned = np.tile([1.0, 0, 0, 0], (22, 1))
  for j, joint in enumerate(skeleton.joints):
    if joint.endswith(("shoulder", "elbow", "wrist")):
      turned[j] = rot.about_axis(np.array(arms * (-1 if joint.startswith("left") else 1)), "z")
  at = places(turned) * scale
  at[:, 1] -= at[:, 1].min()
  if back:
    at *= [-1, 1, -1]
  rng = np.random.default_rng(3)
  rolled = rot.unit(rng.standard_normal((22, 4))) if rolls else np.tile([1.0, 0, 0, 0], (22, 1))
  nodes = [{"name": "armature", "scale": [unit] * 3, "children": [1]}]
  kept = [j for j, joint in enumerate(skeleton.joints) if joint not in without]
  number = {j: 1 + i for i, j in enumerate(kept)}

  def parent(j):
    above = skeleton.parents[j]
    return above if above in number or above < 0 else parent(above)

  for j in kept:
    above = rolled[parent(j)] if j else np.array([1.0, 0, 0, 0])
    local = rot.multiply(rot.conjugate(above), rolled[j])
    from_parent = rot.rotate(rot.conjugate(above)[None], (at[j] - (at[parent(j)] if j else 0))[None])[0]
    children = [number[k] for k in kept if parent(k) == j]
    nodes.append({"name": f"bone {j}" if vrm is not None else names[j], "translation": (from_parent / unit).tolist(),
                  "rotation": local[[1, 2, 3, 0]].tolist()} | ({"children": children} if children else {}))
  inverse = np.tile(np.eye(4), (len(kept), 1, 1))
  inverse[:, :3, :3] = rot.to_matrix(rot.conjugate(rolled[kept])) / unit
  inverse[:, :3, 3] = -np.einsum("jab,jb->ja", inverse[:, :3, :3], at[kept])
  points = (at[kept][:, None] + _BOX).reshape(-1, 3)
  points[:, 1] = np.maximum(points[:, 1], 0)  # soles
  joints = np.repeat(np.arange(len(kept)), 8)[:, None] * [1, 0, 0, 0]
  weights = np.tile([1.0, 0, 0, 0], (len(points), 1))
  faces = (_FACES[None] + 8 * np.arange(len(kept))[:, None, None]).reshape(-1)
  arrays = [(points, "<f4", "VEC3", 5126), (points * 0, "<f4", "VEC2", 5126), (joints, "u1", "VEC4", 5121),
            (weights, "<f4", "VEC4", 5126), (faces, "<u2", "SCALAR", 5123),
            (inverse.transpose(0, 2, 1).reshape(-1, 16), "<f4", "MAT4", 5126)]
  data, views, accessors = b"", [], []
  for array, kind, shape, component in arrays:
    array = np.ascontiguousarray(array[:, :2] if shape == "VEC2" else array, kind)
    views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
    bounds = {"min": points.min(0).tolist(), "max": points.max(0).tolist()} if not accessors else {}
    accessors.append({"bufferView": len(accessors), "componentType": component, "count": len(array),
                      "type": shape} | bounds)
    data += array.tobytes() + b"\0" * (-array.nbytes % 4)
  views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(_PNG)})
  data += _PNG + b"\0" * (-len(_PNG) % 4)
  mesh = {"name": "body", "mesh": 0} | ({"skin": 0} if skin else {})
  document = {
      "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0, len(nodes)]}],
      "nodes": nodes + [mesh], "images": [{"bufferView": 6, "mimeType": "image/png"}], "textures": [{"source": 0}],
      "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
      "meshes": [{"primitives": [{"indices": 4, "material": 0, "attributes": {
          "POSITION": 0, "TEXCOORD_0": 1, "JOINTS_0": 2, "WEIGHTS_0": 3}}]}],
      "skins": [{"joints": list(range(1, len(nodes))), "inverseBindMatrices": 5}] if skin else [],
      "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(data)}]}
  if not skin:
    del document["skins"]
  if twice:
    first = len(document["nodes"])
    document["nodes"] += [{**node} | ({"children": [first + child for child in node["children"]]} if "children" in node
                                      else {}) for node in nodes]
    document["scenes"][0]["nodes"].append(first)
    document["skins"].append({"joints": list(range(first + 1, first + len(nodes))), "inverseBindMatrices": 5})
    document["nodes"].append({"mesh": 0, "skin": 1})
    document["scenes"][0]["nodes"].append(first + len(nodes))
  if vrm is not None:
    bones = get_rig("vrm")
    human = {bones.names[bones.joints[skeleton.joints[j]]]: number[j] for j in kept}
    document["extensions"] = {"VRMC_vrm": {"specVersion": "1.0", "humanoid": {"humanBones": {
        bone: {"node": node} for bone, node in human.items()}}}} if vrm == 1 else {"VRM": {"humanoid": {"humanBones": [
            {"bone": bone, "node": node} for bone, node in human.items()]}}}
    document["extensionsUsed"] = list(document["extensions"])
  text = json.dumps(document).encode()
  text += b" " * (-len(text) % 4)
  chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
  return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
