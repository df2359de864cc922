"""SnapMoGen folders: what we write has the dataset's layout and is read back; BVH files become its features."""
import json
import shutil

import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.data.clip import Caption
from motion_jax.data.datasets.snapmogen import (
  SnapMoGen,
  Span,
  bvh_features,
  folder_stats,
  read_folder,
  read_ids,
  text_items,
  write_folder,
)
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.data.doctor import examine, format_report
from motion_jax.data.sources import load_features
from motion_jax.evaluation.test_set import check_split
from motion_jax.motion import inverse
from motion_jax.motion import rotations as rot
from motion_jax.motion.representations import to_features, to_joints
from motion_jax.motion.representations.snapmogen import from_rotations
from motion_jax.motion.skeleton import SNAPMOGEN, SNAPMOGEN_BVH
from tests.data.bvh_files import bvh_text


@pytest.fixture(scope="module")
def built(tmp_path_factory):
  out = tmp_path_factory.mktemp("data") / "SnapMoGen"
  clips = synthetic_clips(0, 6, num_frames=140, skeleton=SNAPMOGEN)  # 209 frames at 30 a second
  clips[0] = clips[0].replace(captions=(Caption("by a person."), Caption("by a machine.")), meta={"num_manual": 1})
  more = (Caption("the second half", 2.0, 6.5), Caption("short", 0, 1.0))
  clips[1] = clips[1].replace(captions=clips[1].captions + more)
  return clips, write_folder(clips, out)


def test_written_folder_has_the_dataset_s_layout(built):
  clips, out = built
  assert {p.name for p in out.iterdir()} == {"renamed_feats", "data_split_info", "meta_data", "all_caption_clean.json",
                                             "dataset.json"}
  assert (out / "data_split_info" / "test_fnames.txt").read_text() == "000004\n"
  assert (out / "data_split_info" / "train_ids.txt").read_text().splitlines()[:4] == [
      "000000#0#208", "000001#0#208", "000001#60#195", "000001#0#30"]
  captions = json.loads((out / "all_caption_clean.json").read_text())
  assert captions["000000#0#208"] == {"manual": ["by a person."], "gpt": ["by a machine."]}
  assert captions["000001#60#195"] == {"manual": ["the second half"], "gpt": []}
  features = np.load(out / "renamed_feats" / "000002.npy")
  np.testing.assert_array_equal(features, to_features(clips[2].joints, "snapmogen"))


def test_read_back(built):
  clips, out = built
  back = {clip.id: clip for clip in read_folder(out, "train")}
  clip = back["000001#60#195"]
  assert clip.captions == (Caption("the second half"),) and clip.num_frames == 135 and clip.fps == 30
  np.testing.assert_array_equal(clip.features, to_features(clips[1].joints, "snapmogen")[60:195])
  np.testing.assert_array_equal(clip.joints, to_joints(clip.features, "snapmogen"))
  assert back["000000#0#208"].meta["num_manual"] == 1
  assert [c.text for c in back["000000#0#208"].captions] == ["by a person.", "by a machine."]


def test_items_by_the_loader_s_rules(built):
  _, out = built
  items = {item.id: item for item in text_items(out, "train")}
  assert set(items) == {"000000#0#208", "000001#0#208", "000001#60#195", "000002#0#208", "000005#0#208"}  # 128 or more
  assert "000001#0#30" in {item.id for item in text_items(out, "train", whole=True)}
  assert text_items(out, "val", "snapmogen_148")[0].features.shape == (208, 148)
  assert read_ids(out, "test") == [Span("000004", 0, 208)]
  with pytest.raises(ValueError, match="holds 'snapmogen' features"):
    text_items(out, "train", "full")
  config = ConfigDict(dict(name="snapmogen", folder=str(out), layout="snapmogen", mode="benchmark"))
  assert load_features(config).captions[0] == ["by a person.", "by a machine."]
  assert len(load_features(config, captioned=False).features) == 6


def test_spans_of_test_that_share_rows_with_train_are_found(copy):
  """A recording may be cut between the splits, its rows may not be in both."""
  ids = copy / "data_split_info" / "test_ids.txt"
  before = ids.read_text()
  train = copy / "data_split_info" / "train_ids.txt"
  train.write_text(train.read_text() + "000004#0#40\n")
  ids.write_text("000004#40#208\n")
  assert check_split([copy], SnapMoGen(), "test") == []
  ids.write_text(before)
  with pytest.raises(ValueError, match="1 clips of split 'test' are in train, too, such as 000004#0#208"):
    check_split([copy], SnapMoGen(), "test")
  assert check_split([copy], SnapMoGen(), "test", allow=True) == ["000004#0#208"]


def test_statistics_are_the_dataset_s(built, copy):
  _, out = built
  mean, std = (np.load(out / "meta_data" / f"{name}.npy") for name in ("mean", "std"))
  stats = folder_stats(out, "snapmogen_148")
  assert np.array_equal(stats.mean, mean[:148]) and np.array_equal(stats.std, std[:148])
  std[148] = 0
  np.save(copy / "meta_data" / "std.npy", std)
  assert folder_stats(copy).std[148] == 1
  np.save(copy / "meta_data" / "std.npy", std[:263])
  with pytest.raises(ValueError, match=r"std.npy.*\(263,\), expected \(296,\)"):
    folder_stats(copy)


def test_bvh_files_become_features(tmp_path):
  """A file in the dataset's form, with a joint more, at 60 frames a second: as if made from the joints."""
  rng = np.random.default_rng(0)
  frames = 41
  local = rng.normal(size=(1, 24, 3)) * 0.2 + np.sin(np.linspace(0, 3, frames))[:, None, None] * 0.1
  local[:, 15] = 0  # the pelvis is held
  path = np.stack([np.linspace(0, 40, frames), np.full(frames, 50.0), np.zeros(frames)], -1)
  degrees, turns = np.degrees(local), "Xrotation Yrotation Zrotation"
  text = bvh_text(SNAPMOGEN_BVH, SNAPMOGEN.parents, SNAPMOGEN.offsets,
                  [f"Xposition Yposition Zposition {turns}", *[turns] * 23],
                  [np.concatenate([path, degrees[:, 0]], 1), *degrees[:, 1:].swapaxes(0, 1)], 1 / 60)
  (tmp_path / "a.bvh").write_text(text)
  made = bvh_features(tmp_path / "a.bvh")
  turn = lambda angle: rot.multiply(rot.about_axis(angle[..., 0], "x"), rot.multiply(
      rot.about_axis(angle[..., 1], "y"), rot.about_axis(angle[..., 2], "z")))
  turned = turn(local)
  for joint in SNAPMOGEN.order[1:]:
    turned[:, joint] = rot.multiply(turned[:, SNAPMOGEN.parents[joint]], turned[:, joint])
  joints = inverse.forward(path, turned, SNAPMOGEN)
  expected = from_rotations(joints[1::2], turned[1::2])
  assert made.shape == (19, 296) and made.dtype == np.float32
  assert np.abs(made - expected).max() < 1e-4
  (tmp_path / "b.bvh").write_text(text.replace("Frame Time: 0.0166", "Frame Time: 0.0416"))
  with pytest.raises(ValueError, match="24 frames a second, expected 30"):
    bvh_features(tmp_path / "b.bvh")
  (tmp_path / "b.bvh").write_text(text.replace("C_head", "C_hat"))
  with pytest.raises(ValueError, match="no joint 'C_head_bind_JNT'"):
    bvh_features(tmp_path / "b.bvh")


@pytest.fixture
def copy(built, tmp_path):
  return shutil.copytree(built[1], tmp_path / "copy")


def test_missing_files_are_told(copy):
  for name in ("meta_data/std.npy", "data_split_info/train_ids.txt", "all_caption_clean.json"):
    (copy / name).rename(copy / "away")
    with pytest.raises(FileNotFoundError, match=name.split("/")[-1]):
      text_items(copy)
      folder_stats(copy)
    (copy / "away").rename(copy / name)
  with pytest.raises(ValueError, match="expected one of train, val, test"):
    text_items(copy, "all")


def test_bad_recordings_are_left_out_or_named(copy, recwarn):
  (copy / "renamed_feats" / "000002.npy").unlink()
  path = copy / "renamed_feats" / "000000.npy"
  features, faults = np.load(path), []
  broken = features.copy()
  broken[3, 7] = np.nan
  np.save(path, broken)
  assert len(text_items(copy, "train", faults=faults)) == 3
  assert faults == [("000000#0#208", "NaN"), ("000002#0#208", "no recording")] and not recwarn
  with pytest.warns(UserWarning, match="left out 1 with NaN .000000#0#208.; 1 with no recording .000002#0#208."):
    assert len(text_items(copy)) == 3
  np.save(path, features[:207])
  with pytest.warns(UserWarning, match="rows beyond the recording"):
    text_items(copy)
  (copy / "data_split_info" / "train_ids.txt").write_text("000001#0#208\n000001#9\n")
  with pytest.raises(ValueError, match="line 2: got '000001#9'"):
    read_ids(copy)


def test_clips_that_cannot_be_written_are_told(built, tmp_path):
  clip, *_ = built[0]
  for clips, words in (([], "no clips"), ([clip, clip], "occurs twice"), ([clip.replace(id="a#b")], "without '#'"),
                       ([clip.replace(split="dev")], "split 'dev'"), (synthetic_clips(0, 1), "expected 'snapmogen'")):
    with pytest.raises(ValueError, match=words):
      write_folder(clips, tmp_path / "out")
  assert not list(tmp_path.iterdir())


def test_doctor(built, copy):
  report = examine(built[1])
  assert report.ok, format_report(report)
  assert "SnapMoGen layout" in format_report(report) and "by a machine" in format_report(report)
  features = np.load(copy / "renamed_feats" / "000000.npy")
  features[5, 100] = np.nan
  np.save(copy / "renamed_feats" / "000000.npy", features)
  with (copy / "data_split_info" / "test_ids.txt").open("a") as file:
    file.write("000002#0#208\n000003#0#999\nnobody#0#200\n")
  np.save(copy / "meta_data" / "mean.npy", np.load(copy / "meta_data" / "mean.npy") + 100)
  told = format_report(examine(copy))
  for words in ("not healthy", "NaN or infinity: 000000", "ids without a recording: nobody", "recordings in two splits",
                "end behind their recording: 000003#0#999", "ids without a caption", "mean.npy is not this data's"):
    assert words in told, told
