"""Small rigged characters: a box on each bone, in the names of any rig, with what real files have and ours do not."""
import json
import struct

import numpy as np

from motion_jax import rigs
from motion_jax.export.rig import on_rig
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D

_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
_FACES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6],
                   [0, 6, 4], [1, 5, 7], [1, 7, 3]])
HALF = 0.02  # metres of a box


def write_character(path, clip, rig="mixamo", rolls=0, armature=None, scale=1.0, size=1.0, raised=(), leave_out=(),
                    quantized=False, copies=1, change=None):
  """Writes the body of a clip as a character in a file's T-pose (or A-pose, as the rig has it).

  rolls: seed of odd rest rotations of all bones, 0 for none. armature: rotation (4,) of the node above the bones;
  scale: of that node, its bones' numbers being 1 / scale as large. size: of the whole body. raised: {name: rotation
  (4,)} of a bone and all below it at rest. leave_out: words; bones whose names hold one are missing, with all below.
  quantized: positions as 16-bit integers, interleaved with joints and weights. copies: skins of the same bones. change:
  a function that edits the JSON before it is written. Returns the names of the bones.
  """
  moved = on_rig(clip, rig)
  kept = []
  for j, name in enumerate(moved.rig.names):
    parent = moved.rig.parents[j]
    if not any(word in name for word in leave_out) and (parent < 0 or parent in kept):
      kept.append(j)
  names = [moved.rig.names[j] for j in kept]
  parents = [kept.index(moved.rig.parents[j]) if moved.rig.parents[j] >= 0 else -1 for j in kept]
  turned = np.tile([1.0, 0, 0, 0], (len(kept), 1))
  places = np.zeros((len(kept), 3))
  for i, j in enumerate(kept):
    if parents[i] >= 0:
      turned[i] = turned[parents[i]]
      places[i] = places[parents[i]] + rot.rotate(turned[i], moved.offsets[j])
    turned[i] = rot.multiply(turned[i], np.array(dict(raised).get(names[i], (1.0, 0, 0, 0))))
  places = (places - [0, places[:, 1].min() - HALF, 0]) * size
  if rolls:
    own = np.random.default_rng(rolls).normal(size=turned.shape)
    turned = rot.multiply(turned, own / np.linalg.norm(own, axis=-1, keepdims=True))
  base = np.array([1.0, 0, 0, 0] if armature is None else armature)
  nodes = []
  for i, parent in enumerate(parents):
    above, at = (turned[parent], places[parent]) if parent >= 0 else (base, np.zeros(3))
    x = rot.multiply(rot.conjugate(above), turned[i])
    nodes.append({"name": names[i], "rotation": x[[1, 2, 3, 0]].tolist(),
                  "translation": (rot.rotate(rot.conjugate(above), places[i] - at) / scale).tolist(),
                  "children": [k for k, one in enumerate(parents) if one == i]})
    if not nodes[-1]["children"]:
      del nodes[-1]["children"]
  count = len(names)
  nodes.append({"name": "Armature", "rotation": base[[1, 2, 3, 0]].tolist(), "scale": [scale] * 3,
                "children": [i for i, parent in enumerate(parents) if parent < 0]})
  points = (places[:, None] + _CORNERS * HALF * size).reshape(-1, 3)
  world = np.tile(np.eye(4), (count, 1, 1))
  world[:, :3, :3], world[:, :3, 3] = rot.to_matrix(turned) * scale, places
  inverse = np.linalg.inv(world)
  data, views, accessors = bytearray(), [], []

  def add(values, kind, shape, **more):
    data.extend(b"\0" * (-len(data) % 4))
    views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes} | more.pop("view", {}))
    data.extend(values.tobytes())
    accessors.append({"bufferView": len(views) - 1, "componentType": kind, "count": len(values), "type": shape} | more)
    return len(accessors) - 1

  joints = np.repeat(np.arange(count), 8)
  bounds = {"min": points.min(0).tolist(), "max": points.max(0).tolist()}
  if quantized:
    low, span = points.min(0), np.ptp(points, axis=0).max()
    short = np.round((points - low) / span * 32767)
    matrix = np.diag([span, span, span, 1.0])
    matrix[:3, 3] = low
    inverse = inverse @ matrix
    rows = np.zeros(len(points), np.dtype([("at", "<i2", 4), ("joint", "u1", 4), ("weight", "u1", 4)]))
    rows["at"][:, :3], rows["joint"][:, 0], rows["weight"][:, 0] = short, joints, 255
    add(rows, 5122, "VEC3", normalized=True, min=short.min(0).tolist(), max=short.max(0).tolist(),
        view={"byteStride": 16, "target": 34962})
    for offset, name in ((8, "joint"), (12, "weight")):
      accessors.append({"bufferView": 0, "byteOffset": offset, "componentType": 5121, "count": len(points),
                        "type": "VEC4"} | ({"normalized": True} if name == "weight" else {}))
    attributes = {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}
  else:
    four = np.zeros((len(points), 4))
    four[:, 0] = joints
    attributes = {"POSITION": add(points.astype("<f4"), 5126, "VEC3", view={"target": 34962}, **bounds),
                  "JOINTS_0": add(four.astype("<u2"), 5123, "VEC4", view={"target": 34962}),
                  "WEIGHTS_0": add((four * 0 + [1, 0, 0, 0]).astype("<f4"), 5126, "VEC4", view={"target": 34962})}
  faces = add((_FACES[None] + 8 * np.arange(count)[:, None, None]).reshape(-1, 1).astype("<u2"), 5123, "SCALAR",
              view={"target": 34963})
  matrices = add(inverse.swapaxes(1, 2).reshape(-1, 16).astype("<f4"), 5126, "MAT4")
  document = {
      "asset": {"version": "2.0"}, "scene": 0, "nodes": nodes, "materials": [{"name": "skin"}],
      "meshes": [{"primitives": [{"attributes": attributes, "indices": faces, "material": 0}], "extras": {"my": [1]}}],
      "skins": [{"joints": list(range(count)), "inverseBindMatrices": matrices} for _ in range(copies)],
      "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(data)}]}
  if quantized:
    document |= {"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]}
  for copy in range(copies):
    nodes.append({"name": f"mesh {copy}", "mesh": 0, "skin": copy})
  document["scenes"] = [{"nodes": list(range(count, len(nodes)))}]
  if change:
    change(document)
  write_glb(path, document, bytes(data))
  return names


def write_glb(path, document, data):
  """Writes JSON and bytes as a .glb."""
  text = json.dumps(document).encode()
  text += b" " * (-len(text) % 4)
  data += b"\0" * (-len(data) % 4)
  head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
  path.write_bytes(head + struct.pack("<II", len(text), 0x4E4F534A) + text
                   + struct.pack("<II", len(data), 0x004E4942) + data)


def rig_joints(rig):
  """{joint: bone's name} of a rig."""
  rig = rigs.get_rig(rig)
  return {joint: rig.names[number] for joint, number in rig.joints.items()}


def with_vrm(version):
  """Bones of which the extension alone says what they are."""
  def change(document):
    bones, joints = rigs.get_rig("vrm"), rig_joints("vrm")
    number = {node["name"]: i for i, node in enumerate(document["nodes"])}
    human = {bones.names[bones.joints[joint]]: number[joints[joint]] for joint in HUMANML3D.joints if joint in joints}
    rows = {bone: {"node": node} for bone, node in human.items()} if version else [
        {"bone": bone, "node": node} for bone, node in human.items()]
    document["extensions"] = {"VRMC_vrm" if version else "VRM": {"humanoid": {"humanBones": rows}}}
    for i, node in enumerate(document["nodes"]):
      node["name"] = f"bone {i}"

  return change


def mirrored(document):
  """A negative scale of the node above the bones."""
  next(node for node in document["nodes"] if node["name"] == "Armature")["scale"] = [-1, 1, 1]


def two_bodies(document, apart=1.0, scene=None):
  """A second armature with a mesh of its own, metres apart, in the same scene or in one more that is not shown."""
  nodes, first = document["nodes"], len(document["nodes"])
  nodes += [node | ({"children": [first + k for k in node["children"]]} if "children" in node else {})
            for node in nodes]
  document["skins"].append(document["skins"][0] | {"joints": [first + k for k in document["skins"][0]["joints"]]})
  nodes[-1] = nodes[-1] | {"skin": 1}
  top = next(node for node in nodes[first:] if node["name"] == "Armature")
  top["translation"] = [apart, 0, 0]
  below = [first + k for k in document["scenes"][0]["nodes"]]
  document["scenes"] += [{"nodes": below}] if scene == 1 else []
  document["scenes"][0]["nodes"] += below if scene != 1 else []
