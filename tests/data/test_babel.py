"""BABEL folders: segments become pairs as FlowMDM makes them, what we write is read back, 135 features come out."""
import json
import shutil

import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.data.clip import Caption
from motion_jax.data.datasets import babel
from motion_jax.data.datasets.babel import (
  Segment,
  folder_stats,
  pairs,
  pieces,
  read_folder,
  read_recording,
  write_folder,
)
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.data.doctor import examine, format_report
from motion_jax.data.sources import load_features
from motion_jax.motion.representations import to_features, to_joints
from motion_jax.motion.skeleton import SMPL


@pytest.mark.parametrize("segments, expected", [
    ([("a", 0, 60), ("b", 50, 100)], [(("a", 0, 56), ("b", 56, 100))]),          # ten frames that both claim
    ([("a", 0, 60), ("b", 61, 100)], []),                                        # apart
    ([("a", 0, 60), ("b", 60, 100)], [(("a", 0, 61), ("b", 61, 100))]),          # Parity: their ends are inclusive
    ([("a", 0, 50), ("transition", 45, 70), ("b", 60, 100)], [(("a", 0, 56), ("b", 56, 100))]),
    ([("a", 0, 90), ("b", 20, 60)], []),                                         # inside
    ([("a", 0, 40), ("b", 30, 70), ("c", 60, 99)], [(("a", 0, 36), ("b", 36, 70)), (("b", 30, 66), ("c", 66, 99))]),
])
def test_pairs(segments, expected):
  made = pairs([Segment(*s) for s in segments])
  assert made == [tuple(Segment(*s) for s in pair) for pair in expected]


@pytest.fixture(scope="module")
def built(tmp_path_factory):
  out = tmp_path_factory.mktemp("data") / "babel"
  clips = synthetic_clips(0, 5, num_frames=100, skeleton=SMPL)[:4]  # 149 frames at 30 a second
  labels = (Caption("walks", 0.0, 2.0), Caption("turn around", 1.8, 4.0), Caption("stand", 3.8, 4.9))
  clips[1] = clips[1].replace(captions=labels)
  clips[2] = clips[2].replace(captions=())
  clips[3] = clips[3].replace(split="val", captions=labels[:2])
  return clips, write_folder(clips, out)


def test_written_folder(built):
  clips, out = built
  assert {p.name for p in out.iterdir()} == {"motions", "train.json", "val.json", "Mean.npy", "Std.npy", "dataset.json"}
  table = json.loads((out / "train.json").read_text())
  assert table["000001"]["frame_ann"]["labels"][1] == {"proc_label": "turn around", "raw_label": "turn around",
                                                        "start_t": 1.8, "end_t": 4.0}
  assert table["000002"]["frame_ann"] is None and "000003" not in table
  with np.load(out / "motions" / "000001.npz", allow_pickle=False) as file:
    assert file["poses"].shape == (149, 66) and file["fps"] == 30


def test_motions_come_back(built):
  clips, out = built
  piece = pieces(out, "train", whole=True, mode="corrected")[1]
  assert piece.id == "000001#0#149" and piece.features.shape == (149, 135)
  joints = to_joints(piece.features, "babel")
  assert np.abs(joints - to_joints(to_features(clips[1].joints, "babel", "corrected"), "babel")).max() < 1e-5
  distance = lambda a: np.linalg.norm(a - a[:1, :1], axis=-1)
  assert np.abs(distance(joints) - distance(clips[1].joints)).max() < 1e-4


def test_pieces(built):
  _, out = built
  made = {piece.id: piece for piece in pieces(out, "train")}
  assert set(made) == {"000001#0#120", "000001#54#147"}
  piece = made["000001#54#147"]
  assert piece.captions == ("turn around, stand",)
  assert piece.segments == (Segment("turn around", 0, 64), Segment("stand", 64, 93)) and len(piece.features) == 93
  assert (piece.features[0, 1:3] == 0).all()  # every piece begins by itself
  singles = pieces(out, "train", "segments")
  assert [piece.captions for piece in singles][-3:] == [("walks",), ("turn around",), ("stand",)]
  assert len(pieces(out, "train", "both")) == len(singles) + 2
  assert [len(p.features) for p in pieces(out, "train", whole=True, max_frames=100)] == [100, 49] * 3
  clip, = read_folder(out, "val", "pairs")
  assert clip.captions == (Caption("walks", 0.0, 58 / 30), Caption("turn around", 58 / 30, 4.0))
  assert clip.skeleton is SMPL and clip.num_frames == 120


def test_training_reads_pairs_or_whole_recordings(built, tmp_path):
  _, out = built
  config = ConfigDict(dict(name="babel", folder=str(out), layout="babel", mode="benchmark", kind="pairs"))
  data = load_features(config)
  assert data.captions == [["walks, turn around"], ["turn around, stand"]] and data.layout.name == "babel"
  assert len(np.unique(data.stats.std)) == 4  # by block
  assert len(load_features(config, "val", data.stats).features) == 1
  assert len(load_features(config, captioned=False).features) == 3
  copy = shutil.copytree(out, tmp_path / "copy")
  (copy / "Mean.npy").unlink()
  again = folder_stats(copy)
  assert np.array_equal(again.mean, data.stats.mean) and np.array_equal(again.std, data.stats.std)


def test_faster_motions_are_thinned_and_others_are_refused(built, tmp_path):
  with np.load(built[1] / "motions" / "000001.npz") as file:
    poses, trans = file["poses"], file["trans"]
  path = tmp_path / "a.npz"
  np.savez(path, poses=np.repeat(poses, 4, 0), trans=np.repeat(trans, 4, 0), mocap_framerate=120.0)
  np.testing.assert_array_equal(read_recording(path).translation, trans)
  for arrays, message in ((dict(poses=poses, trans=trans, fps=25.0), "25 frames a second"),
                          (dict(poses=poses[:, :63], trans=trans, fps=30.0), r"poses \(149, 63\)"),
                          (dict(poses=poses, fps=30.0), "lacks trans; it holds fps, poses"),
                          (dict(poses=poses * np.nan, trans=trans, fps=30.0), "NaN"),
                          (dict(poses=poses * 1e6, trans=trans, fps=30.0), "angles of over 1000 radians"),
                          (dict(poses=poses, trans=trans + 1e40, fps=30.0), "places beyond 1e\\+06")):
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match=message):
      read_recording(path)


def test_missing_and_bad_files_are_told(built, tmp_path):
  copy = shutil.copytree(built[1], tmp_path / "copy")
  with pytest.raises(ValueError, match="expected one of train, val"):
    pieces(copy, "test")
  (copy / "motions" / "000001.npz").unlink()
  faults = []
  pieces(copy, "train", faults=faults)
  assert [name for name, _ in faults] == ["000001"] and "there is no file" in faults[0][1]
  with pytest.warns(UserWarning, match="left out 1 recordings, the first 000001: there is no file"):
    assert not pieces(copy)
  (copy / "train.json").write_text(json.dumps({"x" * 300: {}}))
  with pytest.raises(ValueError, match="train.json: got the name"):
    pieces(copy)
  (copy / "train.json").unlink()
  with pytest.raises(FileNotFoundError, match="train.json"):
    pieces(copy)
  with pytest.raises(ValueError, match="expected 'smpl' at 30"):
    write_folder(synthetic_clips(0, 1), tmp_path / "out")


def test_doctor(built, tmp_path):
  report = examine(built[1])
  assert report.ok, format_report(report)
  assert "2 pairs of adjacent ones" in format_report(report)
  copy = shutil.copytree(built[1], tmp_path / "copy")
  (copy / "motions" / "000001.npz").write_bytes(b"PK")
  (copy / "motions" / "000002.npz").unlink()
  shutil.copy(copy / "train.json", copy / "val.json")
  told = format_report(examine(copy))
  for words in ("not healthy", "recordings in two splits", "motion: 000002", "cannot be read: 000001", "no pair"):
    assert words in told, told
  assert babel.is_babel(copy) and not babel.is_babel(tmp_path)
