"""Signals of bodies whose answer is known: speed, heading, angles, height, runs of flags."""
import numpy as np
import pytest

from motion_jax.analysis.signals import JOINT, PAIR, Body, course_of, turning_points
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion import rotations as rot

FPS = 20.0


def body_of(action, frames=80, seed=0):
  return Body(synthetic_joints(action, frames, np.random.default_rng(seed)), FPS)


def test_a_standing_body_rests_upright_with_both_feet_down():
  body = body_of("stand")
  assert body.stands.all() and body.speed.max() < 0.05 and np.abs(body.heading).max() < 0.05
  assert body.trunk.max() < 10 and (body.knees > 150).all()
  assert body.air.min() == pytest.approx(0, abs=0.02)
  np.testing.assert_allclose(body.pelvis, body.joints[:, 0, 1] - body.floor)


def test_speed_heading_and_local_axes_turn_with_the_body():
  walk = body_of("walk")
  turned = Body(rot.rotate(rot.about_axis(np.array(np.pi / 2), "y"), walk.joints), FPS)  # +z becomes +x
  np.testing.assert_allclose(turned.speed, walk.speed, atol=1e-9)
  np.testing.assert_allclose(turned.heading - walk.heading, np.pi / 2, atol=1e-6)
  np.testing.assert_allclose(turned.local("wrist", "shoulder"), walk.local("wrist", "shoulder"), atol=1e-6)
  middle = slice(30, 50)
  assert np.allclose(np.median(walk.speed[middle]), np.linalg.norm(np.diff(walk.path[middle], axis=0), axis=-1).mean()
                     * FPS, rtol=0.1)


def test_a_bent_limb_has_its_angle():
  joints = np.repeat(body_of("stand").joints[:1], 12, axis=0)
  hip, knee, ankle = (joints[:, PAIR[part][0]] for part in ("hip", "knee", "ankle"))
  joints[:, JOINT["left_ankle"]] = knee + np.array([0, 0, 1.0]) * np.linalg.norm(ankle - knee, axis=-1, keepdims=True)
  joints[:, JOINT["left_knee"]] = hip - [0, 0.4, 0]
  joints[:, JOINT["left_ankle"]] = joints[:, JOINT["left_knee"]] + [0, 0, 0.4]
  np.testing.assert_allclose(Body(joints, FPS).knees[:, 0], 90, atol=1e-6)


def test_runs_are_joined_over_gaps_and_short_ones_left_out():
  body = body_of("stand", 40)
  flags = np.zeros(40, bool)
  flags[[2, 3, 4, 6, 7]], flags[20] = True, True
  assert body.spans(flags) == [(2, 5), (6, 8), (20, 21)]
  assert body.spans(flags, gap=0.05) == [(2, 8), (20, 21)]
  assert body.spans(flags, least=0.25, gap=0.05) == [(2, 8)]
  assert body.spans(np.zeros(40, bool)) == []


def test_course_and_turning_points():
  angle = np.linspace(0, 2 * np.pi, 60)
  circle = np.stack([1 - np.cos(angle), np.sin(angle)], -1)  # starts along +z, turns to +x: to the left
  course = course_of(circle)
  assert np.all(np.diff(course[1:-1]) > 0) and course[-1] - course[0] == pytest.approx(360, abs=8)
  wave = np.array([0, 1, 2, 3, 2, 1, 0, 0.1, 0, 2, 4.0])
  assert turning_points(wave, 0.5).tolist() == [0, 3, 8, 10]  # the last of equal points; the ripple of 0.1 is none
  assert turning_points(np.zeros(5), 0.5).tolist() == [0, 4]
