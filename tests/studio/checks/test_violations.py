"""What a sentence requires, and how far a motion is from it."""
import numpy as np

from motion_jax.analysis.events import Event, find_events
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax_studio.checks.violations import events_of, excess_speed
from motion_jax_studio.checks.violations import violation_score as score
from motion_jax_studio.language import parse
from motion_jax_studio.language.requirements import Requirement
from tests.studio.sentences import in_words, table


def test_what_sentences_require_that_can_be_measured():
  assert {text: in_words(parse(text).requirements) for text, _ in table("requirements")} == dict(table("requirements"))


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
  nods = np.repeat(still[:1], 100, axis=0)
  nods[:, 15, 2] += 0.05 * np.sin(np.arange(100) * 0.8)  # the head alone
  assert score(nods, [Requirement("still", "", 1, False)]) > 0.5
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
  """Joints facing +z with a straight leg swung up ahead around each of some frames, within a number of seconds."""
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


def test_a_circle_has_time_to_be_gone_round():
  assert parse("a person walks in a circle, then bows").min_duration == 8
  assert 6 < parse("she runs in circles").min_duration < 8
  assert parse("a person walks in a figure eight").min_duration == 12
  for text in ("a person circles the arms", "a person walks", "a person walks in a half circle"):
    assert parse(text).min_duration == 0


def test_a_run_is_no_faster_than_people_run():
  asked, frames = [Requirement("run", "", 1, False)], np.arange(80)
  at = lambda speed: _joints("walk") + (speed * frames / 20.0)[:, None, None] * np.array([0, 0, 1.0]) - (
      _joints("walk")[:, :1] * [1.0, 0, 1])
  excess = excess_speed
  assert excess(at(4.4), asked) == score(at(4.4), asked) == 0
  assert 0.04 < excess(at(5.0), asked) < excess(at(5.6), asked) == score(at(5.6), asked) < 0.3
  assert excess(at(5.6), [Requirement("jump", "", 1, False)]) == 0 == excess(at(5.6)[:1], asked)


def test_an_event_of_both_sides_is_one_of_either():
  both, left = Event("wave", 0, 1, "both"), Event("wave", 0, 1, "left")
  of = lambda side: events_of([both, left], Requirement("wave", side, 1, False))
  assert of("left") == of("") == [both, left] and of("right") == [both]


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
