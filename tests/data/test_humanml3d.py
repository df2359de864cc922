"""HumanML3D folders: item rules of the field's loaders, and what we write is read back by them and by us."""
import json
import shutil

import ml_collections
import numpy as np
import pytest

from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.caption_lines import format_texts, read_texts
from motion_jax.data.datasets.humanml3d import (
  folder_stats,
  read_folder,
  read_ids,
  select_items,
  text_items,
  write_folder,
)
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.data.sources import load_features
from motion_jax.motion.representations import to_features, to_joints
from motion_jax.motion.skeleton import KIT
from motion_jax.motion.stats import compute_stats, load_stats


def test_text_lines(tmp_path):
  path = tmp_path / "a.txt"
  path.write_text("a man walks.#a/DET man/NOUN walk/VERB#0.0#0.0\n\nhe jumps#he/PRON jump/VERB#1.5#nan\nbare\n")
  lines = read_texts(path)
  assert [line.caption for line in lines] == ["a man walks.", "he jumps", "bare"]
  assert lines[0].tokens == ("a/DET", "man/NOUN", "walk/VERB") and (lines[1].start, lines[1].end) == (1.5, 0.0)
  clip = synthetic_clips(0, 1)[0].replace(captions=(Caption("walks # two\nsteps"),))
  assert format_texts(clip) == "walks two steps#walk/VERB two/NUM step/NOUN#0.0#0.0\n"


def _clip(name, rows, captions):
  rng = np.random.default_rng(rows)
  return Clip(joints=rng.normal(size=(rows, 22, 3)).astype(np.float32), id=name, captions=captions,
              features=rng.normal(size=(rows, 263)).astype(np.float32))


def test_item_rules():
  """Lengths 40 <= T < 200 for clips and for their tagged pieces, each tested; a clip out of range drops its pieces."""
  whole, piece, short = Caption("all"), Caption("part", 1.0, 3.55), Caption("too short", 1.0, 2.9)
  clips = [_clip("000001", 40, (whole,)), _clip("000002", 39, (whole, piece)), _clip("000003", 200, (whole, piece)),
           _clip("000004", 199, (whole, piece, short, piece, Caption("more"))), _clip("000005", 100, (piece,))]
  items = {item.id: item for item in select_items(clips)}
  assert set(items) == {"000001", "000004", "A_000004", "B_000004", "A_000005"}
  assert [c.text for c in items["000004"].captions] == ["all", "more"]
  np.testing.assert_array_equal(items["A_000004"].features, clips[3].features[20:71])
  assert items["A_000004"].captions == (Caption("part"),)
  with pytest.raises(ValueError, match="no features"):
    select_items([clips[0].replace(features=None)])


@pytest.fixture(scope="module")
def built(tmp_path_factory):
  out = tmp_path_factory.mktemp("data") / "set"
  clips = synthetic_clips(0, 6, num_frames=50)
  clips[1] = clips[1].replace(captions=clips[1].captions + (Caption("turns left.", 0.5, 2.0),))
  return clips, out, write_folder(clips, out)


def test_written_folder_has_the_field_s_layout(built):
  clips, out, info = built
  assert {p.name for p in out.iterdir()} == {
      "new_joints", "new_joint_vecs", "texts", "train.txt", "val.txt", "test.txt", "train_val.txt", "all.txt",
      "Mean.npy", "Std.npy", "dataset.json"}
  ids = read_ids(out, "all")
  assert len(ids) == 12 and sum(name.startswith("M") for name in ids) == 6
  assert sorted(read_ids(out, "train") + read_ids(out, "val")) == sorted(read_ids(out, "train_val"))
  assert (out / "texts" / "000001.txt").read_text().splitlines()[-1] == "turns left.#turn/VERB left/ADV#0.5#2.0"
  assert (out / "texts" / "M000001.txt").read_text().splitlines()[-1].startswith("turns right.#")
  assert json.loads((out / "dataset.json").read_text()) == info
  features = [np.load(out / "new_joint_vecs" / f"{name}.npy") for name in ids]
  np.testing.assert_array_equal(features[0], to_features(clips[0].joints, "full", "corrected"))
  np.testing.assert_array_equal(np.load(out / "new_joints" / f"{ids[0]}.npy"), to_joints(features[0]))
  ours, expected = load_stats(out), compute_stats(features, "full")
  np.testing.assert_allclose([ours.mean, ours.std], [expected.mean, expected.std], atol=1e-6)


def test_read_back(built):
  clips, out, _ = built
  back = {clip.id: clip for clip in read_folder(out)}
  assert len(back) == 12
  for clip in clips:
    assert back[clip.id].captions == clip.captions and back[clip.id].split == clip.split
    assert back[clip.id].source == "synthetic" and back[clip.id].fps == 20
  assert [clip.id for clip in read_folder(out, "test")] == ["000004", "M000004"]
  mirrored, right = back["M000005"].joints, back["000005"].joints  # turn_left in a mirror turns right
  np.testing.assert_allclose(mirrored[:, 0] * [-1, 1, 1], right[:, 0], atol=0.02)
  assert back["M000005"].captions[0].text == "a person turns right."


@pytest.mark.parametrize("layout, dim", [(None, 263), ("essential", 67), ("coordinates", 66)])
def test_items_and_statistics_in_each_layout(built, layout, dim):
  clips, out, _ = built
  items = text_items(out, "train", layout)
  assert {item.id for item in items} == {f"{mark}00000{i}" for mark in ("", "M") for i in (0, 1, 2, 5)}
  assert items[0].captions == tuple(c.text for c in clips[0].captions)
  assert items[0].tokens[0][:2] == ("a/DET", "person/NOUN")
  stats = folder_stats(out, layout)
  assert items[0].features.shape == (49, dim) and stats.layout.dim == dim
  assert np.abs(stats.normalize(items[0].features)).max() < 50
  with pytest.raises(ValueError, match="got layout 'full_kit'"):
    text_items(out, layout="full_kit")


def test_autoencoders_see_whole_clips(built, tmp_path):
  """A time tag makes an item for the generators; a clip is one clip for the tokenizer, whatever its tags (cmdm 1.3)."""
  folder = shutil.copytree(built[1], tmp_path / "tagged")
  (folder / "texts" / "000000.txt").write_text("a person walks.#a/DET#0.0#2.2\n")
  config = ml_collections.ConfigDict(dict(name="humanml3d", folder=str(folder), layout="full", mode="corrected"))
  kinds = [load_features(config, captioned=captioned) for captioned in (True, False)]
  assert "A_000000" in kinds[0].ids and "000000" not in kinds[0].ids
  assert "000000" in kinds[1].ids and "A_000000" not in kinds[1].ids and len(kinds[1].features[0]) == 49


def test_bad_files_are_left_out_with_a_warning(built, tmp_path):
  _, out, _ = built
  copy = shutil.copytree(out, tmp_path / "copy")
  (copy / "texts" / "000000.txt").unlink()
  (copy / "new_joint_vecs" / "000001.npy").unlink()
  broken = np.load(copy / "new_joint_vecs" / "000002.npy")
  broken[3, 4] = np.nan
  np.save(copy / "new_joint_vecs" / "000002.npy", broken)
  with pytest.warns(UserWarning, match="1 with no motion .000001.; 1 with no text .000000.; 1 with NaN .000002."):
    assert len(read_folder(copy)) == 9
  with pytest.raises(FileNotFoundError, match="mine.txt"):
    read_folder(copy, "mine")


def test_kit(tmp_path):
  """KIT: millimetres, 12.5 frames a second, 251 numbers; minimal length 24."""
  clip = synthetic_clips(0, 1, num_frames=50, skeleton=KIT)[0]
  info = write_folder([clip.replace(joints=clip.joints[:31])], tmp_path / "kit", mode="benchmark")
  assert info["layout"] == "full_kit" and info["fps"] == 12.5
  back = read_folder(tmp_path / "kit")
  assert back[0].skeleton is KIT and back[0].features.shape == (30, 251) and len(select_items(back)) == 2


def test_nothing_half_written(tmp_path):
  clips = [clip.replace(fps=30.0) for clip in synthetic_clips(0, 2, num_frames=31)]
  with pytest.raises(ValueError, match="1 frame"):
    write_folder([clips[0], clips[1].replace(joints=clips[1].joints[:1])], tmp_path / "set")
  assert not list(tmp_path.iterdir())
  write_folder(clips, tmp_path / "set", mirror=False)
  with pytest.raises(FileExistsError, match="exists already"):
    write_folder(clips, tmp_path / "set")
  write_folder(clips, tmp_path / "set", mirror=True, overwrite=True)
  assert len(read_ids(tmp_path / "set")) == 4 and read_folder(tmp_path / "set")[0].num_frames == 20  # at 20 a second
  (tmp_path / "precious").mkdir()
  (tmp_path / "precious" / "thesis.txt").write_text("mine")
  with pytest.raises(FileExistsError, match="not a folder that this program made"):
    write_folder(clips, tmp_path / "precious", overwrite=True)


def test_bad_clips(tmp_path):
  clips = synthetic_clips(0, 2, num_frames=20)
  for bad, message in (([], "no clips"), ([clips[0], clips[0]], "twice"), ([clips[0].replace(id="a/b")], "file name"),
                       ([clips[0], clips[1].replace(id="M000000")], "mirrored name"),
                       ([clips[0].replace(split="dev")], "split 'dev'")):
    with pytest.raises(ValueError, match=message):
      write_folder(bad, tmp_path / "set")
