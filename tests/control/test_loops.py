"""A cycle is found where a motion meets itself, and its seam is no rougher than its inside; two motions become one."""
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from motion_jax.control.finishing import blend, cycle
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.pinned_feet import stands
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax.utils.errors import InputError
from tests.motion.test_looping import own


@pytest.fixture(scope="module")
def walk():
  return synthetic_joints("walk", 110, np.random.default_rng(0)).astype(np.float64)


def jerk(joints):
  """Of each step of a motion played over and over (its last frame is its first): mean over the joints, m/s^3."""
  body = own(joints)[:-1]
  around = np.concatenate([body, body, body])
  return np.linalg.norm(np.diff(around, n=3, axis=0), axis=-1).mean(1) * 20 ** 3


@pytest.mark.parametrize("count", [47, 80])
def test_the_seam_is_as_smooth_as_the_inside(walk, count):
  made = cycle(walk, count).astype(np.float64)
  assert made.shape == (count, 22, 3)
  found, round_ = jerk(made), count - 1
  seam = found[round_ - 4:round_ + 2].max()
  inside = found[round_ + 6:2 * round_ - 6].max()
  assert seam <= inside
  assert np.abs(bone_lengths(made, HUMANML3D) - HUMANML3D.bone_lengths).max() < 1e-4


def test_of_cycles_that_meet_well_that_with_the_smoothest_seam_is_taken():
  """Of this motion, which shivers, that which meets best is rougher at its seam than inside: 1.1 times."""
  rng = np.random.default_rng(2)
  joints = synthetic_joints("squat", 110, rng).astype(np.float64)
  shiver = gaussian_filter1d(rng.normal(size=joints.shape), 1.5, axis=0)
  roughness = jerk(cycle(with_lengths(joints + 0.01 * shiver / shiver.std(), HUMANML3D), 60).astype(np.float64))
  assert roughness[55:61].max() < 0.8 * roughness[65:112].max()


def test_a_loop_of_nothing(walk):
  with pytest.raises(InputError, match="loop of 60"):
    cycle(walk[:40], 60)


def test_one_motion_becomes_another(walk):
  turn = np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]])
  other = synthetic_joints("walk", 60, np.random.default_rng(1)).astype(np.float64) @ turn.T + [7, 0, -3]
  made, border = blend(walk[:60], other, 1.0)
  assert np.abs(made[:border] - walk[:border]).max() < 1e-5 and 45 < border <= 57 and len(made) > border + 40
  step = lambda x: np.linalg.norm(np.diff(x, axis=0), axis=-1).max()
  assert step(made) < 1.3 * max(step(walk), step(other))
  feet, flags = list(HUMANML3D.left_feet + HUMANML3D.right_feet), np.repeat(stands(made), 2, axis=1)
  slides = np.linalg.norm(np.diff(made[:, feet], axis=0)[..., [0, 2]], axis=-1)[flags[1:] & flags[:-1]]
  assert slides.max() < 0.02
  for wrong in (0, 60):
    with pytest.raises(InputError, match="seconds"):
      blend(walk, walk, wrong)
  with pytest.raises(InputError, match="8 or more"):
    blend(walk[:5], walk)
