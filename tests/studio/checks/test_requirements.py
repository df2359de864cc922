"""What a sentence asks for is looked for in the motion; one that does not show it is made anew, the best is kept."""
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from motion_jax.analysis.events import find_events
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.cdamd.model import CdamdModel
from motion_jax.models.results import Motion, gathered
from motion_jax.motion.skeleton import HUMANML3D
from motion_studio.checks import requirements as looking
from motion_studio.checks.requirements import excess_speed
from motion_studio.checks.requirements import violation_score as score
from motion_studio.language import parse
from motion_studio.language.path_shapes import with_a_side
from motion_studio.language.requirements import Requirement, is_counted, once
from motion_studio.planning import sequencing as composed

pytestmark = pytest.mark.filterwarnings("ignore:. attempts, ")


@pytest.mark.parametrize("text, found", [
    ("a person kicks twice", [Requirement("kick", "", 2, True)]),
    ("someone kicks with the left foot", [Requirement("kick", "left", 1, False)]),
    ("a man jumps three times, then kicks twice with the right leg", [
        Requirement("jump", "", 3, True), Requirement("kick", "right", 2, True)]),
    ("a person kicks, then kicks twice", [Requirement("kick", "", 3, True)]),
    ("someone takes two bows", [Requirement("bow", "", 2, True)]),
    ("a person raises the right hand and waves it", [Requirement("wave", "", 1, False)]),
    ("a person waves the right hand three times", [Requirement("wave", "right", 1, False)]),
    ("someone walks backwards and turns left", [
        Requirement("walk", "backward", 1, False), Requirement("turn", "left", 1, False, (40, 140))]),
    ("someone takes two steps back", [Requirement("step", "backward", 1, False)]),
    ("a person turns around to the left", [Requirement("turn", "left", 1, False, (130, 230))]),
    ("a person turns right by 90 degrees", [Requirement("turn", "right", 1, False, (50, 130))]),
    ("she does not move", [Requirement("still", "", 1, False)]),
    ("a person turns left by 270 degrees", [Requirement("turn", "left", 1, False, (216, 324))]),
    ("a person turns all the way around", [Requirement("turn", "", 1, False, (290, 430))]),
    ("a person turns left around the corner", [Requirement("turn", "left", 1, False, (40, 140))]),
    ("a person turns left, then turns left", [Requirement("turn", "left", 2, False)]),
    ("a person turns the head to the left", []),
    ("she strikes with the fist", [Requirement("punch", "", 1, False)]), ("she strikes a pose", []),
    ("a person walks back and forth", []),
    ("a person walks back to the chair", []),
    ("a person walks without jumping", []),
    ("a person walks forward", [Requirement("usual", "walk", 1, False)]),
    ("a man dances happily", [Requirement("dance", "", 1, False)]),
    ("the person performs a salsa dance", [Requirement("dance", "", 1, False)]),
    ("a woman dances to the music", [Requirement("dance", "", 1, False)]),
    ("a person dances across the room", []),
    ("a person sits down and waves, then stays there", [
        Requirement("seated", "", 1, False), Requirement("sit", "", 1, False), Requirement("wave", "", 1, False)]),
    ("a person sits down, waves and stands up", [
        Requirement("rise", "", 1, False), Requirement("sit", "", 1, False), Requirement("wave", "", 1, False)]),
    ("a person sits down and picks something up", [Requirement("sit", "", 1, False)]),
    ("someone takes a seat", [Requirement("seated", "", 1, False), Requirement("sit", "", 1, False)]),
    ("a person stands up from a chair", [Requirement("rise", "", 1, False)]),
    ("she sits down and gets up again", [Requirement("rise", "", 1, False), Requirement("sit", "", 1, False)]),
    ("a man gets up and walks forward", []),
    ("a man stands still", [Requirement("still", "", 1, False)]),
    ("a man walks, then stands still", [Requirement("usual", "walk", 1, False)]),
    ("someone jogs and then kicks", [Requirement("run", "", 1, False), Requirement("kick", "", 1, False)]),
    ("a man stands up straight", []),
    ("someone walks forward, then dances", []),
])
def test_what_a_sentence_asks_for_that_can_be_seen(text, found):
  assert parse(text).requirements == found


@pytest.mark.parametrize("prompt, counts", [
    ("a person kicks", True), ("someone jumps forward", True), ("a person walks", False), ("a person waves", False),
    ("a person kicks, then bows", False)])
def test_what_can_be_counted_is_to_be_seen_just_once(prompt, counts):
  assert is_counted(parse(prompt).requirements) == counts
  assert [one.counted for one in once(parse(prompt).requirements)] == [
      one.kind in ("kick", "jump", "bow") for one in parse(prompt).requirements]


def _joints(action, seed=0, frames=80):
  return synthetic_joints(action, frames, np.random.default_rng(seed))


def _seated(joints, rows, on=0.35):
  """Joints whose body, facing +z, has its thighs level in these frames, and its pelvis that many metres up."""
  made = joints * 1.0
  for hip, knee, ankle, toe in ((1, 4, 7, 10), (2, 5, 8, 11)):
    made[:, knee] = made[:, hip] + [0, 0, 0.4]
    made[:, ankle] = made[:, knee] - [0, 0.3, 0]
    made[:, toe] = made[:, ankle] + [0, 0, 0.1]
  made[..., 1] -= made[:, :1, 1] - on
  return np.where(rows[:, None, None], made, joints)


def test_what_is_missing_is_counted():
  walk, jump = _joints("walk"), _joints("jump")
  assert score(walk, [Requirement("jump", "", 1, False)]) == 1 and score(walk, [Requirement("jump", "", 3, True)]) == 3
  number = 3 - score(jump, [Requirement("jump", "", 3, True)])
  assert number == 1 and score(jump, [Requirement("jump", "", 1, False)]) == 0
  assert score(np.concatenate([jump, jump]), [Requirement("jump", "", 1, True)]) == 1  # once too often
  assert score(_joints("turn_left"), [Requirement("turn", "left", 1, False)]) == 0
  assert score(_joints("turn_left"), [Requirement("turn", "right", 1, False)]) == 1
  assert score(_joints("wave_left"), [Requirement("wave", "left", 1, False)]) == 0
  turned = sum(event.amount for event in find_events(_joints("turn_left"), 20.0) if event.kind == "turn")
  far = [score(_joints("turn_left"), [Requirement("turn", "left", 1, False, (turned + by, 400))])
         for by in (-10, 30, 60)]
  assert far[0] == 0 < far[1] < far[2] < 1
  still = np.repeat(walk[:1], 40, axis=0)
  assert score(still, [Requirement("still", "", 1, False)]) == 0 < score(walk, [Requirement("still", "", 1, False)])
  slides = still + 0.01 * np.arange(40)[:, None, None] * np.array([1.0, 0, 0])  # slower than a body sways, but away
  assert score(slides, [Requirement("still", "", 1, False)]) > 0.3
  waves = _joints("wave_left")
  waves = waves - (waves[:, :1] - waves[:1, :1]) * [1.0, 0, 1]
  assert score(waves, [Requirement("still", "", 1, False)]) > 0.2
  back = walk[::-1] * 1.0  # as it was walked, time turned round
  asked = [Requirement("walk", "backward", 1, False)]
  assert score(walk, asked) == 1 and score(back, asked) == 0
  assert score(np.concatenate([walk, back]), asked) == 0
  steps, brief = [Requirement("step", "backward", 1, False)], np.concatenate([walk, back[:14]])
  assert score(brief, asked) == 1 and score(brief, steps) == 0 and score(walk, steps) == 1
  at = np.arange(len(walk))
  low = _seated(walk, at >= 60)
  assert score(walk, [Requirement("sit", "", 1, False)]) == 1 and score(low, [Requirement("sit", "", 1, False)]) == 0
  asked = [Requirement("seated", "", 1, False)]
  assert score(low, asked) == 0 < score(low[::-1], asked) < 1  # who sits down and gets up again has not quite done it
  asked = [Requirement("rise", "", 1, False)]
  assert score(low[::-1], asked) == 0 and score(low, asked) == score(walk, asked) == 1  # up, down, never down
  seated = _seated(_seated(walk, at >= 4, 0.5), (at > 20) & (at < 30), 0.4)
  assert score(seated, asked) == 1  # who sits nearly all the time and bobs is not up
  crouched = walk - np.where(at >= 60, 0.35, 0.0)[:, None, None] * [0, 1.0, 0]
  assert score(crouched, [Requirement("sit", "", 1, False)]) == 1  # low, but on legs that are under it
  assert score(walk, []) == 0
  dance = [Requirement("dance", "", 1, False)]
  away = score(walk, dance)
  assert 0 < away < 1 and 0 < score(walk[:len(walk) * 3 // 4], dance) < away  # it went away
  assert score(_joints("wave_left"), [Requirement("dance", "", 1, False)]) == 0


def _swung(joints, leg, centers, seconds, degrees=75.0):
  """Joints facing +z with a straight leg swung up ahead around each of some frames, for so many seconds."""
  made, k = joints * 1.0, np.arange(len(joints))
  angle = np.radians(degrees) * sum(np.exp(-((k - at) / (20 * seconds / 4)) ** 2) for at in centers)
  for joint in leg[1:]:
    down = np.linalg.norm(made[:, joint] - made[:, leg[0]], axis=-1)
    made[:, joint] = made[:, leg[0]] + down[:, None] * np.stack([0 * angle, -np.cos(angle), np.sin(angle)], -1)
  return made


def test_a_kick_that_is_slow_counts_half_where_kicks_are_counted():
  still = np.repeat(_joints("wave_left")[:1], 100, axis=0)
  right, left = (2, 5, 8, 11), (1, 4, 7, 10)
  two = _swung(still, right, (20, 60), 0.6)
  three = _swung(two, left, (85,), 2.4, 60.0)
  twice, kicks = [Requirement("kick", "", 2, True)], [Requirement("kick", "", 1, False)]
  assert score(two, twice) == score(two, kicks) == score(three, kicks) == 0
  assert 0 < score(three, twice) < 1 and score(still, twice) > 2


@pytest.mark.parametrize("text, said", [
    ("a person walks in a circle", "a person walks in a circle to the left"),
    ("a man is walking in circles, then waves", "a man is walking in circles to the left, then waves"),
    ("she walks one full circle", "she walks one full circle to the left"),
    ("a person walks in a circle to the right", "a person walks in a circle to the right"),
    ("a circle of people stands still", "a circle of people stands still"),
    ("a person walks", "a person walks")])
def test_a_circle_gets_a_side(text, said):
  assert with_a_side(text, 1) == said
  assert with_a_side(text, 2) == said.replace("to the left", "to the right")


def test_a_circle_has_time_to_be_gone_round():
  assert parse("a person walks in a circle, then bows").min_duration == 8
  assert 6 < parse("she runs in circles").min_duration < 8
  for text in ("a person circles the arms", "a person walks", "a person walks in a half circle"):
    assert parse(text).min_duration == 0


def test_both_methods_give_a_circle_its_time(monkeypatch):
  monkeypatch.setattr("motion_jax.models.cdamd.length.middle_frames", lambda *_: np.array([60]))
  stub = SimpleNamespace(fps=20.0, nearest_captions=lambda *_: [("", 60)], frozen={"length": None}, frames_per_latent=4,
                         length=SimpleNamespace(apply=lambda *_: None), encoder=lambda _: [np.zeros((1, 1, 2))],
                         config=SimpleNamespace(data=SimpleNamespace(max_frames=150)))
  for method, longest in ((TextToMotionModel, 160), (CdamdModel, 150)):
    assert method.natural_frames(stub, "a person walks") == 60
    assert method.natural_frames(stub, "a person walks in a circle") == longest


def test_nobody_runs_faster_than_people_do():
  asked, frames = [Requirement("run", "", 1, False)], np.arange(80)
  at = lambda speed: _joints("walk") + (speed * frames / 20.0)[:, None, None] * np.array([0, 0, 1.0]) - (
      _joints("walk")[:, :1] * [1.0, 0, 1])
  excess = excess_speed
  assert excess(at(4.4), asked) == score(at(4.4), asked) == 0
  assert 0.04 < excess(at(5.0), asked) < excess(at(5.6), asked) == score(at(5.6), asked) < 0.3
  assert excess(at(5.6), [Requirement("jump", "", 1, False)]) == 0 == excess(at(5.6)[:1], asked)


class _Stub:
  """Makes a jump where its key says so, else a walk."""
  fps = 20.0

  def __init__(self, jumps):
    self.jumps, self.made, self.fps, self.reports_to_terminal = jumps, [], 20.0, True
    self.sampling = lambda **choices: SimpleNamespace(guidance_scale=choices.get("guidance_scale", 2.0))
    self.stats = type("Stats", (), {"layout": type("Layout", (), {"skeleton": HUMANML3D})})

  def motion(self, prompt, key):
    self.made.append((prompt, key.tolist()))
    joints = _joints("jump" if self.jumps(prompt, key) else "walk").astype(np.float32)
    return Motion(joints, 20.0, features=joints.reshape(len(joints), -1))


def _made(stub, monkeypatch, prompts, tries, literal=False):
  keys = jax.random.split(jax.random.key_data(jax.random.key(0)), len(prompts))
  monkeypatch.setattr(composed, "_generated", lambda model, prompts, num_frames, seconds, keys, *rest, **how: gathered(
      [model.motion(prompt, key) for prompt, key in zip(prompts, keys)]))
  return keys, composed.generate(stub, prompts, None, None, keys, [None] * len(prompts), True, literal, {}, tries)


def test_only_what_does_not_show_it_is_made_anew_and_with_a_key_of_its_own(monkeypatch):
  count = {}

  def third_time(prompt, key):
    count[prompt] = count.get(prompt, 0) + 1
    return count[prompt] == 3 and "jumps" in prompt

  stub = _Stub(third_time)
  prompts = ["a person walks", "a person jumps", "someone jumps"]
  keys, made = _made(stub, monkeypatch, prompts, 4)
  assert [prompt for prompt, _ in stub.made] == prompts + prompts[1:] * 2
  assert len({tuple(key) for _, key in stub.made}) == len(stub.made)
  assert [motion.meta.get("tries") for motion in made] == [None, 3, 3]
  assert [motion.id for motion in made] == ["motion_0", "motion_1", "motion_2"]
  # Alone it is the same motion, from the same keys.
  count.clear()
  alone = _Stub(third_time)
  monkeypatch.setattr(jax.random, "split", lambda key, number: keys[1:2])
  _made(alone, monkeypatch, prompts[1:2], 4)
  assert [key for _, key in alone.made] == [key for prompt, key in stub.made if prompt == prompts[1]]


def test_of_equals_the_first_is_kept_and_words_that_are_said_as_they_are_are_not_looked_for(monkeypatch):
  for tries, literal, times in ((3, False, 3), (1, False, 1), (4, True, 1)):
    stub = _Stub(lambda prompt, key: False)
    _, made = _made(stub, monkeypatch, ["a person jumps"], tries, literal)
    assert len(stub.made) == times and "tries" not in made[0].meta


def test_only_a_circle_whose_side_is_not_said_has_one_in_what_is_made_anew(monkeypatch):
  either, clockwise = "he walks in a circle", "he walks in a clockwise circle"
  for prompt, anew in ((either, [f"{either} to the left", f"{either} to the right"]), (clockwise, [clockwise] * 2)):
    stub = _Stub(lambda prompt, key: False)
    _made(stub, monkeypatch, [prompt], 3)
    assert [said for said, _ in stub.made] == [prompt, *anew]


def test_the_best_of_all_tries_is_kept(monkeypatch):
  asked = iter([3, 1, 2, 1])
  monkeypatch.setattr(looking, "violation_score", lambda *_: next(asked))
  _, made = _made(_Stub(lambda prompt, key: False), monkeypatch, ["a person jumps"], 4)
  assert made[0].meta["tries"] == 2


def test_words_weigh_twice_as_much_in_what_is_made_anew(monkeypatch):
  """But where somebody says how much they weigh, and in a student, that has no guidance of its own."""
  asked = []
  made = gathered([_Stub(lambda prompt, key: False).motion("a person jumps", np.zeros(2))])
  monkeypatch.setattr(composed, "_generated", lambda *given, apart=False: asked.append(given[-1]) or made)
  stub, keys = _Stub(lambda prompt, key: False), jax.random.split(jax.random.key_data(jax.random.key(0)), 1)
  make = lambda how: composed.generate(stub, ["a person jumps"], None, None, keys, [None], True, False, how, 3)
  make({"num_steps": 3})
  assert asked == [{"num_steps": 3}] + [{"num_steps": 3, "guidance_scale": 4.0}] * 2
  asked.clear()
  make({"guidance_scale": 1.5})
  assert asked == [{"guidance_scale": 1.5}] * 3
  asked.clear()
  stub.sampling = lambda **choices: SimpleNamespace(guidance_scale=1.0)
  make({})
  assert asked == [{}] * 3


def test_words_weigh_half_as_much_where_they_were_overdone(monkeypatch):
  """Only of what misses nothing else, and never less than the model's own motion with words."""
  asked, keys = [], jax.random.split(jax.random.key_data(jax.random.key(0)), 2)
  runs = _joints("walk") + np.linspace(0, 40, 80)[:, None, None] * np.array([0, 0, 1.0])  # ten metres a second
  stub = _Stub(lambda prompt, key: False)
  made = gathered([Motion(runs.astype(np.float32), 20.0, features=runs.reshape(80, -1).astype(np.float32))] * 2)
  monkeypatch.setattr(composed, "_generated", lambda model, prompts, *given, apart=False: asked.append(
      (prompts, given[-1].get("guidance_scale"))) or made)
  prompts = ["a person runs", "a person runs and kicks"]
  make = lambda: composed.generate(stub, prompts, None, None, keys, [None] * 2, True, False, {}, 2)
  make()
  assert asked == [(prompts, None), (prompts[1:], 4.0), (prompts[:1], 1.0)]
  asked.clear()
  stub.sampling = lambda **choices: SimpleNamespace(guidance_scale=1.5)
  make()
  assert asked[1:] == [(prompts[1:], 3.0), (prompts[:1], 1.0)]


def test_from_the_third_try_on_actions_are_made_apart(monkeypatch):
  asked = []
  made = gathered([_Stub(lambda prompt, key: False).motion("a person jumps", np.zeros(2))])
  monkeypatch.setattr(composed, "_generated", lambda *_, apart=False: asked.append(apart) or made)
  stub, keys = _Stub(lambda prompt, key: False), jax.random.split(jax.random.key_data(jax.random.key(0)), 1)
  composed.generate(stub, ["a person jumps"], None, None, keys, [None], True, False, {}, 4)
  assert asked == [False, False, True, True]
