"""GLB (binary glTF 2.0): the mannequin as a skinned, animated mesh that opens in any 3-D program or browser.

Numpy and JSON only: pygltflib has the same JSON as classes, but packs no arrays and makes no skin or animation, which
is what this file does. The bind pose is the T-pose of `export.rig`, the same for all motions of a model; joints turn
about it, the root also moves. The soles reach down to y = 0, however high the clip's toe joints stand (`export.body`).

glTF counts seconds. Blender places keys by the scene's rate when it imports (24 a second in a new scene): set the
scene's rate to the motion's first (`asset.extras.fps` in the file), then each key is on a whole frame.
"""
import json
import pathlib
import re
import struct

import numpy as np

from motion_jax.export.binding import bind
from motion_jax.motion.figure import COLORS
from motion_jax.motion.looping import is_loop, velocity
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.json_values import plain

FLOAT, SHORT, BYTE = 5126, 5123, 5121


def glb(clip, path, exact=False, rig=None, t_pose=False, name=None) -> pathlib.Path:
  """Writes a clip as a .glb: nodes named like the joints, one skin, one animation at the clip's rate, metres, y up.

  name: of the animation, by default the caption with "_" for blanks.

  rig: names, tree and rest pose of another program (`motion_jax.rigs`), such as "mixamo". Joints only turn,
  and the root moves; exact=True also moves those whose place rotations miss by half a millimetre. t_pose: the
  first frame is a T-pose.
  """
  path = pathlib.Path(path)
  moved, skin_joints, skins, rest, inverse = bind(clip, exact, rig, t_pose)
  # A root bone moves no part of the mesh, and is a bone.
  skin_joints = skin_joints if 0 in skin_joints else [*skin_joints, 0]
  buffer = Buffer()
  materials = [_material(skin.group, COLORS[skin.group]) for skin in skins]
  meshes = [_primitive(buffer, skin, number) for number, skin in enumerate(skins)]
  inverse = buffer.add(inverse[skin_joints].transpose(0, 2, 1).reshape(-1, 16), FLOAT, "MAT4")  # glTF stores columns
  nodes = rest_nodes(moved, rest[moved.pelvis])
  nodes.append({"name": "mannequin", "mesh": 0, "skin": 0})
  nodes.append({"name": clip.id, "children": [0]})  # the mesh stands beside it: only joints move a skin
  asset, about = describe(clip)
  document = {
      "asset": asset,
      "scene": 0, "scenes": [{"nodes": [len(nodes) - 2, len(nodes) - 1]}], "nodes": nodes,
      "materials": materials, "meshes": [{"name": "mannequin", "primitives": meshes}],
      "skins": [{"skeleton": 0, "joints": skin_joints, "inverseBindMatrices": inverse}],
      "animations": [animation(buffer, moved, clip.fps, name or clip_name(clip), about)]}
  return write_container(path, document, buffer)


def describe(clip):
  """The asset of a glTF document, and the extras of its animation: with `facts`, what engines need."""
  about = {"fps": float(clip.fps)} | ({"caption": clip.captions[0].text} if clip.captions else {})
  return ({"version": "2.0", "generator": "motion_jax", "extras": about | ({"license": clip.license} if clip.license
                                                                            else {})}, about | facts(clip))


def facts(clip) -> dict:
  """Whether a clip is a loop, how fast it travels, its licence, and what each step did to it (`motion.step_records`).

  speed: metres a second over the ground; velocity: the same as (x, y, z) from the body, x to its left, z ahead. Of a
  motion in place, those that it had before.
  """
  loop = is_loop(clip.joints, clip.skeleton)
  moving = clip.meta.get("velocity") or (velocity(clip.joints, clip.fps, clip.skeleton).tolist() if loop else None)
  travel = {"speed": round(float(np.linalg.norm(moving)), 4), "velocity": [round(float(v), 4) for v in moving]
            } if moving else {}
  steps = {"steps": plain(clip.meta["steps"])} if clip.meta.get("steps") else {}
  return {"loop": loop} | travel | steps | ({"license": clip.license} if clip.license else {})


def clip_name(clip) -> str:
  """The name of a clip's animation: its caption, or its id, in letters, digits and "_", which every engine takes."""
  words = re.sub(r"\W+", "_", clip.captions[0].text if clip.captions else clip.id).strip("_")
  return words[:60].rstrip("_") or "motion"


def rest_nodes(moved, pelvis) -> list[dict]:
  """The nodes of a RigMotion in its rest pose, with the pelvis at (3,)."""
  children = [[k for k, parent in enumerate(moved.rig.parents) if parent == j] for j in range(len(moved.rig.names))]
  return [{"name": name, "translation": (pelvis if j == moved.pelvis else moved.offsets[j]).tolist()}
          | ({"children": children[j]} if children[j] else {}) for j, name in enumerate(moved.rig.names)]


def write_container(path, document, buffer) -> pathlib.Path:
  """Writes a glTF document and the Buffer that it refers to as one binary file."""
  document |= {"accessors": buffer.accessors, "bufferViews": buffer.views,
               "buffers": [{"byteLength": len(buffer.data)}]}
  text = json.dumps(document, separators=(",", ":")).encode()
  text += b" " * (-len(text) % 4)
  chunks = struct.pack("<II", len(text), 0x4E4F534A) + text  # "JSON"
  chunks += struct.pack("<II", len(buffer.data), 0x004E4942) + bytes(buffer.data)  # "BIN"
  with atomic_path(path) as temporary:
    temporary.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
  return path


class Buffer:
  """Collects arrays into one binary chunk, and the views and accessors that describe it."""

  def __init__(self):
    self.data, self.views, self.accessors = bytearray(), [], []

  def add(self, array, kind, shape, bounds=False, normalized=False, target=None) -> int:
    """Appends array (N, K) as accessor type `shape` of component type `kind`; returns the accessor's number."""
    array = np.ascontiguousarray(array, {FLOAT: "<f4", SHORT: "<u2", BYTE: "u1"}[kind])
    self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": array.nbytes}
                      | ({"target": target} if target else {}))
    accessor = {"bufferView": len(self.views) - 1, "componentType": kind, "count": len(array), "type": shape}
    if bounds:
      columns = array.reshape(len(array), -1)
      accessor |= {"min": columns.min(0).tolist(), "max": columns.max(0).tolist()}
    self.accessors.append(accessor | ({"normalized": True} if normalized else {}))
    self.data += array.tobytes()
    self.data += b"\0" * (-len(self.data) % 4)
    return len(self.accessors) - 1


def _primitive(buffer, skin, material):
  """A skin as a glTF primitive."""
  vertices, elements = 34962, 34963
  return {"attributes": {"POSITION": buffer.add(skin.points, FLOAT, "VEC3", bounds=True, target=vertices),
                         "NORMAL": buffer.add(skin.normals, FLOAT, "VEC3", target=vertices),
                         "JOINTS_0": buffer.add(skin.joints, BYTE, "VEC4", target=vertices),
                         "WEIGHTS_0": buffer.add(skin.weights, BYTE, "VEC4", normalized=True, target=vertices)},
          "indices": buffer.add(skin.triangles.reshape(-1, 1), SHORT, "SCALAR", target=elements),
          "material": material}


def _material(name, color):
  linear = [round(float(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4), 5) for c in color]
  return {"name": name, "pbrMetallicRoughness": {"baseColorFactor": [*linear, 1.0], "metallicFactor": 0.0,
                                                 "roughnessFactor": 0.65}}


def animation(buffer, pose, fps, name, about) -> dict:
  """A RigMotion as a glTF animation of the nodes of `rest_nodes`. about: its extras."""
  times = buffer.add((np.arange(len(pose.root)) / fps)[:, None], FLOAT, "SCALAR", bounds=True)
  samplers, channels = [], []

  def add(joint, path, values, shape):
    samplers.append({"input": times, "output": buffer.add(values, FLOAT, shape), "interpolation": "LINEAR"})
    channels.append({"sampler": len(samplers) - 1, "target": {"node": joint, "path": path}})

  places, moving = pose.places, pose.moving
  for joint in range(len(pose.rig.names)):
    if joint in moving:
      add(joint, "translation", places[:, joint], "VEC3")
    if np.abs(pose.rotations[:, joint, 1:]).max() > 1e-7:
      add(joint, "rotation", pose.rotations[:, joint, [1, 2, 3, 0]], "VEC4")  # glTF writes w last
  return {"name": name, "samplers": samplers, "channels": channels, "extras": about}
