"""VRMA: the nodes, and what the extension says of them. docs/formats.md says which players were tried by hand."""
import numpy as np
from pygltflib import GLTF2

from motion_jax import export
from motion_jax.export.rig import on_rig
from tests.export.test_bvh import walk
from tests.export.test_glb import world_matrices
from tests.export.test_rigs import places_of

REQUIRED = {"hips", "spine", "head", *(side + bone for side in ("left", "right") for bone in (
    "UpperLeg", "LowerLeg", "Foot", "UpperArm", "LowerArm", "Hand"))}


def test_the_human_bones_rest_in_a_t_pose_and_move_as_the_motion(tmp_path):
  clip = walk(6, 0.2)
  path = tmp_path / "walk.vrma"
  export.save(clip, path)
  gltf = GLTF2().load_binary(str(path))
  assert gltf.extensionsUsed == ["VRMC_vrm_animation"]
  bones = gltf.extensions["VRMC_vrm_animation"]["humanoid"]["humanBones"]
  assert set(bones) >= REQUIRED and gltf.extensions["VRMC_vrm_animation"]["specVersion"] == "1.0"
  assert all(gltf.nodes[bone["node"]].name == name and gltf.nodes[bone["node"]].rotation is None
             for name, bone in bones.items())
  animation, = gltf.animations
  moved = {channel.target.node for channel in animation.channels if channel.target.path == "translation"}
  assert moved == {bones["hips"]["node"]} and not any(one.target.path == "scale" for one in animation.channels)
  world = world_matrices(gltf, clip.num_frames)
  np.testing.assert_allclose(world[:, :, :3, 3], places_of(on_rig(clip, "vrm")), atol=1e-5)
