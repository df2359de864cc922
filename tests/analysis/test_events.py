"""Events of procedural motions: found where they are, and nowhere else; the same in any place and direction."""
import numpy as np
import pytest

from motion_jax.analysis.events import Event, find_events
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import mirror
from motion_jax.motion.retiming import resample

FPS = 20.0


def joints_of(action, frames=120, seed=0):
  return synthetic_joints(action, frames, np.random.default_rng(seed))


def kinds(joints, fps=FPS):
  return [event.kind for event in find_events(joints, fps)]


@pytest.mark.parametrize("action, kind", [("walk", "walk"), ("run", "run"), ("turn_left", "turn"), ("squat", "squat"),
                                          ("jump", "jump"), ("wave_left", "wave"), ("stand", "still")])
def test_each_action_is_found(action, kind):
  found = find_events(joints_of(action, 60 if action == "squat" else 120))
  assert kind in [event.kind for event in found]
  assert all(0 <= event.start < event.end <= 6 for event in found)
  assert found == sorted(found, key=lambda event: (event.start, event.end, event.kind, event.side))


@pytest.mark.parametrize("kind", ["walk", "run", "jump", "squat", "kick", "punch", "wave", "turn"])
def test_a_standing_body_does_nothing_else(kind):
  assert kind not in kinds(joints_of("stand"))


def test_a_walk_tells_its_way_its_pace_and_its_path():
  walk = next(event for event in find_events(joints_of("walk")) if event.kind == "walk")
  assert (walk.way, walk.path) == ("forward", "straight") and 0.7 < walk.amount < 1.75
  backward = next(event for event in find_events(joints_of("walk")[::-1].copy()) if event.kind in ("walk", "run"))
  assert backward.way == "backward"


def test_a_mirror_changes_sides_only():
  swap = {"left": "right", "right": "left"}
  for action in ("wave_left", "turn_left", "walk"):
    joints = joints_of(action)
    expected = [(event.kind, swap.get(event.side, event.side)) for event in find_events(joints)]
    assert sorted((event.kind, event.side) for event in find_events(mirror(joints))) == sorted(expected)


def test_place_direction_and_rate_do_not_matter():
  joints = joints_of("walk")
  moved = rot.rotate(rot.about_axis(np.array(2.0), "y"), joints) + [3, 0, -4]
  assert kinds(moved) == kinds(joints)
  assert kinds(resample(joints, FPS, 30.0), 30.0) == kinds(joints)


def test_less_than_half_a_second_has_none():
  assert find_events(joints_of("walk")[:9]) == [] and find_events(np.zeros((0, 22, 3))) == []
  assert Event("walk", 0.0, 1.0) == ("walk", 0.0, 1.0, "", 0, 0.0, "", "")
