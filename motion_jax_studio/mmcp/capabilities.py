"""`GET /mmcp/capabilities`: the models that are ready, with their skeletons and limits."""
from typing import Any

import numpy as np

from motion_jax.motion.pose import t_pose
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax_studio.mmcp import constraints
from motion_jax_studio.server.requests import RequestHandler

VERSION = "1.2"


def ready(handler: RequestHandler) -> list[Any]:
  """The `ModelSlot`s of models that can be used."""
  return [slot for slot in handler.library.slots.values() if slot.ready.is_set() and slot.can("multi_prompt")]


def capabilities(handler: RequestHandler) -> dict[str, Any]:
  """The capabilities of the models that are ready."""
  return {"protocol_version": VERSION, "rotation_format": "quaternion_xyzw",
          "coordinate_system": "right_handed_y_up", "units": "meters", "response_formats": ["gltf_2.0_json"],
          "models": [_spec(slot.model, handler.limits) for slot in ready(handler)]}


def _spec(model, limits):
  skeleton = model.stats.layout.skeleton
  return {"id": model.id, "fps": model.fps, "canonical_skeleton": skeleton_of(skeleton), "supports_retargeting": False,
          "supports_async": False, "supports_segment_seed": False, "supports_loop": True, "supports_batch": False,
          "supports_trajectory": False, "supported_segments": ["text"],
          "supported_constraints": list(constraints.KINDS) if skeleton is HUMANML3D else [],
          "supported_guidance_types": ["nocfg", "regular"],
          "predicted_contact_joints": [skeleton.joints[i] for i in skeleton.left_feet + skeleton.right_feet],
          "native_clip_seconds": model.config.data.max_frames / model.fps, "chunking": "none",
          "recommended_max_duration_seconds": limits.seconds,
          "limits": {"max_duration_seconds": limits.seconds, "max_num_samples": limits.takes,
                     "max_constraints_per_request": constraints.MOST, "max_prompt_length": limits.prompt,
                     "max_request_bytes": limits.body_bytes, "max_batch_size": 1}}


def skeleton_of(skeleton: Skeleton) -> dict[str, Any]:
  """A skeleton in a T-pose, as MMCP describes it."""
  offsets = t_pose(skeleton) * skeleton.unit
  return {"joints": [{"name": name, "parent": skeleton.joints[parent] if parent >= 0 else None,
                      "rest_translation": np.round(offsets[i], 6).tolist(), "rest_rotation": [0.0, 0.0, 0.0, 1.0]}
                     for i, (name, parent) in enumerate(zip(skeleton.joints, skeleton.parents))],
          "coordinate_system": "right_handed_y_up", "units": "meters"}
