"""Captions in other words say the same: sides and counts stay, and the application reads the same actions."""
import json
import re

import pytest
from ml_collections import ConfigDict

from motion_jax.data import sources
from motion_jax.data.mirror import mirror_caption
from motion_jax.text.paraphrase import paraphrases
from motion_jax.training import setup
from motion_jax_studio.language import parse
from tests.conftest import ROOT

COUNTS = {"once": 1, "one time": 1, "twice": 2, "two times": 2, "2 times": 2, "three times": 3, "3 times": 3,
          "thrice": 3, "four times": 4}
OTHERS = "|".join(sorted(COUNTS, key=len, reverse=True))


@pytest.fixture(scope="module")
def captions():
  table = json.loads((ROOT / "motion_jax" / "pretrained" / "cmdm-small" / "captions.json").read_text())
  return [text for text, _ in table]


def _sides(text):
  return sorted(set(re.findall(r"\b(?:left|right|(?:counter)?clockwise)\b", text.replace("counter-", "counter"))))


def _counts(text):
  return [COUNTS[word] for word in re.findall(rf"\b({OTHERS})\b", text)]


def test_sides_and_counts_stay(captions):
  changed = 0
  for caption in captions[::7]:
    for other in paraphrases(caption, 2):
      left_out = set(_sides(caption)) - set(_sides(other))  # only where there is a way back
      assert set(_sides(other)) <= set(_sides(caption)) and (not left_out or " back" in other), (caption, other)
      assert _counts(other) == _counts(caption), (caption, other)
      assert mirror_caption(mirror_caption(other)) == other.replace("counter-", "counter")
      assert not re.search(r"\0|\b(\w+) \1\b|,,| ,|\bis \w+s\b", other.replace("bye bye", "bye")), other
      changed += 1
  assert changed > 1.5 * len(captions[::7])  # two different ones of most captions


def test_plans_stay(captions):
  """Of captions with several actions as many are read in other words, but for a way that may be one action or two."""
  pairs = [(caption, other) for caption in captions[::80] for other in paraphrases(caption, 1)]
  same = [len(parse(caption).actions) == len(parse(other).actions) for caption, other in pairs]
  assert sum(same) > 0.95 * len(pairs)


def test_a_run_keeps_the_captions_of_its_data_and_no_paraphrases():
  """With mirrored clips, too: the table of lengths, by which the application knows what is one action."""
  data = {paraphrases: sources.load_features(ConfigDict(dict(
      name="synthetic", folder="", folders=(), layout="full", mode="corrected", mirror=True, seed=0, num_clips=16,
      paraphrases=paraphrases))) for paraphrases in (0, 2)}
  assert setup.caption_lengths(data[2]) == setup.caption_lengths(data[0])
  assert sum(map(len, data[2].captions)) > 1.5 * sum(map(len, data[0].captions))
