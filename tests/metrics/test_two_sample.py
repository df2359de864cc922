"""The two-sample test: chance for equal samples, certain for trembling ones, and it names what sets them apart."""
import functools

import numpy as np
import pytest

from motion_jax.metrics import two_sample
from motion_jax.motion import rotations
from tests.analysis.test_describe import _walk


@functools.cache
def _walks(seed, tremble=0.0, stiff=False, count=20):
  """Windows of walks of 4 s; tremble: of the left wrist, stiff: the left collar hangs on the spine."""
  rng = np.random.default_rng(seed)
  made = []
  for _ in range(count):
    joints = _walk(float(rng.uniform(-60, 60)), speed=float(rng.uniform(0.6, 1.4)), seconds=4.0)
    joints = joints + 0.01 * rng.standard_normal((1, *joints.shape[1:]))
    joints = joints + 0.002 * np.cumsum(rng.standard_normal((len(joints), 22, 3)), 0)
    joints[:, 20] += tremble * rng.standard_normal((len(joints), 3))
    made.append(np.where(np.arange(22)[:, None] == 13, joints[:, [9]] + [0.08, 0.12, 0.0], joints) if stiff else joints)
  return two_sample.describe(made)


def _first(windows, count):
  return windows.of(np.flatnonzero(windows.clip < count))


@pytest.mark.slow
def test_equal_samples_are_set_apart_by_chance_alone():
  found = two_sample.compare(_walks(0), _walks(1))
  assert set(found) == set(two_sample.KINDS)
  assert all(0.3 < verdict.auc < 0.7 for verdict in found.values())
  assert all(0.3 < value < 0.7 for value in two_sample.halves(_walks(0), draws=2).values())


@pytest.mark.slow
def test_faults_are_found_and_named():
  verdicts = two_sample.compare(_walks(0), _walks(1, tremble=0.03, stiff=True))
  for kind, joint, least in (("jerk", "left_wrist", 0.98), ("dynamics", "left_wrist", 0.98),
                             ("limbs", "left_collar", 0.7)):
    assert verdicts[kind].auc > least
    assert any(joint in name and abs(auc - 0.5) > 0.35 for name, auc in verdicts[kind].reasons)
  assert verdicts["jerk"].reasons[0][1] > 0.5  # there is more of it


def test_a_motion_that_is_no_motion_is_refused():
  """One NaN in the standardized numbers made bad motion hard to tell from real."""
  motions = np.zeros((3, 60, 22, 3))
  motions[1, 5, 3] = np.nan
  with pytest.raises(ValueError, match="motion 1 holds NaN"):
    two_sample.describe(list(motions))


def test_few_or_short_clips_give_no_verdict():
  some = _walks(1)
  assert two_sample.compare(_walks(0), _first(some, 9)) == two_sample.halves(_first(some, 19)) == {}
  assert set(two_sample.compare(_first(some, 10), _first(some, 10))) == set(two_sample.KINDS)
  walk = _walk(0.0, speed=1, seconds=4.0)
  assert two_sample.describe([walk[:count] for count in (39, 40, 59, 60)]).clip.tolist() == [1, 2, 3, 3]


def test_poses_are_seen_from_the_body():
  """Whichever way it faces, and however high or far it is."""
  joints = _walk(0.0, speed=1, seconds=2)[:40]
  joints = joints + np.cumsum(0.02 * np.random.default_rng(0).standard_normal(joints.shape), 0)
  turned = rotations.rotate(rotations.about_axis(np.full((40, 1), 2.0), "y"), joints) + [3, 1, 2]
  seen, again = two_sample.describe([joints]), two_sample.describe([turned])
  for kind, numbers in seen.numbers.items():
    np.testing.assert_allclose(again.numbers[kind], numbers, atol=1e-9, err_msg=kind)


def test_area_is_the_share_of_pairs_in_order():
  score, label = np.array([0.1, 0.4, 0.4, 0.9, 0.2]), np.array([0, 0, 1, 1, 1])
  pairs = [(a > b) + 0.5 * (a == b) for a in score[label == 1] for b in score[label == 0]]
  assert two_sample.area(score, label) == pytest.approx(np.mean(pairs))
