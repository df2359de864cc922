"""Motions as glTF with an animation for each sample, and MMCP's extension that describes them."""
import base64
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.export.glb import FLOAT, Buffer
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.pose import to_pose
from motion_jax_studio.mmcp.capabilities import VERSION


def document(samples: Sequence[np.ndarray], fps: float, model: Any, skeleton: dict[str, Any]) -> dict[str, Any]:
  """A glTF document with an animation for each sample (T, J, 3); skeleton: of the request, whose bones it has."""
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
