"""Motions as JSON and blocks of a stream as bytes (docs/protocol.md)."""
import base64
import binascii
import struct
from typing import Any, NamedTuple

import numpy as np

from motion_jax.data.clip import Caption, Clip
from motion_jax.models.results import Motion
from motion_jax.motion import plausibility
from motion_jax.motion.skeleton import SKELETONS
from motion_jax.utils.errors import InputError
from motion_jax.utils.json_values import plain

MAGIC, VERSION = b"MJXS", 1
_HEADER = struct.Struct("<4sHHIIIHHIIIff")  # 44 bytes and 4 of padding, for an alignment of 16
HEADER_BYTES = 48
POSES = b"MJXP"
_POSES = struct.Struct("<4sHHIIIHHfI")  # 32 bytes


class Block(NamedTuple):
  """A block of a stream; docs/protocol.md describes the fields."""
  sequence: int
  run: int
  first_frame: int
  words: int
  begun: int
  milliseconds: float
  fps: float
  joints: np.ndarray    # (n, J, 3) float32, metres
  contacts: np.ndarray  # (n, 4) bool


def pack(block: Block) -> bytes:
  """A block as bytes. Joints are float16 relative to the place of the root on the ground, a float32: they are exact to
  half a millimetre anywhere."""
  joints = np.asarray(block.joints, np.float32)
  ground = np.ascontiguousarray(joints[:, 0, [0, 2]], "<f4")
  body = joints - np.stack([ground[:, 0], np.zeros(len(ground)), ground[:, 1]], -1)[:, None]
  header = _HEADER.pack(MAGIC, VERSION, HEADER_BYTES, block.sequence, block.run, block.first_frame, *joints.shape[:2],
                        block.words, block.first_frame + len(joints), block.begun, block.milliseconds, block.fps)
  return b"".join([header.ljust(HEADER_BYTES, b"\0"), ground.tobytes(), body.astype("<f2").tobytes(),
                   np.asarray(block.contacts, np.uint8).tobytes()])


def pack_poses(rows: np.ndarray, sequence: int, run: int, first: int, fps: float) -> bytes:
  """Poses (N, W), rows `first` on of the run, that belong to the block `sequence`, as bytes."""
  header = _POSES.pack(POSES, VERSION, _POSES.size, sequence, run, first, *rows.shape, fps, 0)
  return header + np.ascontiguousarray(rows, "<f4").tobytes()


NO_MOTION = "got no motion, expected an object with shape, joints and fps as /v1/generate returns it"
SCHEMA = {"type": "object", "required": ["shape", "fps", "joints"], "properties": {
    "shape": {"type": "array", "items": {"type": "integer"}, "minItems": 3, "maxItems": 3,
              "description": "[frames, joints, 3]"},
    "fps": {"type": "number"},
    "joints": {"type": "string", "contentEncoding": "base64", "description": "float32, little endian, metres, y up"},
    "skeleton": {"type": "string", "enum": list(SKELETONS)}, "id": {"type": "string"}, "captions": {"type": "array"},
    "meta": {"type": "object"}, "source": {"type": "string"}, "license": {"type": "string"}}}


def to_json(motion: Clip) -> dict[str, Any]:
  """A motion as JSON: joints are float32 in base64."""
  joints = np.ascontiguousarray(motion.joints, "<f4")
  return {"id": motion.id, "fps": motion.fps, "skeleton": motion.skeleton.name, "shape": list(joints.shape),
          "joints": base64.b64encode(joints.tobytes()).decode("ascii"), "source": motion.source,
          "license": motion.license,
          "captions": [{"text": c.text, "start": c.start, "end": c.end} for c in motion.captions],
          "meta": plain(motion.meta)}


def from_json(value: Any, longest: int) -> Motion:
  """A motion from JSON, of at most `longest` frames. Raises InputError for invalid fields or an implausible motion."""
  if not isinstance(value, dict):
    raise InputError(NO_MOTION)
  shape, fps, name = value.get("shape"), value.get("fps"), value.get("skeleton", "humanml3d")
  if not isinstance(name, str) or name not in SKELETONS:
    raise InputError(f"got the skeleton {str(name)[:60]!r}, expected one of {', '.join(SKELETONS)}")
  skeleton = SKELETONS[name]
  whole = isinstance(shape, list) and len(shape) == 3 and all(type(n) is int for n in shape)
  if not whole or not 1 <= shape[0] <= longest or shape[1:] != [skeleton.num_joints, 3]:
    raise InputError(f"got a motion of shape {str(shape)[:60]}, expected [frames, {skeleton.num_joints}, 3] of 1 to "
                     f"{longest:,} frames")
  if type(fps) not in (int, float):
    raise InputError(f"got {str(fps)[:60]!r} frames a second, expected a number such as 20")
  plausibility.check_rate(fps, "the motion")
  try:
    data = base64.b64decode(value.get("joints", ""), validate=True)
  except (binascii.Error, ValueError, TypeError):
    raise InputError("got joints that are no base64, expected float32 values as /v1/generate returns them") from None
  if len(data) != 4 * shape[0] * shape[1] * 3:
    raise InputError(f"got {len(data):,} bytes of joints, a motion of shape {shape} has {12 * shape[0] * shape[1]:,}; "
                     "the request is incomplete")
  joints = np.frombuffer(data, "<f4").reshape(shape)
  captions, meta = value.get("captions", []), value.get("meta", {})
  if not isinstance(captions, list) or not isinstance(meta, dict):
    raise InputError("got captions or meta of another kind than a list and an object")
  plausibility.check(joints, skeleton, fps, "the motion")
  text = lambda key, usual: value[key][:200] if isinstance(value.get(key), str) else usual
  return Motion(joints.astype(np.float32), float(fps), tuple(map(_caption, captions[:1000])), id=text("id", "motion"),
                source=text("source", ""), license=text("license", ""), skeleton=skeleton, meta=meta)


def _caption(row):
  number = lambda value: type(value) in (int, float) and 0 <= value < 1e9
  row = row if isinstance(row, dict) else {}
  text, start, end = row.get("text"), row.get("start", 0.0), row.get("end", 0.0)
  if not isinstance(text, str) or not number(start) or not number(end):
    raise InputError("got a caption without text, start and end in seconds")
  return Caption(text[:5000], float(start), float(end))
