"""What a sentence asks for is looked for in the motion; one that does not show it is made anew, the best is kept."""
import numpy as np
import pytest

from motion_jax.analysis.events import find_events
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_studio.checks.violations import excess_speed
from motion_studio.checks.violations import violation_score as score
from motion_studio.language import parse
from motion_studio.language.path_shapes import with_explicit_side
from motion_studio.language.requirements import Requirement, is_counted, once

STAYS = Requirement("stays", "", 1, False)


@pytest.mark.parametrize("text, found", [
    ("a person kicks twice", [Requirement("kick", "", 2, True)]),
    ("someone kicks with the left foot", [Requirement("kick", "left", 1, False)]),
    ("a man jumps three times, then kicks twice with the right leg", [
        Requirement("jump", "", 3, True), Requirement("kick", "right", 2, True)]),
    ("a person kicks, then kicks twice", [Requirement("kick", "", 3, True)]),
    ("someone takes two bows", [Requirement("bow", "", 2, True)]),
    ("a person raises the right hand and waves it", [
        Requirement("raise", "right", 1, False), Requirement("wave", "", 1, False)]),
    ("a person raises the left arm", [Requirement("raise", "left", 1, True)]),
    ("she puts her hands up", [Requirement("raise", "both", 1, True)]),
    ("someone raises a hand to the chest", []), ("a person lifts a box with both hands", []),
    ("a person turns on the light", [STAYS]),
    ("a person turns off his lamp", [STAYS]), ("a person turns on the spot", [
        STAYS, Requirement("turn", "", 1, False)]),
    ("a person side steps to the left", [
        Requirement("aside", "left", 1, False), Requirement("sideways", "left", 1, False)]),
    ("a person lies down", [Requirement("lie", "", 1, False)]),
    ("this person, standing still, lifts an arm as if to see the watch", []),
    ("a person waves the right hand three times", [Requirement("wave", "right", 1, False)]),
    ("someone walks backwards and turns left", [
        Requirement("walk", "backward", 1, False), Requirement("turn", "left", 1, False, (40, 140))]),
    ("someone takes two steps back", [Requirement("step", "backward", 1, False)]),
    ("a person turns around to the left", [
      STAYS, Requirement("turn", "left", 1, False, (130, 230))]),
    ("a person turns right by 90 degrees", [
      STAYS, Requirement("turn", "right", 1, False, (50, 130))]),
    ("she does not move", [Requirement("still", "", 1, False)]),
    ("a person turns left by 270 degrees", [
      STAYS, Requirement("turn", "left", 1, False, (216, 324))]),
    ("a person turns all the way around", [
      STAYS, Requirement("turn", "", 1, False, (290, 430))]),
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
    ("a person jogs in place", [STAYS, Requirement("treads", "", 1, False),
                                Requirement("run", "", 1, False)]),
    ("a person jumps to his right", [Requirement("aside", "right", 1, False), Requirement("jump", "", 1, False)]),
    ("the person is balancing on his left foot", [Requirement("balance", "left", 1, False)]),
    ("she raises the left knee", [Requirement("foot", "left", 1, False)]),
    ("a person bends over", [Requirement("bend", "", 1, False)]),
    ("someone crouches", [Requirement("crouch", "", 1, False)]),
    ("a man walks away, turns and walks back", [
        Requirement("return", "", 1, False), Requirement("turn", "", 1, False, (130, 230))]),
    ("the person does a couple of small kicks with his left leg", [Requirement("kick", "left", 1, False)]),
    ("a person does a kick flip", []), ("a person makes a phone call", []),
    ("a person walks forward and raises their arms in victory", [
        Requirement("usual", "walk", 1, False), Requirement("raise", "both", 1, False)]),
    ("person is turning around in circles", [STAYS,
                                             Requirement("turn", "", 1, False, (290, float("inf")))]),
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
  gestures = np.repeat(still[:1], 100, axis=0)
  gestures[50:54, 20, 1] += (0.1, 0.2, 0.2, 0.1)  # one hand, for a fifth of a second
  assert score(gestures, [Requirement("still", "", 1, False)]) > 0.1
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
  assert with_explicit_side(text, 1) == said
  assert with_explicit_side(text, 2) == said.replace("to the left", "to the right")


def test_a_circle_has_time_to_be_gone_round():
  assert parse("a person walks in a circle, then bows").min_duration == 8
  assert 6 < parse("she runs in circles").min_duration < 8
  assert parse("a person walks in a figure eight").min_duration == 12
  for text in ("a person circles the arms", "a person walks", "a person walks in a half circle"):
    assert parse(text).min_duration == 0


def test_nobody_runs_faster_than_people_do():
  asked, frames = [Requirement("run", "", 1, False)], np.arange(80)
  at = lambda speed: _joints("walk") + (speed * frames / 20.0)[:, None, None] * np.array([0, 0, 1.0]) - (
      _joints("walk")[:, :1] * [1.0, 0, 1])
  excess = excess_speed
  assert excess(at(4.4), asked) == score(at(4.4), asked) == 0
  assert 0.04 < excess(at(5.0), asked) < excess(at(5.6), asked) == score(at(5.6), asked) < 0.3
  assert excess(at(5.6), [Requirement("jump", "", 1, False)]) == 0 == excess(at(5.6)[:1], asked)


def test_raised_hands():
  wanted = lambda side, counted=False: [Requirement("raise", side, 1, counted)]
  left = _joints("wave_left")
  assert score(left, wanted("left")) == score(left, wanted("left", True)) == score(left, wanted("")) == 0
  assert score(left, wanted("right")) == 1 == score(left, wanted("both")) and score(left, wanted("right", True)) == 1.5
  both = left.copy()
  both[:, [17, 19, 21]] = left[:, [16, 18, 20]] * (-1, 1, 1)
  assert score(both, wanted("both")) == 0 == score(both, wanted("left"))
  assert score(both, wanted("left", True)) == 0.5


def test_a_walk_to_a_side():
  wanted = lambda side: [Requirement("sideways", side, 1, False)]
  stands = _joints("stand")
  to_the_left = stands + np.linspace(0, 2, len(stands))[:, None, None] * (1, 0, 0)  # it faces z
  assert score(to_the_left, wanted("left")) == 0 == score(to_the_left, wanted(""))
  assert score(to_the_left, wanted("right")) == 1 == score(stands, wanted("left")) == score(_joints("walk"), wanted(""))


def test_lying():
  lying = _joints("stand")[..., [0, 2, 1]]
  assert score(lying, [Requirement("lie", "", 1, False)]) == 0 < score(_joints("stand"), [
      Requirement("lie", "", 1, False)])
