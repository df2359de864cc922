"""Clips that are made of others do what their captions say, and never mix what licences keep apart."""
import functools
import re
import sys

import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.configs import common
from motion_jax.data import sources
from motion_jax.data.augment import KINDS, augmented
from motion_jax.data.augment.chains import in_a_row
from motion_jax.data.augment.counted import how_often
from motion_jax.data.augment.warps import at_pace
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.data.mirror import mirror_clip
from motion_jax.metrics.physics import planted_speed
from motion_jax.motion.events import find_events
from motion_jax.motion.retarget import retarget

_SAID = {"walk": "a person walks forward.", "wave_left": "a person waves with the left hand.",
         "squat": "a person squats down and stands up.", "stand": "a person stands still."}
_JUMP = {"jump": "a person jumps up."}


def _clips(source="ours", seeds=1, said=_SAID):
  joints = lambda action, seed: synthetic_joints(action, 150 if action == "walk" else 70, np.random.default_rng(seed))
  return [Clip(joints(action, seed).astype(np.float32), captions=(Caption(text),), id=f"{source}{action}{seed}",
               split="train", source=source, meta={"content": action})
          for action, text in said.items() for seed in range(seeds)]


@functools.cache
def _made(kind):
  return augmented(_clips() + _clips("theirs"), {kind: 1.0})


def test_nothing_asked_nothing_made():
  assert augmented(_clips(), {}) == augmented(_clips(), {"stitched": 0.0}) == []
  with pytest.raises(ValueError, match="got the kind 'stiched' of new clips, expected one of stitched"):
    augmented(_clips(), {"stiched": 1.0})


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_clips_make_the_same_clips(kind):
  made = _made(kind)
  assert made and {clip.source for clip in made} == {"ours", "theirs"}
  again = augmented(_clips("theirs"), {kind: 1.0})
  theirs = [clip for clip in made if clip.source == "theirs"]
  assert [clip.id for clip in theirs] == [clip.id for clip in again]
  for one, other in zip(theirs, again):
    np.testing.assert_array_equal(one.joints, other.joints)
    assert one.captions == other.captions and one.split == "train" and one.meta["made"]
  assert len({clip.id for clip in made}) == len(made)


@pytest.mark.parametrize("kind", ["stitched", "idle"])
def test_sequences_say_what_is_done_when(kind):
  for clip in _made(kind):
    spans = clip.meta["spans"]
    assert len(spans) > 1 and spans[0][1] == 0 and spans[-1][2] == clip.num_frames <= 196
    assert all(one[2] == other[1] and one[1] < one[2] for one, other in zip(spans, spans[1:]))
    assert all(re.search(", then | and then |, and after that | finally ", caption.text) for caption in clip.captions)
    found = find_events(clip.joints)
    for text, first, past in spans:
      done = next((kind for kind in ("wave", "squat", "walk") if kind in text), "still")
      assert any(event.kind == done and event.start * 20 < past and event.end * 20 > first for event in found)


def test_a_bent_walk_is_said_to_be_one():
  shapes = set()
  for clip in _made("bent_paths"):
    path = next(event.path for event in find_events(clip.joints) if event.kind == "walk")
    shapes.add(path)
    words = {"circle": "circle", "u-turn": "u-turn|half circle|turns around", "zigzag": "zigzag",
             "curve": "curve|arc|turn"}[path]
    assert path in clip.meta["content"] and all(re.search(words, caption.text) for caption in clip.captions)
    assert not any("straight" in caption.text for caption in clip.captions)
  assert len(shapes) > 1


_TIMES = {1: r"\b(once|one time|a squat|a bow)\b|squats .*up", 2: r"\b(twice|two)\b", 3: r"\bthree\b", 4: r"\bfour\b"}


def test_what_is_counted_is_done_so_often():
  counts = set()
  for clip in augmented(_clips(seeds=3, said=_JUMP), {"counted": 2.0}):
    done = how_often(find_events(clip.joints))
    assert clip.num_frames <= 196 and done in (2, 3, 4)
    assert all(re.search(_TIMES[done], caption.text) for caption in clip.captions), (done, clip.captions)
    counts.add(done)
  assert len(counts) > 1
  for clip in _made("counted"):
    assert all(re.search(_TIMES[how_often(find_events(clip.joints))], caption.text) for caption in clip.captions)


def test_an_excerpt_is_most_of_what_is_done():
  clips = _clips(seeds=3, said=_JUMP)
  made = augmented(clips, {"excerpts": 2.0})
  assert made
  for clip in made:
    source = next(one for one in clips if one.id == clip.id.partition("+")[0])
    jump, = (event for event in find_events(clip.joints) if event.kind != "still")
    assert 30 <= clip.num_frames <= 0.9 * source.num_frames and jump.kind == "jump"
    assert 0.25 < jump.start < 1.4 and all("jump" in caption.text or "hop" in caption.text for caption in clip.captions)


def test_an_excerpt_in_which_something_else_is_found_is_dropped(monkeypatch):
  wrong = lambda joints, fps: [event._replace(count=event.count + 1) for event in find_events(joints, fps)]
  monkeypatch.setattr(sys.modules[KINDS["excerpts"].__module__], "find_events", wrong)
  assert augmented(_clips(said=_JUMP), {"excerpts": 2.0}) == []


def test_another_pace_is_said_and_no_foot_slides():
  said = set()
  clips = _clips(seeds=3)
  for clip in augmented(clips, {"time_warp": 1.5}):
    source = retarget(next(one for one in clips if one.id == clip.id.partition("+")[0]).joints)
    assert clip.num_frames <= 196 and planted_speed(clip.joints) < 1.5 * planted_speed(source) + 0.01
    words = {word for caption in clip.captions for word in re.findall("slow|quick|fast", caption.text)}
    said |= words
    assert not words or words == {"slow"} or "slow" not in words and clip.num_frames < len(source)
  assert {"slow", "quick"} <= said


def test_a_pace_in_words():
  assert at_pace("a person walks forward.", "slowly", 0) == "a person walks forward slowly."
  assert at_pace("Someone bows.", "quickly", 1) == "Someone quickly bows."
  assert at_pace("a person bows.", "quickly", 2) == "a person bows fast."
  assert at_pace("a person walks, then bows.", "quickly", 0) == at_pace("a man is walking.", "slowly", 0) == ""


def test_sentences_in_a_row():
  texts = ["a person walks forward.", "Someone waves the left hand.", "the man sits down"]
  assert in_a_row(texts[:2], 0) == "a person walks forward, then waves the left hand."
  assert in_a_row(texts, 0) == "a person walks forward, then waves the left hand and finally sits down."


def test_a_mirrored_sequence_has_mirrored_spans():
  clip = _clips()[0].replace(meta={"spans": (("a person walks.", 0, 70), ("she waves the left hand.", 70, 150))})
  assert mirror_clip(clip).meta["spans"] == (("a person walks.", 0, 70), ("she waves the right hand.", 70, 150))


@pytest.mark.slow
def test_training_sees_more_and_the_same_statistics():
  config = ConfigDict(dict(data=common.data(layout="coordinates"))).data
  config.update(name="synthetic", mode="corrected", mirror=True)
  plain = sources.load_features(config)
  config.augment.update(bent_paths=0.5)
  more = sources.load_features(config)
  assert more.ids[:1] == plain.ids[:1] and len(more.ids) > len(plain.ids)
  np.testing.assert_array_equal(more.stats.mean, plain.stats.mean)
  assert len(more.spans) == len(more.ids) and sources.load_features(config, "val", more.stats).ids
