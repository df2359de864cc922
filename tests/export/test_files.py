"""save and load: what goes out comes back, and what is no motion is refused with a reason."""
import errno
import os

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.clip import Caption
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion.representations import to_features
from motion_jax.motion.skeleton import SNAPMOGEN
from motion_jax.utils.atomic import atomic_path


@pytest.fixture(scope="module")
def clip():
  one = synthetic_clips(num=2, num_frames=20)[1]
  return one.replace(meta={"seed": 7, "model": "cmdm-small", "speed": np.float32(1.5)})


def test_npz_keeps_everything(clip, tmp_path):
  features = to_features(clip.joints)
  clip = clip.replace(features=features, captions=(Caption("a person walks", 0, 0), Caption("und geht <b>", 0.1, 0.5)))
  path, = export.save(clip, tmp_path / "a.npz")
  back = export.load(path)
  np.testing.assert_array_equal(back.joints, clip.joints)
  np.testing.assert_array_equal(back.features, features)
  assert (back.fps, back.captions, back.id, back.license) == (20.0, clip.captions, clip.id, clip.license)
  assert back.meta == {"seed": 7, "model": "cmdm-small", "speed": 1.5}
  with np.load(path, allow_pickle=False) as file:
    assert {"joints", "fps", "prompt", "seed", "model_id", "skeleton", "features"} <= set(file.files)
    assert str(file["prompt"]) == "a person walks" and int(file["seed"]) == 7


@pytest.mark.parametrize("words", ["11835 requested and 11232 written", "I/O error: No space left on device (28)",
                                   "I/O error: File too large (os error 27)"])
def test_a_full_disk_has_one_error_whatever_a_library_says_of_it(words, tmp_path):
  with pytest.raises(OSError) as error, atomic_path(tmp_path / "a.npz"):
    raise RuntimeError(words)
  assert error.value.errno == errno.ENOSPC and error.value.filename == str(tmp_path / "a.npz")
  assert not list(tmp_path.iterdir())


def test_a_generated_motion_that_is_no_person_s_is_read_with_a_warning(clip, tmp_path):
  """Models that were trained little make such motions; of other sources they are refused."""
  joints = clip.joints.copy()
  joints[10:] += np.float32([12, 0, 0])
  path, = export.save(clip.replace(joints=joints, features=None), tmp_path / "a.npz")
  with pytest.warns(UserWarning, match="pelvis has moved 12 m since the frame before.*cmdm-small generated it so"):
    np.testing.assert_array_equal(export.load(path).joints, joints)
  path, = export.save(clip.replace(joints=joints, features=None, meta={}), tmp_path / "b.npz")
  with pytest.raises(ValueError, match="pelvis has moved"):
    export.load(path)


def test_npy_joints_and_features(clip, tmp_path):
  path, = export.save(clip, tmp_path / "a.npy")
  assert np.load(path, allow_pickle=False).shape == (20, 22, 3)
  np.testing.assert_array_equal(export.load(path).joints, clip.joints)
  assert export.load(path, fps=30).fps == 30
  features = to_features(clip.joints)
  np.save(tmp_path / "000000.npy", features)
  back = export.load(tmp_path / "000000.npy")
  assert back.joints.shape == (19, 22, 3) and back.features.shape == (19, 263)
  np.testing.assert_allclose(back.joints[:, 0, 1], features[:, 3], atol=1e-6)


@pytest.mark.parametrize("name, write, message", [
    ("a.npy", lambda p: np.save(p, np.zeros((5, 7))), "7 features per frame; known sizes"),
    ("a.npy", lambda p: np.save(p, np.zeros((5, 4, 3))), r"shape \(5, 4, 3\), expected joints"),
    ("a.npy", lambda p: np.save(p, np.full((5, 22, 3), np.nan)), "5 of 5 frames hold NaN"),
    ("a.npy", lambda p: np.save(p, np.array([{}], dtype=object)), "pickle"),
    ("a.npy", lambda p: np.save(p, np.array(["a"])), "expected numbers"),
    ("a.npy", lambda p: (np.save(p, np.zeros((5, 22, 3))), p.write_bytes(p.read_bytes()[:700])), "a.npy"),
    ("a.npz", lambda p: p.write_bytes(b"PK\x03\x04 and no more"), "may be cut"),
    ("a.npz", lambda p: np.savez(p, poses=np.zeros(3)), "holds poses, expected a key joints .* or poses and trans"),
    ("a.bvh", lambda p: p.write_text("HIERARCHY\nROOT a\n{\n"), "cut"),
    ("a.fbx", lambda p: p.write_bytes(b"no FBX at all"), "cannot be read as FBX .*glTF 2.0|read by ufbx"),  # the extra
])
def test_what_is_no_motion(tmp_path, name, write, message):
  write(tmp_path / name)
  with pytest.raises(ValueError, match=message):
    export.load(tmp_path / name)


def test_missing_file_and_unknown_extension(tmp_path):
  with pytest.raises(FileNotFoundError, match="there is no file"):
    export.load(tmp_path / "none.npy")
  with pytest.raises(ValueError, match=r"expected a file that ends in \.npz, \.npy, \.bvh"):
    export.load(tmp_path / "a.xyz")


def test_unwritable_places(clip, tmp_path):
  (tmp_path / "file").write_text("")
  with pytest.raises(OSError, match="cannot write .*choose a folder"):
    export.save(clip, tmp_path / "file" / "a.npy")
  (tmp_path / "a.npy").mkdir()
  with pytest.raises(IsADirectoryError, match="it is a folder"):
    export.save(clip, tmp_path / "a.npy")


def test_folders_are_made_and_nothing_is_left_half_written(clip, tmp_path, monkeypatch):
  path = tmp_path / "deep" / "er" / "a.npz"
  export.save(clip, path)
  before = path.read_bytes()

  def fail(path, **arrays):
    with open(path, "wb") as file:
      file.write(b"half")
    raise OSError("disk full")

  monkeypatch.setattr(np, "savez_compressed", fail)
  with pytest.raises(OSError, match="disk full"):
    export.save(clip, path)
  assert os.listdir(path.parent) == ["a.npz"] and path.read_bytes() == before


@pytest.mark.parametrize("layout", ["full", "snapmogen_148", "babel"])
def test_normalised_features_are_named(clip, tmp_path, layout):
  """Nothing else is suggested, for features have no unit that --unit could say."""
  features = to_features(clip.joints if layout != "snapmogen_148" else clip.on_skeleton(SNAPMOGEN).joints, layout)
  np.save(tmp_path / "a.npy", (features - features.mean(0)) / np.maximum(features.std(0), 1e-3))
  for unit in ("auto", "ft"):
    with pytest.raises(ValueError, match=r"these look like normalised features: x \* Std \+ Mean first") as error:
      export.load(tmp_path / "a.npy", unit=unit)
    assert "--unit" not in str(error.value)
  np.save(tmp_path / "b.npy", features)
  assert export.load(tmp_path / "b.npy").num_frames >= 19
