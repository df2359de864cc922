"""docs/your-own-data.md: its commands, in its order, from BVH files to a page and a table, in tiny sizes."""
import re
import shlex

import pytest

from motion_jax import export, fit
from motion_jax.data import build, sources
from motion_jax.data.datasets import humanml3d
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax_studio import cli
from tests.configs.test_tiny_sizes import traced_training
from tests.conftest import ROOT, load_config

PAGE = (ROOT / "docs" / "your-own-data.md").read_text(encoding="utf-8")
# What makes a stage small enough for a test; a command's own flags stay as they are.
TINY = {
    "part_tmr": {"model.width": 16, "model.depth": 1, "model.num_heads": 2, "model.mlp_width": 16, "model.dim": 6},
    "cmdm_tokenizer": {"model.width": 16, "model.latent_dim": 4, "model.dilations": (1,), "model.teacher_dim": 6,
                       "loss.micro_batch": 4, "data.stride": 20},
    "cmdm_denoiser": {"tokenizer.width": 16, "tokenizer.latent_dim": 4, "tokenizer.dilations": (1,),
                      "model.latent_dim": 4, "model.width": 16, "model.depth": 1, "model.num_heads": 2,
                      "model.ff_width": 16, "data.lengths": (192,)},
    "evaluator_movement": {"model.width": 12, "model.dim": 12},
    "evaluator_matching": {"model.movement_width": 12, "model.movement_dim": 12, "model.motion_width": 12,
                           "model.text_width": 12, "model.dim": 8},
}


def commands():
  """The command lines of the page's bash blocks, as lists of words, without those of the other method, CDAMD, which
  tests/test_smoke.py parses."""
  blocks = [block for block in re.findall(r"^```bash\n(.*?)^```", PAGE, re.M | re.S) if "--config cdamd_" not in block]
  return [shlex.split(line) for block in blocks for line in block.replace("\\\n", " ").splitlines() if line.strip()]


def write_captures(folder, count=20):
  """BVH files with a table of captions, as a newcomer has them."""
  folder.mkdir()
  rows = ["file,caption,start,end"]
  for clip in synthetic_clips(seed=3, num=count):
    export.bvh(clip, folder / f"{clip.id}.bvh")
    rows += [f"{clip.id}.bvh,{caption.text.rstrip('.')},," for caption in clip.captions]
  (folder / "captions.csv").write_text("\n".join(rows) + "\n")


@pytest.mark.slow
def test_the_page_from_files_to_a_table(tmp_path, monkeypatch, capsys):
  """Steps of training are traced, and evaluations parsed: tests/evaluation runs them."""
  monkeypatch.chdir(tmp_path)
  monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
  monkeypatch.setattr(fit.loop, "train", traced_training)
  write_captures(tmp_path / "my_bvh")
  ran = []
  for words in commands():
    if words[:2] == ["motion-jax", "train"]:
      sizes = TINY[words[words.index("--config") + 1].partition(":")[0]] | {
          "train.num_steps": 2, "train.save_every": 2, "data.batch_size": 4}
      assert cli.main([*words[1:], *(f"--config.{key}={value}" for key, value in sizes.items())]) == 0
    elif words[:2] == ["motion-jax", "evaluate"]:
      folders = [word for word in words if word.startswith("runs/")]
      assert folders and all((tmp_path / folder).is_dir() for folder in folders), words
      cli.parse(words[1:])
    else:
      assert words[0] == "motion-jax", f"the page has a command that no test runs: {words}"
      more = ["--num-steps", "2", "--lag", "1", "--num-samples", "1"] if words[1] == "generate" else []
      assert cli.main([*words[1:], *more]) == 0, words
    ran.append(words[1])
  assert ran == ["data", "data", "train", "train", "train", "generate", "retrieve", "evaluate", "train", "train",
                 "evaluate"]
  assert "its mirrored copies are used, no more are made" in capsys.readouterr().out
  assert (tmp_path / "walk.html").stat().st_size > 100_000


@pytest.fixture(scope="module")
def mine(tmp_path_factory):
  folder = tmp_path_factory.mktemp("own") / "mine"
  humanml3d.write_folder(synthetic_clips(num=6, num_frames=50), folder)
  return folder


def data_of(size="small", **changes):
  config = load_config("cmdm_denoiser", size)
  config.frozen.tokenizer = "random-init"
  config.update_from_flattened_dict({f"data.{name}": value for name, value in changes.items()})
  return config


def test_a_folder_is_recognized_and_its_mirrored_copies_are_not_doubled(mine):
  config = data_of(folder=str(mine))
  config, told = fit.resolve(config)
  assert "mirrored copies are used, no more are made" in told
  assert (config.data.name, config.data.mode, config.data.mirror) == ("humanml3d", "corrected", False)
  found = sources.load_features(config.data)
  train = (mine / "train.txt").read_text().split()
  assert sorted(found.ids) == sorted(train) and any(name.startswith("M") for name in found.ids)
  again, _ = fit.resolve(data_of(folders=(str(mine),)))
  assert again.data.to_dict() == config.data.to_dict(), "folders with one name is the same"


def test_a_folder_beside_others_is_read_clip_by_clip_without_its_mirrored_copies(mine):
  config = data_of(folders=(str(mine), str(mine)))
  config, told = fit.resolve(config)
  assert "2 folders" in told
  ids = [clip.id for clip in sources.load_clips(config.data)]
  assert len(ids) == 12 and not any(name.startswith("M") for name in ids)
  assert config.data.mirror, "they are made anew, for all folders alike"


def test_recognition_leaves_alone_what_is_none_of_its_business(mine):
  tiny, _ = fit.resolve(data_of("tiny", folder=str(mine)))
  assert tiny.data.name == "humanml3d" and tiny.data.folder == str(mine)
  synthetic = data_of("tiny")
  assert sources.recognize(synthetic) == "" and synthetic.data.name == "synthetic"
  assert sources.recognize(data_of()) == ""
  given = data_of("full", folder=str(mine))
  before = given.to_json()
  full, _ = fit.resolve(given)
  assert full.data.mode == "corrected", "the folder says how its features were made"
  assert given.to_json() == before != full.to_json(), "what was given stays as it was"


def test_what_is_no_data_folder_is_told(tmp_path, mine):
  with pytest.raises(FileNotFoundError, match="there is no folder"):
    sources.recognize(data_of(folder=str(tmp_path / "none")))
  write_captures(tmp_path / "my_bvh", 2)
  with pytest.raises(FileNotFoundError, match="2 files of motion capture; make a data folder of them first"):
    sources.recognize(data_of(folder=str(tmp_path / "my_bvh")))
  with pytest.raises(ValueError, match="give one of them"):
    sources.recognize(data_of(folder=str(mine), folders=(str(mine),)))


def test_each_split_gets_a_recording_of_a_few():
  for count in range(5, 30):
    clips = [clip.replace(split="", id=f"take_{count}_{i}")
             for i, clip in enumerate(synthetic_clips(num=1, num_frames=20) * count)]
    splits = [clip.split for clip in build.with_splits(clips)]
    assert set(splits) == {"train", "val", "test"} and splits.count("train") >= count / 2
  named = [clip.replace(split="train") for clip in clips]
  assert {clip.split for clip in build.with_splits(named)} == {"train"}, "what the captions say is obeyed"
