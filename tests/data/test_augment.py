"""Clips that are made of others do what their captions say, and never mix what licences keep apart."""
import functools
import re
import sys

import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.analysis.events import find_events
from motion_jax.analysis.rest import resting
from motion_jax.configs import common
from motion_jax.data import sources
from motion_jax.data.augment import KINDS, augmented
from motion_jax.data.augment.counted import how_often
from motion_jax.data.augment.warps import at_pace
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.base import clip_items
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.metrics.physics import planted_speed
from motion_jax.motion.leaning import lean, leans
from motion_jax.motion.reaching import PLACES, distance_to_place
from motion_jax.motion.representations import get_layout
from motion_jax.motion.retarget import retarget
from motion_jax.motion.root_paths import SMALLEST, course
from motion_jax.motion.skeleton import HUMANML3D

_SAID = {"walk": "a person walks forward.", "wave_left": "a person waves with the left hand.",
         "squat": "a person squats down and stands up.", "stand": "a person stands still."}
_JUMP = {"jump": "a person jumps up."}
_SHARES = {"counted": 0.5, "time_warp": 1.0}  # most attempts fail
_SAYS = {"seats": {"seat": "a person sits on a chair and stands up."}}


def _joints(action, seed):
  """As the procedural clips; a squat that lasts is a seat."""
  draw = np.random.default_rng(seed)
  if action != "seat":
    return synthetic_joints(action, 150 if action == "walk" else 70, draw)
  joints = synthetic_joints("squat", 70, draw)
  low = int(joints[:, 0, 1].argmin())
  return np.concatenate([joints[:low], np.repeat(joints[low:low + 1], 24, 0), joints[low:]])


def _clips(source="ours", seeds=1, said=_SAID):
  return [Clip(_joints(action, seed).astype(np.float32), captions=(Caption(text),), id=f"{source}{action}{seed}",
               split="train", source=source, meta={"content": action})
          for action, text in said.items() for seed in range(seeds)]


@functools.cache
def _made(kind):
  said = _SAYS.get(kind, _SAID)
  return augmented(_clips(said=said) + _clips("theirs", said=said), {kind: _SHARES.get(kind, 2.0)})


def test_nothing_asked_nothing_made():
  assert augmented(_clips(), {}) == augmented(_clips(), {"stitched": 0.0}) == []
  with pytest.raises(ValueError, match="got the kind 'stiched' of new clips, expected one of stitched"):
    augmented(_clips(), {"stiched": 1.0})


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_clips_make_the_same_clips(kind):
  made = _made(kind)
  assert made and {clip.source for clip in made} == {"ours", "theirs"}
  again = augmented(_clips("theirs", said=_SAYS.get(kind, _SAID)), {kind: _SHARES.get(kind, 2.0)})
  theirs = [clip for clip in made if clip.source == "theirs"]
  assert [clip.id for clip in theirs] == [clip.id for clip in again]
  for one, other in zip(theirs, again):
    np.testing.assert_array_equal(one.joints, other.joints)
    assert one.captions == other.captions and one.split == "train" and one.meta["made"]
    if spans := one.meta["spans"]:
      assert spans[0][1] == 0 and spans[-1][2] == one.num_frames <= 196 and len(spans) > 1
      assert all(span[2] == then[1] and span[1] < span[2] for span, then in zip(spans, spans[1:]))
  assert len({clip.id for clip in made}) == len(made)


@pytest.mark.parametrize("kind", ["stitched", "idle"])
def test_sequences_say_what_is_done_when(kind):
  for clip in _made(kind):
    spans = clip.meta["spans"]
    if not spans:  # standing alone
      assert {event.kind for event in find_events(clip.joints)} == {"still"}
      assert all(re.search("stand|does not move", caption.text) for caption in clip.captions)
      continue
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


def test_hands_are_where_their_captions_have_them_and_feet_where_they_were():
  captured = {clip.id: retarget(clip.joints) for clip in _clips() + _clips("theirs")}
  shown = set()
  for clip in _made("postures"):
    *base, place = clip.meta["content"].removeprefix("postures: ").split(" ")
    spans = clip.meta["spans"]
    words = spans[-1][0] if spans else clip.captions[-1].text
    sides = [side for side in ("left", "right") if side in words] or ["left", "right"]
    if spans and re.search("lower|drop|back down", words):
      assert max(distance_to_place(clip.joints, "down", side)[-1] for side in sides) < 0.1
    if place in PLACES and base in ([], ["walk"]) and not spans:
      shown.add("walk" if base else "stand")
      there = np.stack([distance_to_place(clip.joints, place, side) for side in sides])
      assert there[:, -1].max() < 0.1 and (not base or there.max() < 0.1), words
      other = [side for side in ("left", "right") if side not in sides]
      assert all(distance_to_place(clip.joints, place, side)[-1] > 0.05 for side in other)
      assert len(sides) == 1 or all(re.search("both|the hands|the arms|arms crossed|hands together", caption.text)
                                    for caption in clip.captions)
    if base == ["walk"]:
      own, legs = captured[clip.id.split("+")[0]][:clip.num_frames], [j for leg in HUMANML3D.chains[:2] for j in leg]
      np.testing.assert_allclose(clip.joints[:, legs], own[:, legs], atol=1e-5)
  assert shown == {"walk", "stand"}


def test_bodies_lean_to_where_their_captions_say():
  ways = {"left": (1, 0), "right": (-1, 0), "forward": (0, 1), "back": (0, -1)}
  found = set()
  for clip in _made("postures"):
    said = re.match(r"postures: leans (?:to the )?(\w+)$", clip.meta["content"])
    if said:
      found.add(said[1])
      degrees = leans(clip.joints, *ways[said[1]])
      assert degrees[-1] - degrees[0] > 8 and all(re.search("lean|bend|tilt", one.text) for one in clip.captions)
  assert found


def test_a_walk_on_the_spot_to_the_side_or_backward_steps():
  """Standing feet stand, both are lifted, and the captions name the direction or the spot."""
  shown = set()
  for clip in _made("stepping"):
    moved = np.abs(clip.joints[-1, 0] - clip.joints[0, 0])[[0, 2]].max()
    words = " ".join(caption.text for caption in clip.captions)
    goes = "spot" not in clip.meta["content"]
    shown.add(re.search(r"left|right|\bback", words)[0] if goes else "spot")
    assert (moved > 0.7) == goes and ("place" in words or "on the spot" in words) != goes
    ways = {event.way for event in find_events(clip.joints) if event.kind == "walk"}
    assert not goes or ways == {"backward" if "backward" in clip.meta["content"] else re.search("left|right", words)[0]}
    if "backward" in clip.meta["content"]:  # slower than the walk that it was, of 1.2 m/s
      assert 0.5 < moved / (clip.num_frames / 20) < 1.05
    assert planted_speed(clip.joints) < 0.1
    lifted = np.abs(clip.joints[:, 10, 1] - clip.joints[:, 11, 1])
    assert (np.diff((lifted > 0.05).astype(int)) == 1).sum() >= 3
  assert shown == {"left", "right", "back", "spot"}


_TIMES = {1: r"\b(once|one time|a squat|a bow)\b|squats .*up", 2: r"\b(twice|two)\b", 3: r"\bthree\b", 4: r"\bfour\b"}


def test_what_is_counted_is_done_so_often():
  counts = set()
  for clip in augmented(_clips(seeds=3, said=_JUMP), {"counted": 2.0}) + _made("counted"):
    done = how_often(find_events(clip.joints))
    assert clip.num_frames <= 196
    assert all(re.search(_TIMES[done], caption.text) for caption in clip.captions), (done, clip.captions)
    counts.add(done)
  assert len(counts & {2, 3, 4}) > 1


def test_an_excerpt_is_most_of_what_is_done():
  clips = _clips(seeds=3, said=_JUMP)
  made = augmented(clips, {"excerpts": 2.0})
  assert made
  for clip in made:
    source = next(one for one in clips if one.id == clip.id.partition("+")[0])
    jump, = (event for event in find_events(clip.joints) if event.kind != "still")
    assert 30 <= clip.num_frames <= 0.9 * source.num_frames and jump.kind == "jump"
    assert 0.25 < jump.start < 1.4 and all("jump" in caption.text or "hop" in caption.text for caption in clip.captions)


def test_a_body_sits_down_or_stands_up():
  shown = set()
  for clip in _made("seats"):
    shown.add(kind := clip.meta["content"].removeprefix("seat: "))
    height = clip.joints[:, 0, 1] / clip.joints[:, 0, 1].max()
    first, last = (height[0], height[-1]) if kind == "sit" else (height[-1], height[0])
    assert first > 0.9 and last < 0.86
    assert all(re.search(r"sits|takes a seat" if kind == "sit" else "up", caption.text) for caption in clip.captions)
  assert shown == {"sit", "rise"}
  assert augmented(_clips(said={"squat": _SAID["squat"]}), {"seats": 1.0}) == []  # nobody says that it is a chair


def _spin(degrees, rest):
  """A body that stands, turns on the spot within two seconds, and stands."""
  stand = synthetic_joints("stand", 40 + 2 * rest, np.random.default_rng(0))
  angle = np.radians(degrees) * np.clip((np.arange(len(stand)) - rest) / 40, 0, 1)
  sin, cos = np.sin(angle)[:, None], np.cos(angle)[:, None]
  x, z = stand[..., 0], stand[..., 2]
  return np.stack([x * cos + z * sin, stand[..., 1], z * cos - x * sin], -1).astype(np.float32)


@pytest.mark.parametrize("degrees, found", [(180, True), (-180, True), (100, False)])
def test_a_turn_by_half_a_circle_is_turning_around(degrees, found):
  clip = Clip(_spin(degrees, 50), captions=(Caption("a person dances."),), id="spin", split="train", source="ours",
              meta={"content": "dance"})
  made = augmented([clip], {"excerpts": 3.0})
  assert bool(made) == found
  for one in made:
    side = "left" if degrees > 0 else "right"
    assert {f"a person turns around to the {side}.", "someone turns around."} <= {text.text for text in one.captions}


@pytest.mark.parametrize("change, rests", [
    (lambda j: j, True),
    (lambda j: j + np.arange(40)[:, None, None] * [0.05, 0, 0], False),  # 1 m/s
    (lambda j: _raised(j, [21], [0, 0.7, 0]), False),
    (lambda j: _raised(j, [5, 8, 11], [-0.35, 0, 0]), False),  # feet apart
    (lambda j: _raised(j, [8, 11], [0, 0.3, 0]), False),  # on one leg
    (lambda j: lean(j, 0, 1, np.full(40, 30.0)).astype(np.float64), False)])
def test_who_rests_is_slow_and_upright_with_arms_down_and_feet_side_by_side(change, rests):
  assert resting(change(synthetic_joints("stand", 40, np.random.default_rng(0))))[10:30].all() == rests


def _raised(joints, which, by):
  joints[:, which] += by
  return joints


def test_what_wanders_turns_both_ways_on_paths_that_feet_can_stand_on():
  """Whatever walks goes elsewhere than it was captured, no narrower than it can, and nothing says where."""
  source = {clip.id: clip for clip in _clips() + _clips("theirs")}
  turned = []
  for clip in _made("wandering"):
    one = source[clip.id.split("+")[0]]
    assert one.meta["content"] == "walk"
    assert not any(word in text.text for text in clip.captions for word in ("left", "right", "straight", "turn"))
    (path, gone), (old, _) = course(clip.joints), course(retarget(one.joints))
    angle = lambda points: np.unwrap(np.arctan2(*np.diff(points, axis=0).T))
    way = angle(path) - angle(old)
    turned += [way.min(), way.max()]
    assert abs(np.polyfit(gone[:-1], way, 1)[0]) < 1.2 / SMALLEST["walk"]
    assert planted_speed(clip.joints) < 1.5 * planted_speed(retarget(one.joints)) + 0.05
  assert min(turned) < -0.2 and max(turned) > 0.2


def test_an_excerpt_in_which_something_else_is_found_is_dropped(monkeypatch):
  wrong = lambda joints, fps: [event._replace(count=event.count + 1) for event in find_events(joints, fps)]
  monkeypatch.setattr(sys.modules[KINDS["excerpts"].__module__], "find_events", wrong)
  assert augmented(_clips(said=_JUMP), {"excerpts": 2.0}) == []


@pytest.mark.slow
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


@pytest.mark.parametrize("kind, action, plain", [("excerpts", "squat", 1), ("bent_paths", "walk", 2),
                                                 ("time_warp", "walk", 0)])
def test_what_is_said_of_new_clips_keeps_the_manner_of_the_old(kind, action, plain):
  """Two of three sentences about bent paths are plain, or a plain circle would be in hardly any caption."""
  clips = _clips(said={action: f"a timid person {_SAID[action].split(maxsplit=2)[2]}"}, seeds=4)
  texts = [[caption.text.startswith("a timid person ") for caption in clip.captions]
           for clip in augmented(clips, {kind: 2.0})]
  assert any(map(any, texts)) and max(one.count(False) for one in texts) >= plain, texts
  assert plain or all(map(all, texts)), texts


def test_side_steps_are_cut_out_but_of_dances_and_fights():
  walk = _joints("walk", 3)[:100]
  sideways = walk.copy()  # the body faces +z and goes to its left, +x
  sideways[..., 0] += walk[:, :1, 2] * 0.7
  sideways[..., 2] -= walk[:, :1, 2]
  rest = np.repeat(sideways[-1:], 100, 0)
  clip = Clip(np.concatenate([sideways, rest]).astype(np.float32), captions=(Caption("a person moves."),), id="one",
              split="train", source="ours", meta={"content": "moves"})
  made = augmented([clip], {"excerpts": 2.0})
  assert made and {one.meta["content"] for one in made} == {"excerpt: walk left"}
  assert all("left" in caption.text for one in made for caption in one.captions)
  for words in ("a person dances.", "a person does a karate kick."):  # there it is a step of something else
    assert augmented([clip.replace(captions=(Caption(words),))], {"excerpts": 2.0}) == []


@pytest.mark.slow
def test_several_processes_make_what_one_makes():
  clips = _clips("ours", seeds=2) + _clips("theirs")
  config = ConfigDict(dict(mode="corrected", mirror=True, kinematic_captions=True,
                           augment=dict(stitched=0.5, counted=0.5, time_warp=0.5)))
  one, several = (clip_items(clips, ConfigDict(config.to_dict() | {"workers": count}), "train", get_layout("full"))
                  for count in (0, 2))
  assert [item.id for item in one] == [item.id for item in several] and any(item.made for item in one)
  for ours, theirs in zip(one, several):
    assert (ours.features == theirs.features).all() and ours._replace(features=0) == theirs._replace(features=0)
