"""`POST /mmcp/generate`: a glTF document with the motions of a request. The skeleton is the model's own."""
import re
from types import SimpleNamespace
from typing import Any

import numpy as np

from motion_jax.control.constraints import Loop
from motion_jax.motion.looping import looped
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import SEEDS
from motion_jax_studio.mmcp import constraints
from motion_jax_studio.mmcp.capabilities import ready, skeleton_of
from motion_jax_studio.mmcp.constraints import MmcpError
from motion_jax_studio.mmcp.document import document
from motion_jax_studio.server.fields import Prompt, check_points
from motion_jax_studio.server.requests import RequestHandler
from motion_jax_studio.step_names import EXTEND, left_out

_STEPS = 500
_FIELDS = {"protocol_version", "model", "skeleton", "segments", "constraints", "duration_frames", "timing", "options"}
_OPTIONS = {"diffusion_steps", "num_samples", "seed", "post_processing", "transition_frames", "guidance", "loop",
            "without"}


def generate(body: Any, handler: RequestHandler) -> dict[str, Any]:
  """A glTF document of a request. Raises MmcpError."""
  try:
    request = _read(body, handler)
  except MmcpError:
    raise
  except InputError as error:
    raise MmcpError(422, "schema_validation", str(error)) from None
  pipeline, fps = request.pipeline, request.fps
  model, skeleton = pipeline.model, pipeline.model.stats.layout.skeleton
  # Round the ends, not each length: rounding ten lengths would add up to an error of some frames.
  ends = np.ceil(np.cumsum([count for _, count in request.segments]) * (model.fps / fps) - 1e-9)
  rows = [(prompt, float(max(count, model.frames_per_latent)) / model.fps)
          for (prompt, _), count in zip(request.segments, np.diff(ends, prepend=0))]
  control = [*request.control, Loop()] if request.control and request.loop else request.control

  def sample(seed):
    if control:
      return handler.make_multi_prompt(pipeline, rows, seed, request.cleanup, request.sampling, None, control,
                                       request.without)[0]
    return pipeline.multi_prompt(rows, seed=seed, cleanup=request.cleanup, without=request.without, **request.sampling)

  with handler.place():
    motions = [sample(request.seed + i) for i in range(request.num_samples)]
  total = sum(count for _, count in request.segments)
  joints = [_at_rate(motion.joints, model.fps, fps, total) for motion in motions]
  if request.loop and not control:
    joints = [looped(sample, fps, skeleton) for sample in joints]
  notes = {"extras": {"notes": request.notes}} if request.notes else {}
  return document(joints, fps, model, request.skeleton) | notes


def _read(body, handler):
  """The values of a request: segments as [(prompt, frames at fps)], constraints as ours, and notes about parts of them
  that have no counterpart. Raises MmcpError, or InputError for what is not of the schema."""
  limits = handler.limits
  if not isinstance(body, dict):
    raise InputError("expected a JSON object")
  if unknown := set(body) - _FIELDS:
    raise InputError(f"got the unknown field {str(min(unknown))[:60]!r}")
  version = body.get("protocol_version")
  if not isinstance(version, str) or not re.fullmatch(r"\d{1,4}\.\d{1,4}", version):
    raise InputError("protocol_version is missing, expected one such as \"1.2\"")
  if not version.startswith("1."):
    raise MmcpError(400, "version_unsupported", f"got version {version}, this server speaks 1.x")
  name = body.get("model")
  pipeline = next((slot.pipeline for slot in ready(handler) if name in (slot.model.id, slot.name)), None)
  if pipeline is None:
    raise MmcpError(400, "unknown_model", f"got the model {str(name)[:60]!r}; /capabilities lists those that are ready")
  model, skeleton = pipeline.model, pipeline.model.stats.layout.skeleton
  _check_skeleton(body.get("skeleton"), skeleton)
  timing = body.get("timing")
  fps = model.fps if timing is None else _number(timing, "fps", 1, 240, model.fps)
  segments, options = _segments(body.get("segments"), fps, limits), _options(body.get("options"), limits)
  if options["loop"] and len(segments) > 1:
    raise MmcpError(400, "invalid_options", "got several segments with loop; a loop has one segment")
  if body.get("constraints") and skeleton is not HUMANML3D:
    raise MmcpError(400, "unsupported_constraint", "this model takes no constraints")
  control, notes = constraints.read(body.get("constraints"), sum(count for _, count in segments), fps, model.fps)
  check_points(control, limits, "constraints")
  return SimpleNamespace(pipeline=pipeline, skeleton=body["skeleton"], fps=fps, segments=segments, control=control,
                         notes=notes, **options)


def _check_skeleton(given, skeleton):
  """Raises MmcpError for any skeleton but the model's own, for which alone the rotations of a reply are valid."""
  joints = given.get("joints") if isinstance(given, dict) else None
  if not isinstance(joints, list) or not all(isinstance(joint, dict) for joint in joints):
    raise InputError("skeleton.joints is missing")
  expected = skeleton_of(skeleton)["joints"]
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
    raise InputError(f"expected 1 to {limits.blocks} segments")
  segments = []
  for segment in given:
    if not isinstance(segment, dict):
      raise InputError("a segment is not an object")
    if segment.get("type") != "text":
      raise MmcpError(400, "unsupported_segment", f"got a segment {str(segment.get('type'))[:40]!r}, expected text")
    count = segment.get("duration_frames")
    if type(count) is not int or not 1 <= count <= limits.seconds * fps:
      raise InputError(f"got duration_frames {str(count)[:20]}, expected 1 to {limits.seconds * fps:.0f}")
    segments.append((Prompt.read(segment.get("prompt"), limits), count))
  if sum(count for _, count in segments) > limits.seconds * fps:
    raise MmcpError(400, "invalid_request", f"got more than {limits.seconds:g} s")
  return segments


def _options(given, limits):
  given = {} if given is None else given
  if not isinstance(given, dict) or set(given) - _OPTIONS:
    raise InputError(f"expected options of {', '.join(sorted(_OPTIONS))}")
  sampling = {"num_steps": _number(given, "diffusion_steps", 1, _STEPS, None, whole=True),
              "guidance_scale": _guidance(given.get("guidance"))}
  without = given.get("without", [])
  try:
    left = left_out(without if isinstance(without, list) else [without], EXTEND)  # an option of ours
  except InputError as error:
    raise MmcpError(400, "invalid_options", str(error)) from None
  return {"num_samples": _number(given, "num_samples", 1, limits.takes, 1, whole=True),
          "seed": _number(given, "seed", 0, SEEDS[1] - limits.takes, 0, whole=True),
          "sampling": {name: value for name, value in sampling.items() if value is not None},
          "cleanup": given.get("post_processing", True) is True, "loop": given.get("loop") is True, "without": left}


def _guidance(given):
  """The guidance scale, None where there is none."""
  if given is None:
    return None
  kind, weight = (given.get("type"), given.get("weight", [])) if isinstance(given, dict) else (None, None)
  if kind not in ("nocfg", "regular") or not isinstance(weight, list) or len(weight) != (kind == "regular"):
    raise MmcpError(400, "invalid_options", "expected guidance nocfg, or regular with one weight")
  return _number({"weight": weight[0]}, "weight", -100, 100, None) if weight else 1.0


def _number(given, name, low, high, usual, whole=False):
  value = given.get(name) if isinstance(given, dict) else None
  if value is None:
    return usual
  if type(value) is not int and (whole or type(value) is not float) or not low <= value <= high:
    raise InputError(f"got {name} {str(value)[:20]}, expected {low:g} to {high:g}")
  return value


def _at_rate(joints, fps, to_fps, count):
  """Joints at another rate, padded with the last frame to count frames."""
  resampled = resample(joints, fps, to_fps)[:count]
  return np.concatenate([resampled, np.repeat(joints[-1:], count - len(resampled), axis=0)])
