"""VRMA (VRM animation 1.0): the motion alone, for any VRM character in a browser, Unity or VTuber program.

A glTF file without a mesh whose extension says which node is which human bone. The nodes rest in VRM's T-pose without
rotations, so that a player turns each bone of its character as the node turns, and scales the hips' path by the
height of the hips. Source: vrm-c/vrm-specification, specification/VRMC_vrm_animation-1.0.
"""
import pathlib

from motion_jax.export.glb import Buffer, animation, clip_name, describe, rest_nodes, write_container
from motion_jax.export.mesh import rest_joints
from motion_jax.export.rig import on_rig, rigged


def vrma(clip, path, name=None) -> pathlib.Path:
  """Writes a clip as .vrma: rotations of VRM's human bones and the path of the hips, metres, y up, facing +z.

  name: of the animation (`glb.glb`).
  """
  moved, buffer = on_rig(clip, "vrm"), Buffer()
  nodes = rest_nodes(moved, rest_joints(rigged(clip).offsets, clip.skeleton)[0])
  asset, about = describe(clip)
  human = {name: {"node": number} for number, name in enumerate(moved.rig.names)}
  document = {
      "asset": asset, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
      "animations": [animation(buffer, moved, clip.fps, name or clip_name(clip), about)],
      "extensionsUsed": ["VRMC_vrm_animation"],
      "extensions": {"VRMC_vrm_animation": {"specVersion": "1.0", "humanoid": {"humanBones": human}}}}
  return write_container(pathlib.Path(path), document, buffer)
