"""GLB (binary glTF 2.0): the mannequin as a skinned, animated mesh that opens in any 3-D program or browser.

Numpy and JSON only. The bind pose is the T-pose of `motion.pose`; joints turn about it, the root also moves.
"""
import json
import pathlib
import struct

import numpy as np

from motion_jax.data.clip import atomic_path
from motion_jax.export.body import COLORS, make_parts
from motion_jax.motion.pose import to_pose

_FLOAT, _SHORT, _BYTE = 5126, 5123, 5121
_AROUND, _CAP = 16, 5  # points around a part, rings per rounded end


def glb(clip, path) -> pathlib.Path:
  """Writes a clip as a .glb: nodes named like the joints, one skin, one animation at the clip's rate, metres, y up."""
  path = pathlib.Path(path)
  skeleton = clip.skeleton
  pose = to_pose(np.asarray(clip.joints, np.float64) * skeleton.unit, skeleton, clip.fps)
  rest = _rest(pose.offsets, skeleton)
  parts = make_parts(skeleton, pose.offsets)
  buffer = _Buffer()
  meshes, materials = [], []
  for group, color in COLORS.items():
    members = [_mesh(part, rest, skeleton) for part in parts if part.group == group]
    if members:
      materials.append(_material(group, color))
      meshes.append(_primitive(buffer, members, len(materials) - 1))
  inverse = np.tile(np.eye(4), (skeleton.num_joints, 1, 1))
  inverse[:, :3, 3] = -rest
  inverse = buffer.add(inverse.transpose(0, 2, 1).reshape(-1, 16), _FLOAT, "MAT4")  # glTF stores columns
  children = [[k for k, parent in enumerate(skeleton.parents) if parent == j] for j in range(skeleton.num_joints)]
  nodes = [{"name": name, "translation": (rest[0] if j == 0 else pose.offsets[j]).tolist()}
           | ({"children": children[j]} if children[j] else {}) for j, name in enumerate(skeleton.joints)]
  nodes.append({"name": "mannequin", "mesh": 0, "skin": 0})
  nodes.append({"name": clip.id, "children": [0, skeleton.num_joints]})
  caption = clip.captions[0].text if clip.captions else clip.id
  about = {key: value for key, value in (("caption", caption), ("license", clip.license)) if value}
  document = {
      "asset": {"version": "2.0", "generator": "motion_jax", "extras": about},
      "scene": 0, "scenes": [{"nodes": [skeleton.num_joints + 1]}], "nodes": nodes, "materials": materials,
      "meshes": [{"name": "mannequin", "primitives": meshes}],
      "skins": [{"skeleton": 0, "joints": list(range(skeleton.num_joints)), "inverseBindMatrices": inverse}],
      "animations": [_animation(buffer, pose, clip.fps, caption)],
      "accessors": buffer.accessors, "bufferViews": buffer.views, "buffers": [{"byteLength": len(buffer.data)}]}
  text = json.dumps(document, separators=(",", ":")).encode()
  text += b" " * (-len(text) % 4)
  chunks = struct.pack("<II", len(text), 0x4E4F534A) + text  # "JSON"
  chunks += struct.pack("<II", len(buffer.data), 0x004E4942) + bytes(buffer.data)  # "BIN"
  with atomic_path(path) as temporary:
    temporary.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
  return path


class _Buffer:
  """Collects arrays into one binary chunk, and the views and accessors that describe it."""

  def __init__(self):
    self.data, self.views, self.accessors = bytearray(), [], []

  def add(self, array, kind, shape, bounds=False, normalized=False, target=None) -> int:
    """Appends array (N, K) as accessor type `shape` of component type `kind`; returns the accessor's number."""
    array = np.ascontiguousarray(array, {_FLOAT: "<f4", _SHORT: "<u2", _BYTE: "u1"}[kind])
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


def _rest(offsets, skeleton):
  """Joint positions (J, 3) of the T-pose, soles near the ground."""
  rest = np.zeros_like(offsets)
  for chain in skeleton.chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      rest[joint] = rest[parent] + offsets[joint]
  return rest - [0, rest[:, 1].min() - 0.02, 0]


def _mesh(part, rest, skeleton):
  """Vertices, normals (V, 3), joints and weights (V, 4), triangles (F, 3) of one part in the T-pose."""
  a, b = rest[part.a] + part.a_offset, rest[part.b] + part.b_offset
  length = float(np.linalg.norm(b - a))
  axis = (b - a) / length if length > 1e-6 else np.array([0.0, 1.0, 0.0])
  slope = np.arcsin(np.clip((part.a_radius - part.b_radius) / max(length, 1e-6), -1, 1))
  # Latitudes of the rings: the ball at a up to where the cone touches it, then the ball at b from there.
  latitude = np.concatenate([np.linspace(-np.pi / 2, slope, _CAP + 1), np.linspace(slope, np.pi / 2, _CAP + 1)])
  along = np.repeat([0.0, 1.0], _CAP + 1)
  between = 0.25, 0.5, 0.75  # rings along the part, so that it can bend
  latitude = np.insert(latitude, _CAP + 1, [slope] * len(between))
  along = np.insert(along, _CAP + 1, between)
  radius = part.a_radius + (part.b_radius - part.a_radius) * along
  side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
  side /= np.linalg.norm(side)
  angle = np.linspace(0, 2 * np.pi, _AROUND, endpoint=False)
  around = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(axis, side)
  normals = np.cos(latitude)[:, None, None] * around + np.sin(latitude)[:, None, None] * axis
  points = a + (along * length)[:, None, None] * axis + radius[:, None, None] * normals
  ring, step = np.meshgrid(np.arange(len(along) - 1), np.arange(_AROUND), indexing="ij")
  here, right = ring * _AROUND + step, ring * _AROUND + (step + 1) % _AROUND
  quads = np.stack([here, right, right + _AROUND, here + _AROUND], axis=-1).reshape(-1, 4)
  triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
  first, second = _bones(part, skeleton)
  weight = along * along * (3 - 2 * along) if first != second else 0 * along
  joints = np.zeros((len(along), _AROUND, 4), np.int64)
  weights = np.zeros((len(along), _AROUND, 4))
  joints[..., 0], joints[..., 1] = first, np.where(weight > 0, second, 0)[:, None]
  weights[..., 1] = np.round(weight * 255)[:, None]
  weights[..., 0] = 255 - weights[..., 1]
  return points.reshape(-1, 3), normals.reshape(-1, 3), joints.reshape(-1, 4), weights.reshape(-1, 4), triangles


def _bones(part, skeleton):
  """The joints whose turns carry the two ends of a part: its own frame, or what moves the joint that the end is at."""
  carries = lambda joint: part.frame in (joint, skeleton.parents[joint])
  first = part.frame if carries(part.a) else part.a
  second = part.frame if carries(part.b) else skeleton.parents[part.b]
  return first, second


def _primitive(buffer, members, material):
  """Joins the meshes of one colour into a glTF primitive."""
  starts = np.cumsum([0] + [len(member[0]) for member in members[:-1]])
  points, normals, joints, weights = (np.concatenate([member[i] for member in members]) for i in range(4))
  triangles = np.concatenate([member[4] + start for member, start in zip(members, starts)])
  vertices, elements = 34962, 34963
  return {"attributes": {"POSITION": buffer.add(points, _FLOAT, "VEC3", bounds=True, target=vertices),
                         "NORMAL": buffer.add(normals, _FLOAT, "VEC3", target=vertices),
                         "JOINTS_0": buffer.add(joints, _BYTE, "VEC4", target=vertices),
                         "WEIGHTS_0": buffer.add(weights, _BYTE, "VEC4", normalized=True, target=vertices)},
          "indices": buffer.add(triangles.ravel(), _SHORT, "SCALAR", target=elements), "material": material}


def _material(name, color):
  linear = [round(float(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4), 5) for c in color]
  return {"name": name, "pbrMetallicRoughness": {"baseColorFactor": [*linear, 1.0], "metallicFactor": 0.0,
                                                 "roughnessFactor": 0.65}}


def _animation(buffer, pose, fps, name):
  times = buffer.add((np.arange(len(pose.root)) / fps)[:, None], _FLOAT, "SCALAR", bounds=True)
  samplers, channels = [], []

  def add(joint, path, values, shape):
    samplers.append({"input": times, "output": buffer.add(values, _FLOAT, shape), "interpolation": "LINEAR"})
    channels.append({"sampler": len(samplers) - 1, "target": {"node": joint, "path": path}})

  add(0, "translation", pose.root, "VEC3")
  for joint in range(pose.rotations.shape[1]):
    if np.abs(pose.rotations[:, joint, 1:]).max() > 1e-7:
      add(joint, "rotation", pose.rotations[:, joint, [1, 2, 3, 0]], "VEC4")  # glTF writes w last
    if joint and np.linalg.norm(pose.shifts[:, joint], axis=-1).max() > 5e-4:
      add(joint, "translation", pose.offsets[joint] + pose.shifts[:, joint], "VEC3")
  return {"name": name, "samplers": samplers, "channels": channels}
