"""Composed data: prompts by a grammar, their distance from evaluation lists, and archives that are continued."""
import json

import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.data.datasets.archive import read_archive
from motion_jax.data.datasets.base import clip_items
from motion_jax.motion.representations import get_layout
from motion_jax.utils.errors import InputError
from motion_jax_studio.cli import main
from motion_jax_studio.composing import compose, grammar
from motion_jax_studio.composing.apart import MARGIN, Apart, edit_distance, read_sentences, words_of
from motion_jax_studio.language import parse

LISTS = "benchmarks/data/sentences/own.tsv"


def test_prompts_are_functions_of_seed_and_number():
  prompts = [grammar.prompt(3, number) for number in range(200)]
  assert prompts == [grammar.prompt(3, number) for number in range(200)] != [grammar.prompt(4, n) for n in range(200)]
  assert len(set(prompts)) > 190
  assert not [prompt for prompt in prompts if "{" in prompt or "  " in prompt or "they walks" in prompt]
  several = [len(parse(prompt).segments) + len(parse(prompt).segments[0].simultaneous) > 1 for prompt in prompts]
  assert sum(several) > 120  # most of them say several actions


@pytest.mark.parametrize("first, second, distance", [
    ("a b c", "a b c", 0), ("a b c", "a c", 1), ("a b c", "b c d", 2), ("", "a b", 2), ("a b", "b a", 2)])
def test_edit_distance_in_words(first, second, distance):
  assert edit_distance(words_of(first), words_of(second)) == distance == edit_distance(words_of(second),
                                                                                       words_of(first))


def test_no_prompt_is_near_an_evaluation_sentence():
  """The quick search finds what comparing with every sentence finds."""
  sentences = read_sentences(LISTS)
  apart, every = Apart(sentences), [words_of(sentence) for sentence in sentences]
  assert len(sentences) == 225 and apart.nearest("A person WAVES, then walks away!")
  prompts = [grammar.prompt(0, number) for number in range(40)]
  near = [apart.nearest(prompt) is not None for prompt in prompts]
  assert near == [any(edit_distance(words_of(prompt), words) <= MARGIN for words in every) for prompt in prompts]
  assert 0 < sum(near) < 40


def test_sentences_of_files(tmp_path):
  lines = tmp_path / "lines.jsonl"
  lines.write_text('{"text": ["a man bows", "he bows"], "split": "train"}\n{"text": "she sits", "split": "val"}\n')
  assert read_sentences(lines, "train") == ["a man bows", "he bows"] and len(read_sentences(lines)) == 3
  for name, text, error in (("a.tsv", "kind\trule\nx\ty\n", "expected one called sentence"),
                            ("a.txt", "# only a comment\n", "holds no sentences")):
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=error):
      read_sentences(tmp_path / name)


@pytest.fixture
def sampled(monkeypatch):
  """`compose` with a pipeline that is not run: each third prompt is kept. Returns the chunks that were sampled."""
  chunks = []

  def chunk(pipeline, first, prompts, far, attempts, group):
    chunks.append(first)
    rows = [dict(id=f"composed_{n:06d}", clip=f"composed_{n:06d}", start=0, end=40, text=[prompt.text], split="train",
                 made="composed", content="composed: 1 requirements", origin=prompt.origin, seed=prompt.seed,
                 spans=[["a person walks", 0, 24], ["a person waves", 24, 40]])
            for n, prompt in enumerate(prompts, first) if n % 3 == 0]
    joints = [np.random.default_rng(row["seed"]).normal(0, 0.1, (40, 22, 3)).astype(np.float32) for row in rows]
    return rows, joints, {"requirements not met": len(prompts) - len(rows)}

  monkeypatch.setattr(compose, "_chunk", chunk)
  monkeypatch.setattr(compose, "Pipeline", lambda model: type("P", (), {"model": type("M", (), dict(
      id=model, folder="motion_jax/pretrained/cmdm-small"))})())
  monkeypatch.setattr(compose, "CHUNK", 6)
  return chunks


def test_an_interrupted_run_continues_and_gives_the_same_archive(tmp_path, sampled):
  summary = compose.compose(tmp_path / "whole", number=18)
  assert "6 clips of 18 prompts" in summary and "12 requirements not met" in summary
  compose.compose(tmp_path / "part", number=7)
  del sampled[:]
  compose.compose(tmp_path / "part", number=18)
  assert sampled == [6, 12]  # chunk 6 had one prompt before
  for name in ("captions.jsonl", "motions.npz"):
    assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "part" / name).read_bytes()
  for change in (dict(seed=1), dict(model="cdamd-small"), dict(attempts=2)):
    with pytest.raises(InputError, match="was composed with"):
      compose.compose(tmp_path / "whole", **change)
  (tmp_path / "other").mkdir()
  (tmp_path / "other" / "notes.txt").write_text("mine")
  with pytest.raises(InputError, match="is not a folder of composed data"):
    compose.compose(tmp_path / "other")


def test_composed_clips_in_training(tmp_path, sampled):
  """They have the licence of their model; their captions are no captions of captures."""
  compose.compose(tmp_path / "made", number=6)
  clips = read_archive(tmp_path / "made")
  assert all("BY-NC" in clip.license for clip in clips) and json.loads(
      (tmp_path / "made/archive.json").read_text())["composed_by"] == "cmdm-small"
  config = ConfigDict(dict(kinematic_captions=True, augment=dict(stitched=1.0), paraphrases=1, mode="corrected",
                           mirror=True))
  items = clip_items(clips, config, "train", get_layout("full"))
  assert len(items) == 2 * len(clips) and {item.num_own for item in items} == {0} and all(item.made for item in items)
  assert items[0].spans == (("a person walks", 0, 24), ("a person waves", 24, 39))
  assert items[0].captions[0] == clips[0].captions[0].text


@pytest.mark.slow
def test_composing_by_a_model(tmp_path, capsys):
  """Kept motions meet what their plans require."""
  from motion_jax_studio.checks.violations import violation_score
  command = ["data", "compose", str(tmp_path / "made"), "--model", "cmdm-small-fast", "--number", "8", "--attempts",
             "1", "--apart", LISTS]
  assert main(command) == 0 and "clips of 8 prompts" in capsys.readouterr().out
  clips = read_archive(tmp_path / "made")
  for clip in clips:
    assert violation_score(clip.joints, parse(clip.captions[0].text).requirements) == pytest.approx(0, abs=0.05)
  assert clips and not [clip for clip in clips if Apart(read_sentences(LISTS)).nearest(clip.captions[0].text)]


@pytest.mark.slow
def test_scored_samples(tmp_path, capsys):
  """Groups of one pass, of which those whose rewards differ are kept."""
  command = ["data", "compose", str(tmp_path / "scored"), "--model", "cmdm-small-fast", "--number", "6", "--group",
             "3", "--seed", "5"]
  assert main(command) == 0 and "--config cmdm_scored:small" in capsys.readouterr().out
  rows = [json.loads(line) for line in (tmp_path / "scored/captions.jsonl").read_text().splitlines()]
  assert len(rows) == 3 and len({row["reward"] for row in rows}) > 1
  assert all(0 <= row["optimality"] <= 1 for row in rows)
