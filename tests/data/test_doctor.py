"""The doctor finds each fault that we make, tells what to do, and finds none in a healthy folder."""
import json
import shutil

import numpy as np
import pytest

from motion_jax.data import checks, doctor
from motion_jax.data.datasets.archive import read_archive
from motion_jax.data.datasets.humanml3d import write_folder
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D
from tests.data.test_build import write_archive


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
  out = tmp_path_factory.mktemp("data") / "set"
  write_folder(synthetic_clips(0, 10, num_frames=60), out)
  return out


@pytest.fixture
def folder(healthy, tmp_path):
  shutil.copytree(healthy, tmp_path / "set")
  return tmp_path / "set"


def _vectors(folder, name, change):
  """Changes features and remakes the joints from them."""
  path = folder / "new_joint_vecs" / f"{name}.npy"
  np.save(path, change(np.load(path)))
  (folder / "new_joints" / f"{name}.npy").unlink(missing_ok=True)


def _append(folder, split, name):
  path = folder / f"{split}.txt"
  path.write_text(f"{path.read_text()}{name}\n")


def _set(array, index, value):
  array = array.copy()
  array[index] = value
  return array


def _scale(name, factor):
  return lambda f: np.save(f / name, np.load(f / name) * np.asarray(factor, np.float32))


def test_healthy_folder(healthy):
  report = doctor.examine(healthy)
  assert report.ok and not [f for f in report.findings if f.level != "note"], doctor.format_report(report)
  text = doctor.format_report(report)
  assert "20 (10 mirrored), train 12, val 4, test 4" in text and "healthy" in text and "263" in text


def test_captions_of_the_test_split_in_train_are_counted(healthy):
  assert "test captions in train" in dict(doctor.examine(healthy).facts)
  assert checks.shared_captions({"train": ["a b.", "c"], "test": ["A  b", "d", "D."], "val": ["c"]}) == [
      ("test captions in train", "1 of 2 different ones (50%), word for word"),
      ("val captions in train", "1 of 1 different ones (100%), word for word")]


def test_healthy_archive(tmp_path):
  report = doctor.examine(write_archive(tmp_path / "toy"))
  assert report.ok and not [f for f in report.findings if f.level == "error"], doctor.format_report(report)


BLOCKS = np.repeat([1 / 25, 1, 1, 1 / 25], [4, 63, 192, 4])


@pytest.mark.parametrize("damage, level, what", [
    (lambda f: (f / "new_joint_vecs" / "000001.npy").unlink(), "error", "ids without a motion file"),
    (lambda f: (f / "texts" / "000001.txt").unlink(), "error", "motions without a text file"),
    (lambda f: (f / "texts" / "000001.txt").write_text(""), "error", "text files without a caption"),
    (lambda f: (f / "texts" / "000001.txt").write_text("walks#walk/VERB#9#x"), "error", "text files that cannot"),
    (lambda f: (f / "texts" / "000001.txt").write_text("walks##0.0#0.0"), "warning", "captions without tokens"),
    (lambda f: (f / "texts" / "000001.txt").write_text("walks#walk/VERB#9#10"), "warning", "time tags beyond"),
    (lambda f: _append(f, "test", "000001"), "error", "ids in two splits"),
    (lambda f: (f / "test.txt").write_text("000004\n000009\nM000009\n"), "warning", "motions in no split"),
    (lambda f: (f / "train.txt").unlink(), "error", "no train.txt"),
    (lambda f: _vectors(f, "000001", lambda x: _set(x, (3, 7), np.nan)), "error", "features with NaN"),
    (lambda f: _vectors(f, "000001", lambda x: x[:0]), "error", "clips of no rows"),
    (lambda f: _vectors(f, "000001", lambda x: x[:, :67]), "error", "features that are not (rows, 263)"),
    (lambda f: (f / "new_joint_vecs" / "000001.npy").write_bytes(b"\x93NUMPY"), "error", "files that cannot be read"),
    (lambda f: np.save(f / "new_joints" / "000001.npy", np.zeros((59, 22, 3), np.float32)), "error",
     "joints that do not belong"),
    (lambda f: _vectors(f, "000001", lambda x: x - 0.2 * np.isin(np.arange(263), [3, *range(5, 67, 3)])), "warning",
     "feet over 8 cm below"),
    (lambda f: _vectors(f, "000000", lambda x: _set(x, np.s_[:, 1], 0.05)), "warning", "feet that slide"),
    (lambda f: _vectors(f, "000001", lambda x: _set(x, np.s_[30, 13], 2.0)), "warning", "bones that change"),
    (lambda f: _vectors(f, "000001", lambda x: _set(x, np.s_[:, 4:67], 100 * x[:, 4:67])), "error",
     "joints that are no person's"),
    (lambda f: _vectors(f, "000001", lambda x: _set(x, np.s_[:, 4:67], 1.1 * x[:, 4:67])), "warning",
     "bones over 2 cm"),
    (lambda f: shutil.copy(f / "new_joint_vecs" / "000001.npy", f / "new_joint_vecs" / "000004.npy"), "error",
     "equal motions in different splits"),
    (lambda f: (f / "Mean.npy").unlink(), "error", "no Mean.npy"),
    (lambda f: np.save(f / "Std.npy", np.ones(67)), "error", "Std.npy is (67,)"),
    (lambda f: np.save(f / "Std.npy", np.zeros(263)), "error", "not positive"),
    (lambda f: np.save(f / "Std.npy", np.linspace(1, 2, 263)), "error", "differs inside a block"),
    (_scale("Std.npy", 2), "error", "not this data's"),
    (_scale("Std.npy", np.where(BLOCKS < 1, 1 / 5, 1)), "error", "a fifth of the data's"),
    (lambda f: np.save(f / "Std.npy", np.repeat(checks._EVALUATOR_STD, [1, 2, 1, 63, 126, 66, 4])), "error",
     "the evaluator's"),
    (lambda f: np.save(f / "Std.npy", np.repeat(checks._OFFICIAL_STD, [1, 2, 1, 63, 126, 66, 4])), "warning",
     "official HumanML3D's"),
    (lambda f: (f / "dataset.json").write_text(json.dumps({"fps": 30})), "warning", "30 frames a second"),
])
def test_each_fault_is_found(folder, damage, level, what):
  damage(folder)
  report = doctor.examine(folder)
  found = [finding for finding in report.findings if what in finding.what]
  assert found and found[0].level == level, doctor.format_report(report)
  assert found[0].advice and report.ok == (not any(finding.level == "error" for finding in report.findings))


def test_clips_too_short_to_be_used(tmp_path):
  """How many of which split, and that they stay unused; a folder with many of them is not called healthy."""
  clips = [clip.replace(joints=clip.joints[:rows + 1], split="train")
           for clip, rows in zip(synthetic_clips(0, 6, num_frames=60), (15, 15, 30, 50, 55, 59))]
  write_folder(clips, tmp_path / "some", mirror=False)
  report = doctor.examine(tmp_path / "some")
  text = " ".join(doctor.format_report(report).split())
  assert "3 of 6 train clips have less than 40 rows and stay unused" in text and report.ok, text
  assert "clips of less than 20 (2 of these)" in text and "(1 warning, " in text
  assert "usable: read the warnings before training" in text and "healthy" not in text
  write_folder(clips[:3], tmp_path / "all", mirror=False)
  report = doctor.examine(tmp_path / "all")
  assert not report.ok and "3 of 3 train clips" in doctor.format_report(report)


@pytest.mark.parametrize("degrees, level", [(0, ""), (50, ""), (80, "warning"), (180, "error")])
def test_shoulders_are_compared_with_hips(degrees, level):
  """A twist that people reach passes; a trunk turned further does not, whichever way the body faces."""
  joints = np.asarray(synthetic_clips(0, 1, num_frames=40)[0].joints, np.float64)
  upper = [joint for joint, name in enumerate(HUMANML3D.joints) if not any(
      part in name for part in ("hip", "knee", "ankle", "foot", "pelvis"))]
  turn = rot.about_axis(np.radians(degrees), "y")
  joints[:, upper] = joints[:, :1] + rot.rotate(turn, joints[:, upper] - joints[:, :1])
  for heading in (0.0, 2.0):
    found = doctor._Findings()
    checks.Body(found, HUMANML3D).check("a", rot.rotate(rot.about_axis(heading, "y"), joints))
    assert [one.level for one in found.sorted() if "shoulders" in one.what] == [level] * bool(level)


def test_known_bad_clip(folder):
  for name in ("007975", "M007975"):
    shutil.copy(folder / "texts" / "000001.txt", folder / "texts" / f"{name}.txt")
    np.save(folder / "new_joint_vecs" / f"{name}.npy", np.full((59, 263), np.nan))
    _append(folder, "train", name)
  found = next(f for f in doctor.examine(folder).findings if "known bad" in f.what)
  assert found.examples == ("007975", "M007975")


def test_left_and_right_exchanged(folder):
  """Joints with x negated but not renamed: the toes of every standing body point backwards."""
  for path in (folder / "new_joint_vecs").glob("*.npy"):
    _vectors(folder, path.stem, lambda x: x * np.where(np.isin(np.arange(263), range(4, 67, 3)), -1, 1))
  assert any("toes point backwards" in f.what and f.level == "error" for f in doctor.examine(folder).findings)


def _row(index, **change):
  def damage(folder):
    lines = (folder / "captions.jsonl").read_text().splitlines()
    lines[index] = json.dumps(json.loads(lines[index]) | change)
    (folder / "captions.jsonl").write_text("\n".join(lines) + "\n")
  return damage


def _arrays(**change):
  def damage(folder):
    arrays = dict(np.load(folder / "motions.npz"))
    arrays |= {key: make(arrays[key]) for key, make in change.items()}
    np.savez(folder / "motions.npz", **arrays)
  return damage


@pytest.mark.parametrize("damage, what", [
    (_row(0, clip="nobody"), "clips that are not there"),
    (_row(0, text=[" "]), "rows without a caption"),
    (_row(0, id="toy_000001"), "ids that occur twice"),
    (_row(0, split="dev"), "rows in no split"),
    (_row(0, clip="000003"), "pieces in two splits"),
    (lambda f: (f / "captions.jsonl").write_text("{"), "cannot be read"),
    (_arrays(root=lambda x: _set(x, 5, np.nan)), "NaN"),
    (_arrays(local=lambda x: x[:-1]), "do not fit together"),
    (_arrays(start=lambda x: _set(x, 1, 0)), "clips of no frames"),
    (_arrays(start=lambda x: _set(x, 0, 1)), "start should rise from 0 to 300"),
    (_arrays(start=lambda x: _set(x, -1, 299)), "start should rise from 0 to 300"),
    (_arrays(start=lambda x: _set(x, 1, 120)), "start should rise from 0 to 300"),
    (_row(0, start=-1), "frames outside their clip"),
    (_row(0, end=51), "frames outside their clip"),
    (_row(0, start=50), "frames outside their clip"),
    (_arrays(root=lambda x: x * 100, local=lambda x: x * 100), "pelvis at 85"),
])
def test_each_fault_of_an_archive_is_found(tmp_path, damage, what):
  folder = write_archive(tmp_path / "toy")
  damage(folder)
  report = doctor.examine(folder)
  assert not report.ok and any(what in f"{f.what} {f.examples}" for f in report.findings), doctor.format_report(report)


def test_a_row_of_an_archive_is_its_own_frames_of_its_own_clip(tmp_path):
  folder = write_archive(tmp_path / "toy")
  whole = read_archive(folder)[2].joints
  _row(2, start=5, end=50)(folder)
  np.testing.assert_array_equal(read_archive(folder)[2].joints, whole[5:])
  _row(2, start=5, end=20)(folder)
  clip = read_archive(folder)[2]
  np.testing.assert_array_equal(clip.joints, whole[5:20])
  assert clip.id == "toy_000002"
  np.testing.assert_allclose(whole, synthetic_clips(0, 3, num_frames=50)[2].joints, atol=2e-3)


def test_no_data_folder(tmp_path):
  with pytest.raises(FileNotFoundError, match="no data folder"):
    doctor.examine(tmp_path)
