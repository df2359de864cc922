"""Where a walk leads and how fast it is: what a sentence says of it, and how far a motion is from that."""
import numpy as np

from motion_jax.analysis.signals import Body
from motion_jax_studio.checks.path_violations import path_violation
from motion_jax_studio.checks.violations import excess_speed
from motion_jax_studio.checks.violations import violation_score as score
from motion_jax_studio.language import parse
from motion_jax_studio.language.path_shapes import KINDS, PathShape
from motion_jax_studio.language.requirements import Requirement
from tests.studio.sentences import in_words, table


def test_shape_and_pace_that_sentences_say_of_a_walk():
  said = lambda text: in_words(one for one in parse(text).requirements if one.kind in KINDS - {"usual"})
  assert {text: said(text) for text, _ in table("paths")} == dict(table("paths"))


def test_a_walk_of_which_no_pace_is_said_is_not_quick():
  usual = [Requirement("usual", "walk", 1, False)]
  at = [excess_speed(_walk(lambda t: 0 * t, pace), usual) for pace in (0.1, 1.45, 1.6, 1.8)]
  assert at[:2] == [0, 0] and 0 < at[2] < at[3] == score(_walk(lambda t: 0 * t, 1.8), usual) < 1


def _walk(degrees, pace=1.15, seconds=8.0):
  """A stiff body whose course over the ground is degrees (a function of 0 to 1), at such a pace."""
  at = np.radians(degrees(np.linspace(0, 1, round(20 * seconds))))
  path = np.cumsum(pace / 20 * np.stack([np.sin(at), np.zeros_like(at), np.cos(at)], -1), axis=0)
  body = np.random.default_rng(0).normal(0, 0.1, (22, 3)) + [0, 0.9, 0]
  return path[:, None] + body


def _missed(joints, *way):
  return path_violation(Body(joints, 20.0), PathShape(*way))


def test_a_circle_leads_all_the_way_round_to_its_side():
  rounds = [_missed(_walk(lambda t, to=to: to * t), "circle", "left") for to in (360, 280, 180, 90)]
  assert rounds[0] == 0 < rounds[1] < rounds[2] < rounds[3] < 1
  assert _missed(_walk(lambda t: -360 * t), "circle", "right") == 0 == _missed(_walk(lambda t: -360 * t), "circle", "")
  assert _missed(_walk(lambda t: -360 * t), "circle", "left") == 1  # the wrong way round
  eight = _walk(lambda t: 360 * np.minimum(t, 1 - t) * 2)  # there, and back again
  assert _missed(eight, "circle", "") > 0.8 and _missed(eight, "figure-eight", "") == 0
  loops = [_missed(_walk(lambda t, to=to: to * np.minimum(t, 1 - t) * 2), "figure-eight", "") for to in (240, 120, 0)]
  assert 0 < loops[0] < loops[1] < loops[2] < 1 and _missed(_walk(lambda t: 360 * t), "figure-eight", "") > 0.8
  swerves = _walk(lambda t: np.interp(t, [0, 0.2, 1], [0, -90, 240]))  # first to the other side
  assert 0 < _missed(_walk(lambda t: 240 * t), "circle", "left") < _missed(swerves, "circle", "left")


def test_half_a_circle_zigzags_and_straight_ways():
  half = [_missed(_walk(lambda t, to=to: to * t), "u-turn", "") for to in (180, 120, 270, 360)]
  assert half[0] == 0 < half[1] < half[3] and 0 < half[2] < half[3] < 1
  swerving = lambda times: _walk(lambda t: 40 * np.sin(np.pi * times * t))
  zigzag = [_missed(swerving(times), "zigzag", "") for times in (6, 2, 0)]
  assert zigzag[0] == 0 < zigzag[1] < zigzag[2] < 1
  straight = [_missed(_walk(lambda t, to=to: to * t), "straight", "") for to in (20, 90, 180)]
  assert straight[0] == 0 < straight[1] < straight[2] < 1


def test_slow_and_quick_are_against_the_usual_pace():
  at = lambda pace, kind, gait="walk": _missed(_walk(lambda t: 0 * t, pace), kind, gait)
  assert at(0.8, "slowly") == 0 < at(0.9, "slowly") < at(1.3, "slowly") < 1
  assert at(1.6, "quickly") == 0 < at(1.4, "quickly") < at(1.0, "quickly") < 1
  assert at(3.7, "quickly", "run") == 0 < at(3.0, "quickly", "run") and at(2.0, "slowly", "run") == 0
  assert at(0.1, "slowly") == at(0.1, "quickly") == 1  # goes nowhere
  one_frame = Body(_walk(lambda t: 0 * t)[:1], 20.0)
  assert at(0.25, "slowly") == 0 and path_violation(one_frame, PathShape("slowly", "walk")) == 1
