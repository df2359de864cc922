"""A straight walk on another path: the rules find the path, and feet stand where they stood."""
import numpy as np
import pytest

from motion_jax.analysis.events import find_events
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.root_paths import bent, course
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths

FEET = [*HUMANML3D.left_feet, *HUMANML3D.right_feet]
WALK = synthetic_joints("walk", 160, np.random.default_rng(3))
WAY = course(WALK)[1][-1]


def _slide(joints, stands):
  steps = np.linalg.norm(np.diff(joints[:, FEET][..., [0, 2]], axis=0), axis=-1) * 20
  return steps[stands[1:] & stands[:-1]].mean()


def test_a_course_is_as_long_as_the_way():
  straight = np.linalg.norm((WALK[-1, 0] - WALK[0, 0])[[0, 2]])
  assert WAY == pytest.approx(straight, rel=0.02)
  even = np.zeros((60, 22, 3))
  even[:, 0, 2] = 0.06 * np.arange(60)
  np.testing.assert_allclose(np.diff(course(even)[1]), 0.06, atol=1e-9)  # no slower at its ends


@pytest.mark.parametrize("path, total", [("circle", 2 * np.pi), ("u-turn", np.pi), ("curve", 2.2)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_walk_is_bent(path, total, sign):
  made = bent(WALK, lambda gone: sign * total * gone / WAY)
  found = find_events(made)
  assert [event.path for event in found if event.kind == "walk"] == [path]
  assert {event.side for event in found if event.kind == "turn"} == {"left" if sign > 0 else "right"}
  stands = feet_stand(WALK)
  assert _slide(made, stands) < 1.3 * _slide(WALK, stands) + 0.005
  np.testing.assert_allclose(bone_lengths(made, HUMANML3D), bone_lengths(WALK, HUMANML3D), atol=2e-3)


def test_no_turn_changes_nothing_and_a_quick_one_leans():
  np.testing.assert_allclose(bent(WALK, lambda gone: 0 * gone), WALK, atol=1e-4)
  turned = bent(WALK, lambda gone: 2 * np.pi * gone / WAY)
  trunk = (turned[:, 12] - turned[:, 0])[60:100]
  ahead = np.gradient(turned[:, 0], axis=0)[60:100]
  left = np.stack([ahead[:, 2], -ahead[:, 0]], -1)
  assert ((trunk[:, [0, 2]] * left).sum(-1) > 0).mean() > 0.9  # into the curve
