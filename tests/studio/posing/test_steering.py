"""Walks one after the other lead to the side that is said, with standing feet that stand."""
import numpy as np
import pytest

from motion_jax.data.clip import Caption
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.metrics.physics import planted_speed
from motion_jax.models.results import Motion
from motion_jax.motion.retarget import retarget
from motion_jax_studio.language import parse
from motion_jax_studio.posing.steering import with_steering

WALK = retarget(synthetic_joints("walk", 160, np.random.default_rng(1)))


def _motion(joints=WALK, parts=2):
  ends = np.linspace(0, len(joints) / 20, parts + 1)
  return Motion(joints.astype(np.float32), 20.0, tuple(Caption("", *one) for one in zip(ends, ends[1:])))


def _ways(joints, parts=2):
  """Degrees to the left of where the body faced in which each part leads."""
  ends = np.linspace(0, len(joints) - 1, parts + 1).astype(int)
  steps = np.diff(joints[ends, 0][:, [0, 2]], axis=0)
  return np.degrees(np.arctan2(steps[:, 0], steps[:, 1]))


@pytest.mark.parametrize("text, first, second", [
    ("a person walks forward, then walks to the left", 0, 75), ("a person walks forward, then walks right", 0, -75),
    ("a person walks to the right and then walks to the right again", -75, -150)])
def test_walks_lead_to_their_side(text, first, second):
  made = with_steering(_motion(), parse(text, lambda text: False))
  assert _ways(made) == pytest.approx([first, second], abs=20)
  assert planted_speed(made) < planted_speed(WALK) + 0.05
  there = _motion(made)
  assert with_steering(there, parse(text, lambda text: False)) is there.joints


def test_other_plans_stay_as_they_are():
  motion, stands = _motion(), _motion(np.repeat(WALK[:1], 160, axis=0))
  for text in ("a person walks forward, then jogs", "a person walks forward, then bows",
               "a person walks to the left, then bows", "a person walks, then kicks to the left",
               "a person walks forward, then takes side steps to the left",
               "a person walks, then walks in a circle to the left"):
    assert with_steering(motion, parse(text, lambda text: False)) is motion.joints, text
  assert with_steering(stands, parse("a person walks, then walks to the left", lambda text: False)) is stands.joints


def test_a_walk_backward_goes_to_the_side_of_the_body():
  backward = WALK[::-1].copy()
  text = "a person walks backward to the left, then walks backward to the right"
  made = with_steering(_motion(backward), parse(text, lambda text: False))
  way = made[79, 0] - made[0, 0]
  assert way[0] > 1 and way[2] < -0.2  # the body faces +z, its left is +x
