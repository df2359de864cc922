"""Rigged characters for the page's viewer: what programs export, what is wrong with some, and a motion that fits."""
import json
import struct

import numpy as np
import pytest

from motion_jax.data.clip import Clip
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D
from tests.export import characters as boxes
from tests.export.characters import mirrored, rig_joints, two_bodies, with_vrm

BENDS = {"pelvis": ("y", 0.9), "spine1": ("x", 0.3), "left_hip": ("x", -1.4), "left_knee": ("x", 1.2),
         "right_hip": ("x", -0.3), "right_knee": ("x", 0.5), "left_shoulder": ("z", 0.9), "right_shoulder": ("z", 1.1),
         "right_elbow": ("y", 1.3), "neck": ("x", 0.2)}


def moving(rest):
  """A clip of a body with these joints at rest (22, 3) that kicks, raises its arms, turns and bows."""
  frames = []
  for w in np.sin(np.linspace(0, 3, 30)):
    turned, at = [], np.zeros((22, 3))
    for j, (joint, parent) in enumerate(zip(HUMANML3D.joints, HUMANML3D.parents)):
      axis, angle = BENDS.get(joint, ("x", 0.0))
      above = turned[parent] if j else np.array([1.0, 0, 0, 0])
      turned.append(rot.multiply(above, rot.about_axis(np.array(angle * w), axis)))
      at[j] = at[parent] + rot.rotate(above, rest[j] - rest[parent]) if j else 0
    frames.append(at)
  joints = frames + np.linspace([0, 0, 0], [0.5, 0, 1], 30)[:, None]
  return Clip((joints - [0, joints[..., 1].min(), 0]).astype(np.float32), 20.0)


CHARACTERS = {  # what each is: names, rest pose, unit, axes
    "mixamo.glb": dict(scale=0.01, rolls=2, armature=np.array([np.sqrt(0.5), -np.sqrt(0.5), 0, 0])),
    "unreal.glb": dict(rig="ue5", rolls=1), "unity.glb": dict(rig="unity", size=0.4),
    "one.vrm": dict(rig="vrm", change=with_vrm(1)),
    "zero.vrm": dict(rig="vrm", change=with_vrm(0), raised={rig_joints("vrm")["pelvis"]: (0.0, 0.0, 1.0, 0.0)}),
    "short.glb": dict(rig="lafan", size=3.0, leave_out=("Head", "Neck"))}
REFUSED = {  # a file's name: what is wrong with it, or how its bytes are damaged, and words of the sentence
    "skin.glb": (dict(change=lambda document: document.pop("skins")), "has no skin"),
    "legs.glb": (dict(leave_out=("LeftLeg", "LeftFoot")), "has no left leg"),
    "two.glb": (dict(change=two_bodies), "has two humanoids"), "mirrored.glb": (dict(change=mirrored), "is mirrored"),
    "cut.glb": (lambda data: data[:3000], "is cut off"),
    "none.glb": (lambda data: b"no glb at all, but long enough", "is no binary glTF"),
    "broken.glb": (lambda data: data.replace(b'"asset"', b'"asset", '), "not valid")}


def character(folder, rest, **about):
  """The bytes of a character with the proportions of joints at rest (22, 3)."""
  with pytest.MonkeyPatch.context() as patch:
    patch.setattr(boxes, "HALF", 1e-4)  # soles where the motion has the floor
    boxes.write_character(folder / "body.glb", Clip(rest[None].repeat(2, axis=0), 20.0), **about)
  return (folder / "body.glb").read_bytes()


def with_meshopt(data):
  """The bytes of a .glb with the attributes of its meshes compressed (EXT_meshopt_compression)."""
  length, = struct.unpack_from("<I", data, 12)
  document, binary = json.loads(data[20:20 + length]), data[28 + length:]
  used = {accessor for mesh in document["meshes"] for primitive in mesh["primitives"]
          for accessor in primitive["attributes"].values()}
  for number in used:
    accessor = document["accessors"][number]
    view = document["bufferViews"][accessor["bufferView"]]
    stride = view.get("byteStride") or {5121: 1, 5123: 2, 5126: 4}[accessor["componentType"]] * {
        "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor["type"]]
    begin = view.get("byteOffset", 0)
    rows = np.frombuffer(binary[begin:begin + view["byteLength"]], np.uint8).reshape(-1, stride)
    packed, offset = _meshopt(rows), len(binary) + -len(binary) % 4
    binary = binary.ljust(offset, b"\0") + packed
    view["extensions"] = {"EXT_meshopt_compression": {
        "buffer": 0, "byteOffset": offset, "byteLength": len(packed), "byteStride": stride, "count": len(rows),
        "mode": "ATTRIBUTES"}}
  for key in ("extensionsUsed", "extensionsRequired"):
    document[key] = [*document.get(key, []), "EXT_meshopt_compression"]
  document["buffers"][0]["byteLength"] = len(binary)
  text = json.dumps(document).encode()
  text, binary = text.ljust(len(text) + -len(text) % 4), binary.ljust(len(binary) + -len(binary) % 4, b"\0")
  head = struct.pack("<III", 0x46546C67, 2, 28 + len(text) + len(binary))
  return (head + struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942)
          + binary)


def _meshopt(rows):
  """Rows of bytes (N, stride) in the vertex format of meshoptimizer, version 0, every group of 16 as it is."""
  count, stride = rows.shape
  per_block, out = min(8192 // stride & ~15, 256), b"\xa0"
  for begin in range(0, count, per_block):
    block = rows[begin:begin + per_block].astype(np.int16)
    before = np.concatenate([rows[max(begin - 1, 0)][None].astype(np.int16), block[:-1]])
    delta = (block - before).astype(np.int8)
    coded = ((delta << 1) ^ (delta >> 7)).astype(np.uint8)
    coded = np.concatenate([coded, np.zeros((-len(coded) % 16, stride), np.uint8)])
    groups = len(coded) // 16
    for column in coded.T:
      out += b"\xff" * ((groups + 3) // 4) + column.tobytes()
  return out + rows[0].tobytes().rjust(max(stride, 32), b"\0")
