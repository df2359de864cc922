"""data build: from an archive, or from files and a table of captions, to a folder; bad tables leave nothing behind."""
import json
import re

import numpy as np
import pytest

from motion_jax.data.build import build, pieces, read_captions, with_splits
from motion_jax.data.clip import Caption
from motion_jax.data.datasets.humanml3d import read_folder
from motion_jax.data.datasets.synthetic import synthetic_clips, synthetic_joints
from motion_jax.data.mocap.files import read_mapping
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax_studio import cli
from tests.data.bvh_files import write_bvh


def write_archive(folder, num=6, frames=50, clips=None):
  """Clips, synthetic ones by default, in the archive format."""
  folder.mkdir()
  clips = clips or synthetic_clips(0, num, num_frames=frames)
  joints = np.concatenate([clip.joints for clip in clips])
  np.savez(folder / "motions.npz", names=np.array([clip.id for clip in clips]),
           start=np.cumsum([0, *(clip.num_frames for clip in clips)]), root=joints[:, 0],
           local=(joints - joints[:, :1]).astype(np.float16))
  rows = [{"id": f"{folder.name}_{clip.id}", "clip": clip.id, "start": 0, "end": clip.num_frames, "split": clip.split,
           "text": [caption.text for caption in clip.captions]} for clip in clips]
  (folder / "captions.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
  return folder


@pytest.fixture
def captures(tmp_path):
  """A folder with two BVH files, one in a sub-folder, and captions."""
  folder = tmp_path / "mocap"
  (folder / "day 1").mkdir(parents=True)
  joints = synthetic_joints("wave_left", 90, np.random.default_rng(0))
  write_bvh(folder / "day 1" / "wave.bvh", joints)
  write_bvh(folder / "walk.bvh", synthetic_joints("walk", 90, np.random.default_rng(1)))
  write_bvh(folder / "unnamed.bvh", joints)
  (folder / "captions.csv").write_text(
      "file,caption,start,end,split\nday 1/wave.bvh,a person waves with the left hand.,,,train\n"
      "walk,\"someone walks, straight\",0,,\nwalk,steps left,0.5,2,\n")
  return folder


def test_archive(tmp_path):
  text = build(write_archive(tmp_path / "toy"), tmp_path / "out", progress=False)
  assert "12 clips, 588 frames" in text and "train 8, val 2, test 2" in text
  clips = read_folder(tmp_path / "out")
  assert len(clips) == 12 and clips[0].id == "toy_000000" and clips[0].source == "toy"
  with pytest.raises(FileExistsError, match="exists already"):
    build(tmp_path / "toy", tmp_path / "out", progress=False)
  assert "6 clips" in build(tmp_path / "toy", tmp_path / "out", mirror=False, overwrite=True, progress=False)


def test_bvh_files_and_captions(captures, tmp_path):
  text = build(captures, tmp_path / "out", progress=False)
  assert "left out, as no caption names them: 1 files (unnamed.bvh)" in text
  clips = {clip.id: clip for clip in read_folder(tmp_path / "out")}
  assert set(clips) == {"day_1_wave", "Mday_1_wave", "walk", "Mwalk"}
  assert clips["walk"].captions == (Caption("someone walks, straight"), Caption("steps left", 0.5, 2.0))
  assert clips["Mwalk"].captions[1].text == "steps right" and clips["walk"].num_frames == 59
  lift = lambda clip, wrist: clip.joints[:, wrist, 1].max()
  assert lift(clips["day_1_wave"], 20) > 1.5 > lift(clips["day_1_wave"], 21)
  assert lift(clips["Mday_1_wave"], 21) > 1.5 > lift(clips["Mday_1_wave"], 20)


def test_own_mapping_file(captures, tmp_path):
  names = [f"j{j}" for j in range(22)]
  for path in (captures / "walk.bvh", captures / "day 1" / "wave.bvh"):
    write_bvh(path, synthetic_joints("walk", 60, np.random.default_rng(1)), names=names)
  with pytest.raises(ValueError, match="wave.bvh.*no skeleton that is known; the file has j0"):
    build(captures, tmp_path / "out", progress=False)
  assert not (tmp_path / "out").exists()
  mapping = tmp_path / "map.json"
  mapping.write_text(json.dumps(dict(zip(HUMANML3D.joints, names))))
  assert "4 clips" in build(captures, tmp_path / "out", mapping=str(mapping), progress=False)
  mapping.write_text('{"pelvis": 3}')
  with pytest.raises(ValueError, match="pelvis should be"):
    read_mapping(mapping)


def test_a_bad_file_does_not_lose_a_folder(captures, tmp_path, capsys):
  """It is named, the others are there, and the status is 1; of a folder without a good file nothing is left."""
  text = (captures / "walk.bvh").read_text()
  (captures / "walk.bvh").write_text(text[:len(text) // 2])
  assert cli.main(["data", "build", str(captures), str(tmp_path / "out")]) == 1
  printed = capsys.readouterr()
  assert "2 clips" in printed.out and "not read: walk.bvh: line" in printed.err and "cut" in printed.err
  assert {clip.id for clip in read_folder(tmp_path / "out")} == {"day_1_wave", "Mday_1_wave"}
  (captures / "walk.bvh").write_text(re.sub(r"Frames: \d+", "Frames: 1", "\n".join(text.split("\n")[:text.split(
      "MOTION")[0].count("\n") + 4])))
  assert cli.main(["data", "build", str(captures), str(tmp_path / "still")]) == 1
  assert "not read: walk.bvh: it has 1 frame at 20 frames a second, expected 2 or more" in capsys.readouterr().err
  assert {clip.id for clip in read_folder(tmp_path / "still")} == {"day_1_wave", "Mday_1_wave"}
  (captures / "day 1" / "wave.bvh").write_text("nothing")
  assert cli.main(["data", "build", str(captures), str(tmp_path / "none")]) == 1
  assert "none of 2 files can be read; of the first, day 1/wave.bvh: line 1" in capsys.readouterr().err
  assert not (tmp_path / "none").exists()


def test_files_of_one_name_get_ids_of_their_own(captures, tmp_path):
  """a/walk, a_walk, and what would be the mirrored copy of walk: all are read, none is written over another."""
  for seed, name in enumerate(("a/walk", "b/walk", "a_walk", "Mwalk")):
    (captures / name).parent.mkdir(exist_ok=True)
    write_bvh(captures / f"{name}.bvh", synthetic_joints("walk", 60, np.random.default_rng(seed)))
  (captures / "captions.csv").write_text("file,caption\n" + "".join(
      f"{name},walks\n" for name in ("a/walk.bvh", "b/walk", "a_walk.bvh", "Mwalk.bvh", "walk.bvh")))
  build(captures, tmp_path / "out", progress=False)
  ids = {clip.id for clip in read_folder(tmp_path / "out")}
  assert len(ids) == 10 and {"a_walk", "b_walk", "a_walk_2", "Ma_walk_2", "Mwalk", "walk_2"} <= ids
  (captures / "b" / "walk.amc").write_text("")
  with pytest.raises(ValueError, match="'b/walk', which may be b/walk.amc, b/walk.bvh; give the file's whole"):
    build(captures, tmp_path / "more", progress=False)


@pytest.mark.parametrize("name, text, message", [
    ("a.csv", "file,caption\nx.bvh,\n", "line 2: no file or no caption"),
    ("a.csv", "name,words\nx.bvh,walks\n", "got the columns name, words"),
    ("a.tsv", "file\tcaption\tstart\nx.bvh\twalks\tsoon\n", "in start or end: got 'soon'"),
    ("a.csv", "file,caption,start,end\nx.bvh,walks,3,2\n", "3.0 to 2.0 s is empty"),
    ("a.jsonl", '{"file": "x", "caption": "walks"}\n{"file"\n', "line 2: no valid JSON"),
    ("a.txt", "x walks", "expected a .csv, .tsv or .jsonl"),
])
def test_bad_tables(tmp_path, name, text, message):
  (tmp_path / name).write_text(text)
  with pytest.raises(ValueError, match=message):
    read_captions(tmp_path / name)


def test_missing_things(captures, tmp_path):
  (tmp_path / "empty").mkdir()
  with pytest.raises(FileNotFoundError, match="holds no .bvh or .amc or .glb"):
    build(tmp_path / "empty", tmp_path / "out")
  (captures / "captions.csv").write_text("file,caption\nmissing.bvh,walks\n")
  with pytest.raises(ValueError, match="files that .* lacks: missing.bvh"):
    build(captures, tmp_path / "out", progress=False)
  (captures / "take.c3d").write_bytes(b"")
  (captures / "captions.csv").write_text("file,caption\ntake.c3d,walks\n")
  with pytest.raises(ValueError, match="name take.c3d, .*reads .bvh or .*; motion-jax render take.c3d --out take.bvh"):
    build(captures, tmp_path / "out", progress=False)
  (captures / "captions.csv").unlink()
  with pytest.raises(FileNotFoundError, match="no captions.csv.*data describe"):
    build(captures, tmp_path / "out", progress=False)


def test_long_clips_are_cut():
  clip = synthetic_clips(0, 1, num_frames=450)[0]
  clip = clip.replace(captions=(Caption("all"), Caption("part", 6.0, 10.0), Caption("second", 6.5, 8.4)))
  parts = pieces(clip)
  assert [part.num_frames for part in parts] == [150, 150, 150] and parts[1].id == "000000_01"
  assert [[(c.text, c.start, c.end) for c in part.captions] for part in parts] == [
      [("all", 0, 0), ("part", 6.0, 7.5), ("second", 6.5, 7.5)], [("all", 0, 0), ("part", 0, 2.5)], [("all", 0, 0)]]
  np.testing.assert_array_equal(np.concatenate([part.joints for part in parts]), clip.joints)
  assert len({part.split for part in with_splits([part.replace(split="") for part in parts])}) == 1


def test_splits_by_hash():
  clip = synthetic_clips(0, 1, num_frames=4)[0]
  clips = [clip.replace(id=f"clip{i}", split="") for i in range(400)]
  splits = [one.split for one in with_splits(clips)]
  assert abs(splits.count("train") - 320) < 30 and 5 < splits.count("val") < 40
  assert splits[:50] == [one.split for one in with_splits(clips[:50])]  # more clips do not move the first ones
