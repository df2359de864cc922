"""Where a walk leads and how fast it is: what a sentence says of it, and how far a motion is from that."""
import numpy as np
import pytest

from motion_jax.analysis.signals import Body
from motion_studio.checks.path_violations import path_violation
from motion_studio.checks.violations import excess_speed
from motion_studio.checks.violations import violation_score as score
from motion_studio.language import parse
from motion_studio.language.path_shapes import KINDS, PathShape
from motion_studio.language.requirements import Requirement


@pytest.mark.parametrize("text, found", [
    ("a person walks in a circle", [PathShape("circle", "")]),
    ("someone walks in a counter-clockwise circle", [PathShape("circle", "left")]),
    ("someone strolls clockwise", [PathShape("circle", "right")]),
    ("a person circles around to the left", [PathShape("circle", "left")]),
    ("walks in a big circle, then waves", [PathShape("circle", "")]),
    ("a man walks in a half circle to the right", [PathShape("u-turn", "right")]),
    ("walk half a circle", [PathShape("u-turn", "")]),
    ("a man makes a u-turn while walking", [PathShape("u-turn", "")]),
    ("someone walks ahead and makes a u-turn to the left", [PathShape("u-turn", "left")]),
    ("someone walks in a circle, then makes a u-turn", []),
    ("a person walks in a circle and makes a phone call", [PathShape("circle", "")]),
    ("someone zigzags forward", [PathShape("zigzag", "")]),
    ("a person walks straight ahead", [PathShape("straight", "")]),
    ("she hurries in a circle", [PathShape("circle", ""), PathShape("quickly", "walk")]),
    ("an old man walks slowly", [PathShape("slowly", "walk")]),
    ("the person takes slow steps ahead", [PathShape("slowly", "walk")]),
    ("someone sprints ahead", [PathShape("quickly", "run")]),
    ("a person walks counter clockwise in a circle", [PathShape("circle", "left")]),
    ("someone walks in an anti-clockwise circle", [PathShape("circle", "left")]),
    ("walks in a semi circle to the left", [PathShape("u-turn", "left")]),
    ("a person walks in a circle and jumps", [PathShape("circle", "")]),
    ("a person walks in a circle starting with the left foot", [PathShape("circle", "")]),
    ("a person walks in a circle with hands behind the back", [PathShape("circle", "")]),
    ("someone walks in a circle, turning left", [PathShape("circle", "left")]),
    ("a person turns around and walks quickly away", [PathShape("quickly", "walk")]),
    ("someone walks slowly with a straight back", [PathShape("slowly", "walk")]),
    ("someone walks in a zig zag", [PathShape("zigzag", "")]),
    ("a person walks in an s-shape", [PathShape("zigzag", "")]),
    ("a person walks along an s curve", [PathShape("zigzag", "")]),
    ("a man walks in a wavy line", [PathShape("zigzag", "")]),
    ("someone walks along a winding path", [PathShape("zigzag", "")]),
    ("a person walks in a figure eight", [PathShape("figure-eight", "")]),
    ("someone walks a figure of 8", [PathShape("figure-eight", "")]),
    ("a man walks in the shape of an eight", [PathShape("figure-eight", "")]),
    ("a person walks in a figure-8 pattern with the arms out", [PathShape("figure-eight", "")]),
    ("a person walks eight steps", []), ("a figure walks 8 steps", []),
    ("a person walks straight", [PathShape("straight", "")]),
    ("a person slowly walks in a big circle then stops", [PathShape("circle", ""), PathShape("slowly", "walk")]),
    # No walk, not of the whole body, of one of several walks, or of a walk whose usual pace is another one.
    ("a person turns in a circle", []), ("a person stands up straight", []), ("a person waves quickly", []),
    ("a person walks forward making circles with the arms", []), ("someone draws circles in the air", []),
    ("a person walks quickly, then walks slowly", []), ("a person walks straight ahead, then turns around", []),
    ("someone walks backward slowly", []), ("a person walks faster and faster", []),
    *((text, []) for text in (
        "marches quickly in place", "runs fast on the spot", "walks halfway around a circle", "walks 1/4 of a circle",
        "walks straight ahead and back", "walks back and forth in a straight line", "walks slowly, then gallops away",
        "a person walks straight ahead, then returns", "walks slowly at first, then faster", "walks into the circle",
        "walks in a circle to the left, then in a circle to the right", "a man circles his shoulders",
        "makes a half circle with the right foot", "walks through a circle of people",
        "walks forward with a quick stop",
        "walks quickly, slowing down at the end", "one and a half circles", "walks one and a half circles")),
    ("walks three quarters of a circle", []), ("a person does not walk in a circle", []),
])
def test_what_a_sentence_says_of_a_walk(text, found):
  assert [PathShape(one.kind, one.side) for one in parse(text).requirements if one.kind in KINDS - {"usual"}] == found


def test_who_walks_turning_to_a_side_turns():
  for text in ("she walks, turning to the left", "she takes a left turn", "she walks and makes a left turn",
               "they take a left turn"):
    assert [one for one in parse(text).requirements if one.kind != "usual"] == [
        Requirement("turn", "left", 1, False, (40, 140))]
  assert parse("walks slowly, turning to the right").requirements == [
      Requirement("slowly", "walk", 1, False), Requirement("turn", "right", 1, False, (40, 140))]
  assert parse("walks to the right, turning to the left").requirements[-1][:2] == ("turn", "left")
  assert [one.kind for one in parse("walks in a circle, turning left").requirements] == ["circle", "usual"]
  assert parse("a person steps to the right while looking around").requirements == [
      Requirement("aside", "right", 1, False), Requirement("sideways", "right", 1, False)]
  assert [one.kind for one in parse("someone walks and makes a u turn to the left").requirements] == [
      "u-turn", "usual"]


def test_a_walk_of_which_no_pace_is_said_is_not_quick():
  usual = [Requirement("usual", "walk", 1, False)]
  assert parse("a person walks forward").requirements == usual
  assert parse("a man strolls forward, then waves").requirements[:1] == usual
  for text in ("a person walks quickly", "someone walks backward", "a person runs", "a man marches forward"):
    assert "usual" not in [one.kind for one in parse(text).requirements]
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


def test_they_are_looked_at():
  asked = parse("a person walks quickly in a circle").requirements
  assert score(_walk(lambda t: 360 * t, 1.6), asked) == 0
  assert 0 < score(_walk(lambda t: 360 * t, 1.3), asked) < score(_walk(lambda t: 0 * t, 1.3), asked)
  assert score(_walk(lambda t: 0 * t, 1.15, 0.5)[:2], asked) == 2  # hardly a motion
