"""Which parts of the body come from which of two motions."""
import numpy as np
import pytest

from motion_jax.control.constraints import PARTS, KeepParts
from motion_jax.control.finishing import with_parts
from motion_jax.data.datasets.synthetic import synthetic_clips

LEGS, WAIST = (0, 1, 2, 4, 5, 7, 8, 10, 11), 3
NECK = 12


def standing(tilt):
  """Joints (30, 22, 3) of a body that stands still with its trunk, head and arms tilted forward by so many degrees."""
  joints = np.repeat(np.asarray(synthetic_clips(0, 1, num_frames=30)[0].joints[:1], np.float64), 30, axis=0)
  upper = [joint for joint in range(22) if joint not in (*LEGS, WAIST)]
  cos, sin = np.cos(np.radians(tilt)), np.sin(np.radians(tilt))
  turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
  pivot = joints[:, [WAIST]]
  joints[:, upper] = (joints[:, upper] - pivot) @ turn.T + pivot
  return joints


def tilt_of(joints):
  way = (joints[:, NECK] - joints[:, WAIST]).mean(0)
  return np.degrees(np.arctan2(way[2], way[1]))


@pytest.mark.parametrize("parts", [*((part,) for part in PARTS), ("legs", "torso"), ("torso", "left_arm"),
                                   ("legs", "head")], ids="+".join)
def test_the_trunk_is_that_of_the_motion_whose_torso_it_is(parts):
  given, made = standing(40), standing(0)
  found = with_parts(made, KeepParts(given, parts))
  assert tilt_of(found) == pytest.approx(tilt_of(given if "torso" in parts else made), abs=5)
