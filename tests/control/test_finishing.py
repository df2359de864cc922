"""Which parts of the body come from which of two motions."""
import dataclasses

import numpy as np
import pytest

from motion_jax.control.constraints import KeepParts
from motion_jax.control.finishing import with_parts
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths

LEGS, WAIST = (0, 1, 2, 4, 5, 7, 8, 10, 11), 3
NECK = 12


def standing(tilt):
  """Joints (30, 22, 3) of a body that stands, its trunk, head and arms tilted forward by an angle in degrees."""
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


@pytest.mark.parametrize("parts", [("legs",), ("torso",), ("left_arm",), ("legs", "torso"), ("torso", "left_arm")],
                         ids="+".join)
def test_the_trunk_is_that_of_the_motion_whose_torso_it_is(parts):
  given, made = standing(40), standing(0)
  found = with_parts(made, KeepParts(given, parts))
  assert tilt_of(found) == pytest.approx(tilt_of(given if "torso" in parts else made), abs=5)


@pytest.mark.parametrize("parts", [("legs", "torso"), ("torso", "left_arm")], ids="+".join)
def test_other_parts_come_onto_the_bones_of_the_kept_body(parts):
  """A source of 8 % longer bones keeps them in all parts, and its frames outside of the spans to the bit."""
  given, made = standing(0), standing(30)
  made[:, [19, 21]] += [0, 0.4, 0.3]  # the right arm is raised
  given = with_lengths(given, dataclasses.replace(HUMANML3D, bone_lengths=1.08 * HUMANML3D.bone_lengths)) + [2, 0, 1]
  found = with_parts(made, KeepParts(given, parts, spans=[[0.5, 1.0]]))
  lengths, own = (bone_lengths(x, HUMANML3D)[:, 1:] for x in (found.astype(np.float64), given))
  assert np.abs(lengths / own - 1).max() < 0.01
  np.testing.assert_allclose(found[np.r_[:10, 20:30]], given[np.r_[:10, 20:30]], atol=1e-3)
  assert np.abs(found[15] - given[15]).max() > 0.02
