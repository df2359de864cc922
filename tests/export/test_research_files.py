"""AMASS files: every key that readers want, and the same motion back."""
import subprocess
import sys

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.mocap.capture import forward_kinematics
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import retarget
from motion_jax.motion.skeleton import SMPL
from motion_jax.utils.errors import InputError
from tests.export.test_bvh import walk


@pytest.fixture(scope="module")
def clip():
  return walk(30, 0.2)


def check(found, expected):
  """Hands and feet as they were; SMPL's hips are not level with its pelvis, so that the trunk differs by 2 cm."""
  off = np.linalg.norm(found - expected, axis=-1).max(0)
  assert off.max() < 0.025 and off[[7, 8, 10, 11, 20, 21]].max() < 0.005


def test_an_amass_file_has_the_keys_of_all_its_readers(clip, tmp_path):
  export.save(clip, tmp_path / "walk.amass.npz")
  with np.load(tmp_path / "walk.amass.npz", allow_pickle=False) as file:
    assert file["poses"].shape == (30, 165) and {"pose_jaw", "pose_eye", "pose_hand", "trans", "betas", "num_betas",
                                                 "mocap_time_length", "pelvis_offset", "prompt"} < set(file.files)
    assert str(file["gender"]) == "neutral" and str(file["surface_model_type"]) == "smplx"
    assert file["mocap_framerate"] == file["mocap_frame_rate"] == clip.fps
    np.testing.assert_array_equal(file["poses"][:, 3:66], file["pose_body"])
    np.testing.assert_array_equal(file["poses"][:, :3], file["root_orient"])


def test_forward_kinematics_of_the_poses_give_the_motion(clip, tmp_path):
  """z up, facing +y; the pelvis at trans plus the body model's own, unturned."""
  offset = np.array([0.0, -0.35, 0.01])
  export.save(clip, tmp_path / "walk.amass.npz", pelvis_offset=offset)
  with np.load(tmp_path / "walk.amass.npz") as file:
    rotations = rot.from_vector(file["poses"][:, :66].reshape(-1, 22, 3))
    local = np.tile(SMPL.offsets, (30, 1, 1))
    local[:, 0] = file["trans"] + offset
  placed = forward_kinematics(SMPL.parents, local, rotations)[0]
  expected = retarget(clip.joints, SMPL)
  check(placed[..., [0, 2, 1]] * [-1, 1, 1], expected)


def test_files_of_amass_and_of_kimodo_are_read(clip, tmp_path):
  export.save(clip, tmp_path / "walk.amass.npz")
  with pytest.warns(UserWarning, match="neutral adult"):
    found = export.load(tmp_path / "walk.amass.npz")
  check(found.joints, retarget(clip.joints, SMPL))
  with np.load(tmp_path / "walk.amass.npz") as file:  # SMPL-X's own names alone
    keys = ("root_orient", "pose_body", "trans", "mocap_frame_rate", "pelvis_offset")
    np.savez(tmp_path / "x.npz", **{key: file[key] for key in keys})
  with pytest.warns(UserWarning, match="neutral adult"):
    np.testing.assert_array_equal(export.load(tmp_path / "x.npz").joints, found.joints)
  np.savez(tmp_path / "kimodo.npz", posed_joints=clip.joints, foot_contacts=np.zeros((30, 4)))  # states no rate
  found = export.load(tmp_path / "kimodo.npz")
  assert found.fps == 30 and (found.joints == clip.joints).all()


def test_the_command_for_a_pickle_makes_files_that_are_read(clip, tmp_path):
  """MDM's results.npy (B, J, 3, T): refused without being opened, and readable after the command of the sentence."""
  motion = clip.joints.transpose(1, 2, 0)[None]
  np.save(tmp_path / "results.npy", {"motion": motion, "lengths": [25]}, allow_pickle=True)
  with pytest.raises(InputError, match="pickled") as error:
    export.load(tmp_path / "results.npy")
  code = str(error.value).split('python -c "')[1].removesuffix('"')
  subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
  np.testing.assert_array_equal(export.load(tmp_path / "motion_0.npy").joints, clip.joints[:25])
  for name in ("gmr.pkl", "motion.pt"):
    (tmp_path / name).write_bytes(b"anything")
    with pytest.raises(InputError, match="could run code"):
      export.load(tmp_path / name)
