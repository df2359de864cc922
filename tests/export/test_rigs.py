"""Rigs: files with other programs' joint names hold the same motion, and are read back."""
import numpy as np
import pytest
from pygltflib import GLTF2

from motion_jax import export, rigs
from motion_jax.export.rig import on_rig
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import KIT
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from tests.export.test_bvh import walk
from tests.export.test_glb import read, world_matrices

ALL = sorted(set(rigs.all_rigs()) - {"kit"})
# Metres. Arms of a biped hang on the neck and turn with it; a Bandai figure has no third spine joint.
FAR = {"biped": 0.02, "bandai": 0.02}


def places_of(moved):
  """Joint positions (T, N, 3) of a RigMotion by forward kinematics."""
  places = np.zeros((*moved.turned.shape[:2], 3))
  for joint, parent in enumerate(moved.rig.parents):
    if joint == moved.pelvis:
      places[:, joint] = moved.root
    elif parent < 0:
      places[:, joint] = moved.ground
    else:
      places[:, joint] = places[:, parent] + rot.rotate(moved.turned[:, parent], moved.offsets[joint][None])
  return places


@pytest.mark.parametrize("name", ALL)
def test_a_bvh_of_a_rig_is_read_back(name, tmp_path):
  clip = walk(8, 0.2)
  export.save(clip, tmp_path / "plain.bvh")
  export.save(clip, tmp_path / "rig.bvh", rig=name)
  expected, found = (export.load(tmp_path / file, unit="cm") for file in ("plain.bvh", "rig.bvh"))
  assert np.abs(found.joints - expected.joints).max() < FAR.get(name, 0.001)


@pytest.mark.parametrize("name", ["mixamo", "ue5", "rigify"])
def test_the_skin_of_a_glb_is_the_same_on_every_rig(name, tmp_path):
  clip = walk(5, 0.2)
  skins = []
  for rig in (None, name):
    export.save(clip, tmp_path / "clip.glb", rig=rig)
    gltf = GLTF2().load(str(tmp_path / "clip.glb"))
    world = world_matrices(gltf, clip.num_frames)
    inverse = read(gltf, gltf.skins[0].inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    skins.append(world @ inverse)
  rig = rigs.get_rig(name)
  assert gltf.nodes[gltf.skins[0].joints[0]].name == rig.names[rig.joints["pelvis"]]
  np.testing.assert_allclose(skins[1][:, :22], skins[0], atol=1e-5)  # a root bone moves no mesh


def test_a_rest_pose_with_lowered_arms(tmp_path):
  moved = on_rig(walk(2), "ue4")
  elbow, wrist = (moved.offsets[moved.rig.joints[f"left_{part}"]] for part in ("elbow", "wrist"))
  for bone in (elbow, wrist):
    np.testing.assert_allclose(bone[1] / bone[0], -1, atol=1e-6)


def test_an_unknown_rig_and_another_skeleton_are_refused(tmp_path):
  with pytest.raises(InputError, match="did you mean|expected one of"):
    rigs.get_rig("mixammo")
  export.save(walk(30, 0.2), tmp_path / "walk.bvh", rig="kit")
  assert export.load(tmp_path / "walk.bvh").skeleton is KIT
  for name, rig in (("kit.bvh", dict(rig="mixamo")), ("kit.amass.npz", {})):
    with pytest.raises(InputError, match="HumanML3D's 22"):
      export.save(walk(4).on_skeleton(KIT), tmp_path / name, **rig)
  assert [path.name for path in tmp_path.iterdir()] == ["walk.bvh"]


def test_the_command_line_lists_and_writes_rigs(tmp_path, capsys):
  assert cli.main(["rigs"]) == 0
  assert "mixamo" in capsys.readouterr().out
  export.npz(walk(6), tmp_path / "walk.npz")
  assert cli.main(["render", f"{tmp_path}/walk.npz", "--rig", "mixamo", "--out", f"{tmp_path}/walk.bvh"]) == 0
  assert "JOINT mixamorig:LeftUpLeg" in (tmp_path / "walk.bvh").read_text()


def test_a_mapping_is_a_rigs_name_or_a_file_that_the_command_begins(tmp_path, capsys):
  clip, path, mapping = walk(8, 0.2), tmp_path / "walk.bvh", tmp_path / "mapping.json"
  export.save(clip, path, rig="mixamo")
  expected = export.load(path).joints
  np.testing.assert_allclose(export.load(path, mapping="mixamo").joints, expected, atol=1e-5)
  path.write_text(path.read_text().replace("mixamorig:LeftUpLeg", "odd"))
  with pytest.raises(InputError, match="left_hip.*motion-jax rigs FILE --write-mapping"):
    export.load(path)
  assert cli.main(["rigs", str(path), "--write-mapping", str(mapping)]) == 0
  assert "nearest: Mixamo" in capsys.readouterr().out
  text = mapping.read_text()
  assert '"left_hip": ""' in text and '"right_hip": "RightUpLeg"' in text
  mapping.write_text(text.replace('"left_hip": ""', '"left_hip": "odd"'))
  np.testing.assert_allclose(export.load(path, mapping=mapping).joints, expected, atol=1e-5)
  mapping.write_text(text.replace('"left_hip": ""', '"left_hip": "odd", "left_hip": "LeftLeg"'))
  with pytest.raises(InputError, match="left_hip twice"):
    export.load(path, mapping=mapping)
  assert cli.main(["rigs", str(tmp_path / "a.npy")]) == 1 and cli.main(["rigs", "--write-mapping", "a.json"]) == 1


@pytest.mark.parametrize("name, rig, label", [
    ("walk.bvh", "mixamo", "Mixamo"), ("walk.glb", "unity", "Unity"), ("walk.usda", "ue5", "Unreal Engine 5"),
    ("walk.vrma", None, "Unity, VRM"), ("walk.npz", None, "humanml3d"), ("walk.npy", None, "humanml3d"),
    ("walk.csv", None, "humanml3d"), ("walk.trc", None, "humanml3d"), ("walk.c3d", None, "humanml3d")])
def test_the_nearest_rig_of_every_format_that_is_read(tmp_path, capsys, name, rig, label):
  export.save(walk(8), tmp_path / name, **({"rig": rig} if rig else {}))
  mapping = tmp_path / "mapping.json"
  assert cli.main(["rigs", str(tmp_path / name), "--write-mapping", str(mapping)]) == 0
  assert f"nearest: {label}" in capsys.readouterr().out
  joints = export.load(tmp_path / name).joints
  np.testing.assert_allclose(export.load(tmp_path / name, mapping=mapping).joints, joints, atol=1e-5)
