"""MMCP, a protocol between animation programs and motion models: `GET /mmcp/capabilities`, `POST /mmcp/generate`.

https://animatica.ai/mmcp, version 1.2: a skeleton and text segments in, glTF with an animation for each sample out.
The skeleton is the model's own, which the capabilities contain. `extras.notes` of the document lists parts of
constraints that are not supported.
"""
import base64
import re
from typing import Any

import numpy as np

from motion_jax.control.constraints import Loop
from motion_jax.export.glb import FLOAT, Buffer
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.looping import looped
from motion_jax.motion.pose import t_pose, to_pose
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import SEEDS
from motion_jax_studio.server import mmcp_constraints
from motion_jax_studio.server.fields import check_points, check_prompt
from motion_jax_studio.server.requests import RequestHandler
from motion_jax_studio.step_names import EXTEND, left_out

VERSION, MEDIA = "1.2", "model/gltf+json"
_STEPS = 500
_OPTIONS = {"diffusion_steps", "num_samples", "seed", "post_processing", "transition_frames", "guidance", "loop",
            "without"}


class MmcpError(Exception):
  """A refusal with a code of MMCP."""

  def __init__(self, status: int, code: str, message: str) -> None:
    super().__init__(message)
    self.status, self.code = status, code

  def body(self) -> dict[str, Any]:
    return {"error": {"code": self.code, "message": str(self), "details": {"status": self.status}}}


def capabilities(handler: RequestHandler) -> dict[str, Any]:
  """The capabilities of the models that are ready."""
  models = [_spec(slot.model, handler.limits) for slot in handler.library.slots.values()
            if slot.ready.is_set() and slot.model is not None and slot.model.can("multi_prompt")]
  return {"protocol_version": VERSION, "rotation_format": "quaternion_xyzw",
          "coordinate_system": "right_handed_y_up", "units": "meters", "response_formats": ["gltf_2.0_json"],
          "models": models}


def _spec(model, limits):
  skeleton = model.stats.layout.skeleton
  return {"id": model.id, "fps": model.fps, "canonical_skeleton": _skeleton(skeleton), "supports_retargeting": False,
          "supports_async": False, "supports_segment_seed": False, "supports_loop": True, "supports_batch": False,
          "supports_trajectory": False, "supported_segments": ["text"],
          "supported_constraints": list(mmcp_constraints.KINDS) if skeleton is HUMANML3D else [],
          "supported_guidance_types": ["nocfg", "regular"],
          "predicted_contact_joints": [skeleton.joints[i] for i in skeleton.left_feet + skeleton.right_feet],
          "native_clip_seconds": model.config.data.max_frames / model.fps, "chunking": "none",
          "recommended_max_duration_seconds": limits.seconds,
          "limits": {"max_duration_seconds": limits.seconds, "max_num_samples": limits.takes,
                     "max_constraints_per_request": mmcp_constraints.MOST, "max_prompt_length": limits.prompt,
                     "max_request_bytes": limits.body_bytes, "max_batch_size": 1}}


def _skeleton(skeleton):
  offsets = t_pose(skeleton) * skeleton.unit
  return {"joints": [{"name": name, "parent": skeleton.joints[parent] if parent >= 0 else None,
                      "rest_translation": np.round(offsets[i], 6).tolist(), "rest_rotation": [0.0, 0.0, 0.0, 1.0]}
                     for i, (name, parent) in enumerate(zip(skeleton.joints, skeleton.parents))],
          "coordinate_system": "right_handed_y_up", "units": "meters"}


def generate(body: Any, handler: RequestHandler) -> dict[str, Any]:
  """A glTF document of a request. Raises MmcpError."""
  if not isinstance(body, dict):
    raise MmcpError(422, "schema_validation", "expected a JSON object")
  unknown = set(body) - {"protocol_version", "model", "skeleton", "segments", "constraints", "duration_frames",
                         "timing", "options"}
  if unknown:
    raise MmcpError(422, "schema_validation", f"got the unknown field {str(min(unknown))[:60]!r}")
  version = body.get("protocol_version")
  if not isinstance(version, str) or not re.fullmatch(r"\d{1,4}\.\d{1,4}", version):
    raise MmcpError(422, "schema_validation", "protocol_version is missing, expected one such as \"1.2\"")
  if not version.startswith("1."):
    raise MmcpError(400, "version_unsupported", f"got version {version}, this server speaks 1.x")
  pipeline = _pipeline(body.get("model"), handler)
  model = pipeline.model
  _check_skeleton(body.get("skeleton"), model.stats.layout.skeleton)
  timing = body.get("timing")
  fps = model.fps if timing is None else _number(timing, "fps", 1, 240, model.fps)
  segments = _segments(body.get("segments"), fps, handler.limits)
  options = _options(body.get("options"), handler.limits)
  if options["loop"] and len(segments) > 1:
    raise MmcpError(400, "invalid_options", "got several segments with loop; a loop has one segment")
  sampling = {"num_steps": options["steps"], "guidance_scale": options["guidance"]}
  sampling = {name: value for name, value in sampling.items() if value is not None}
  # Round the ends, not each length: rounding ten lengths would add up to an error of some frames.
  ends = np.ceil(np.cumsum([count for _, count in segments]) * (model.fps / fps) - 1e-9)
  rows = [(prompt, float(max(count, model.frames_per_latent)) / model.fps)
          for (prompt, _), count in zip(segments, np.diff(ends, prepend=0))]
  total = sum(count for _, count in segments)
  control, notes = _constraints(body.get("constraints"), total, fps, model, handler.limits)
  with handler.place():
    if control:
      wanted = [*control, *([Loop()] if options["loop"] else [])]
      motions = [handler.make_multi_prompt(pipeline, rows, options["seed"] + i, options["cleanup"], sampling, None,
                                        wanted, options["without"])[0] for i in range(options["samples"])]
    else:
      motions = [pipeline.multi_prompt(rows, seed=options["seed"] + i, cleanup=options["cleanup"],
                                    without=options["without"], **sampling) for i in range(options["samples"])]
  joints = [_at_rate(motion.joints, model.fps, fps, total) for motion in motions]
  if options["loop"] and not control:
    joints = [looped(sample, fps, model.stats.layout.skeleton) for sample in joints]
  return _document(joints, fps, model, body["skeleton"]) | ({"extras": {"notes": notes}} if notes else {})


def _constraints(given, total, fps, model, limits):
  """(our constraints, notes about unsupported parts)."""
  if given and model.stats.layout.skeleton is not HUMANML3D:
    raise MmcpError(400, "unsupported_constraint", "this model takes no constraints")
  try:
    constraints, notes = mmcp_constraints.read(given, total, fps, model.fps)
    check_points(constraints, limits, "constraints")
  except mmcp_constraints.ConstraintError as error:
    raise MmcpError(error.status, error.code, str(error)) from None
  except InputError as error:
    raise MmcpError(422, "schema_validation", str(error)) from None
  return constraints, notes


def _pipeline(name, handler):
  for slot in handler.library.slots.values():
    if slot.ready.is_set() and slot.model is not None and slot.model.can("multi_prompt") and (
        name in (slot.model.id, slot.name)):
      return slot.pipeline
  raise MmcpError(400, "unknown_model", f"got the model {str(name)[:60]!r}; /capabilities lists those that are ready")


def _check_skeleton(given, skeleton):
  """Raises MmcpError for any skeleton but the model's own, for which alone the rotations of a reply are valid."""
  joints = given.get("joints") if isinstance(given, dict) else None
  if not isinstance(joints, list) or not all(isinstance(joint, dict) for joint in joints):
    raise MmcpError(422, "schema_validation", "skeleton.joints is missing")
  expected = _skeleton(skeleton)["joints"]
  same = len(joints) == len(expected) and all(
      (a.get("name"), a.get("parent")) == (b["name"], b["parent"]) and _near(a.get("rest_rotation"), b["rest_rotation"])
      and _near(a.get("rest_translation"), b["rest_translation"], along=True) for a, b in zip(joints, expected))
  if not same:
    raise MmcpError(400, "retargeting_unsupported", "send the model's canonical_skeleton of /capabilities")


def _near(given, expected, along=False):
  """Whether vectors are equal; along: except for their length."""
  if not isinstance(given, list) or len(given) != len(expected) or not all(type(x) in (int, float) for x in given):
    return False
  a, b = np.array(given, float), np.array(expected, float)
  if along:
    a, b = (x / max(np.linalg.norm(x), 1e-9) for x in (a, b))
    return not b.any() or bool(np.abs(a - b).max() < 0.02)
  return bool(np.abs(a - b).max() < 1e-3)


def _segments(given, fps, limits):
  """[(prompt, frames)]."""
  if not isinstance(given, list) or not given or len(given) > limits.blocks:
    raise MmcpError(422, "schema_validation", f"expected 1 to {limits.blocks} segments")
  segments = []
  for segment in given:
    if not isinstance(segment, dict):
      raise MmcpError(422, "schema_validation", "a segment is not an object")
    if segment.get("type") != "text":
      raise MmcpError(400, "unsupported_segment", f"got a segment {str(segment.get('type'))[:40]!r}, expected text")
    count = segment.get("duration_frames")
    if type(count) is not int or not 1 <= count <= limits.seconds * fps:
      raise MmcpError(422, "schema_validation", f"got duration_frames {str(count)[:20]}, expected 1 to "
                      f"{limits.seconds * fps:.0f}")
    try:
      segments.append((check_prompt(segment.get("prompt"), limits), count))
    except InputError as error:
      raise MmcpError(422, "schema_validation", str(error)) from None
  if sum(count for _, count in segments) > limits.seconds * fps:
    raise MmcpError(400, "invalid_request", f"got more than {limits.seconds:g} s")
  return segments


def _options(given, limits):
  given = {} if given is None else given
  if not isinstance(given, dict) or set(given) - _OPTIONS:
    raise MmcpError(422, "schema_validation", f"expected options of {', '.join(sorted(_OPTIONS))}")
  guidance, scale = given.get("guidance"), None
  if guidance is not None:
    kind = guidance.get("type") if isinstance(guidance, dict) else None
    weight = guidance.get("weight", []) if isinstance(guidance, dict) else None
    if kind not in ("nocfg", "regular") or not isinstance(weight, list) or len(weight) != (kind == "regular"):
      raise MmcpError(400, "invalid_options", "expected guidance nocfg, or regular with one weight")
    scale = _number({"weight": weight[0]}, "weight", -100, 100, None) if weight else 1.0
  flag = lambda name, usual: given.get(name, usual) is True
  return {"samples": _number(given, "num_samples", 1, limits.takes, 1, whole=True),
          "seed": _number(given, "seed", 0, SEEDS[1] - limits.takes, 0, whole=True), "guidance": scale,
          "steps": _number(given, "diffusion_steps", 1, _STEPS, None, whole=True),
          "cleanup": flag("post_processing", True), "loop": flag("loop", False),
          "without": _steps(given.get("without", []))}


def _steps(given):
  """The steps to leave out, an option of ours."""
  try:
    return left_out(given if isinstance(given, list) else [given], EXTEND)
  except InputError as error:
    raise MmcpError(400, "invalid_options", str(error)) from None


def _number(given, name, low, high, usual, whole=False):
  value = given.get(name) if isinstance(given, dict) else None
  if value is None:
    return usual
  if type(value) is not int and (whole or type(value) is not float) or not low <= value <= high:
    raise MmcpError(422, "schema_validation", f"got {name} {str(value)[:20]}, expected {low:g} to {high:g}")
  return value


def _at_rate(joints, fps, to_fps, count):
  """Joints at another rate, padded with the last frame to count frames."""
  resampled = resample(joints, fps, to_fps)[:count]
  return np.concatenate([resampled, np.repeat(joints[-1:], count - len(resampled), axis=0)])


def _document(samples, fps, model, skeleton):
  """A glTF document with an animation for each sample (T, J, 3)."""
  ours, buffer = model.stats.layout.skeleton, Buffer()
  times = buffer.add((np.arange(len(samples[0])) / fps)[:, None], FLOAT, "SCALAR", bounds=True)
  feet = [ours.joints[i] for i in ours.left_feet + ours.right_feet]
  animations, about_samples = [], []
  for number, joints in enumerate(samples):
    pose = to_pose(joints, ours, fps)
    tracks = [("rotation", i, buffer.add(pose.rotations[:, i, [1, 2, 3, 0]], FLOAT, "VEC4"))
              for i in range(ours.num_joints)]
    tracks.append(("translation", 0, buffer.add(pose.root * ours.unit, FLOAT, "VEC3")))
    animations.append({
        "name": f"sample_{number}",
        "samplers": [{"input": times, "output": output, "interpolation": "LINEAR"} for _, _, output in tracks],
        "channels": [{"sampler": i, "target": {"node": node, "path": path}}
                     for i, (path, node, _) in enumerate(tracks)]})
    stands = feet_stand(joints, fps, ours, floor=0.0)
    about_samples.append({"name": f"sample_{number}", "num_frames": len(joints), "chunk_boundaries": [],
                          "foot_contacts": {name: stands[:, i].tolist() for i, name in enumerate(feet)}})
  nodes = [{"name": joint["name"], "translation": joint["rest_translation"], "rotation": joint["rest_rotation"]}
           for joint in skeleton["joints"]]
  for child, parent in enumerate(ours.parents):
    if parent >= 0:
      nodes[parent].setdefault("children", []).append(child)
  uri = "data:application/octet-stream;base64," + base64.b64encode(buffer.data).decode()
  about = {"version": VERSION, "model": model.id, "fps": fps, "samples": about_samples}
  return {"asset": {"version": "2.0", "generator": "motion_jax"}, "scene": 0, "scenes": [{"nodes": [0]}],
          "nodes": nodes, "skins": [{"name": "skin", "joints": list(range(len(nodes)))}], "animations": animations,
          "accessors": buffer.accessors, "bufferViews": buffer.views,
          "buffers": [{"byteLength": len(buffer.data), "uri": uri}],
          "extensionsUsed": ["MMCP_motion"], "extensions": {"MMCP_motion": about}}
