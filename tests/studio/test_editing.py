"""Edits whose new frames have to travel: the legs of the source carry an action of the arms; others are reported."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.models.results import Motion
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax_studio import editing
from motion_jax_studio.language import parse

FPS, FRAMES = 20.0, 120
LEGS = [1, 2, 4, 5, 7, 8, 10, 11]


@pytest.fixture(scope="module")
def walk():
  return np.asarray(synthetic_joints("walk", FRAMES, np.random.default_rng(0)), np.float32)


@pytest.fixture(scope="module")
def gliding(walk):
  """New frames 30..90 of a body that waves in one pose of the legs while it moves from one kept part to the other."""
  wave = np.asarray(synthetic_joints("wave_right", FRAMES, np.random.default_rng(0)), np.float64)
  wave = wave - wave[:, :1] * [1, 0, 1] + walk[:, :1] * [1, 0, 1]
  joints = walk.copy()
  joints[30:90] = wave[30:90]
  return Motion(joints, FPS, skeleton=HUMANML3D, meta=dict(made=[[30, 90]], prompt="a person waves"))


def test_actions_that_leave_the_legs_free():
  for prompt, upper in (("a person waves", True), ("someone nods while waving", True), ("he raises both hands", True),
                        ("a person jumps", False), ("a person walks forward while waving", False),
                        ("a person dances", False)):
    assert editing.moves_upper_body(parse(prompt)) == upper, prompt


def test_a_wave_in_the_middle_of_a_walk_is_a_walk_that_waves(walk, gliding):
  made = editing.on_own_legs(gliding, walk, lambda joints: None)
  assert editing.sliding(gliding) > 0.3 and editing.sliding(made) == 0
  np.testing.assert_allclose(made.joints[:, LEGS], walk[:, LEGS], atol=1e-4)
  for kept in (slice(0, 30), slice(90, None)):
    np.testing.assert_allclose(made.joints[kept], walk[kept], atol=1e-4)
  assert made.joints[50:70, 21, 1].max() > walk[50:70, 21, 1].max() + 0.3  # the right hand is up
  lengths = bone_lengths(made.joints, HUMANML3D)
  assert np.ptp(lengths, axis=0).max() < 1e-4


def test_a_body_that_glides_is_reported(gliding, walk):
  reports = editing.gliding_reports(gliding, [], True)
  assert len(reports) == 1 and reports[0].startswith("the feet slide, for the kept frames are ")
  assert editing.gliding_reports(gliding.replace(joints=walk), [], True) == []
  assert editing.gliding_reports(gliding, parse("a person runs").requirements, True) == []  # whose feet slide
