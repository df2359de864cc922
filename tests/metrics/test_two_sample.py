"""The two-sample test: chance for equal samples, certain for trembling ones, and it names what sets them apart."""
import numpy as np
import pytest

from motion_jax.metrics import two_sample
from tests.analysis.test_describe import _walk


def _walks(count, seed, tremble=0.0, stiff=False):
  rng = np.random.default_rng(seed)
  made = []
  for _ in range(count):
    joints = _walk(float(rng.uniform(-60, 60)), speed=float(rng.uniform(0.6, 1.4)), seconds=6.0)
    joints = joints + 0.01 * rng.standard_normal((1, *joints.shape[1:]))
    joints = joints + 0.002 * np.cumsum(rng.standard_normal((len(joints), 22, 3)), 0)
    joints[:, 20] += tremble * rng.standard_normal((len(joints), 3))
    made.append(np.where(np.arange(22)[:, None] == 13, joints[:, [9]] + [0.08, 0.12, 0.0], joints) if stiff else joints)
  return two_sample.describe(made)


def test_equal_samples_are_set_apart_by_chance_alone():
  real = _walks(24, 0)
  found = two_sample.compare(real, _walks(24, 1))
  assert set(found) == set(two_sample.KINDS)
  assert all(0.3 < verdict.auc < 0.7 for verdict in found.values())
  assert all(0.3 < value < 0.7 for value in two_sample.halves(real).values())


@pytest.mark.parametrize("fault, kind, joint, least", [
    (dict(tremble=0.03), "jerk", "left_wrist", 0.98), (dict(tremble=0.03), "dynamics", "left_wrist", 0.98),
    (dict(stiff=True), "limbs", "left_collar", 0.7)])
def test_a_fault_is_found_and_named(fault, kind, joint, least):
  verdict = two_sample.compare(_walks(24, 0), _walks(24, 1, **fault))[kind]
  assert verdict.auc > least
  assert joint in verdict.reasons[0][0] and abs(verdict.reasons[0][1] - 0.5) > 0.4


def test_few_or_short_clips_give_no_verdict():
  assert two_sample.compare(_walks(24, 0), _walks(9, 1)) == two_sample.halves(_walks(12, 0)) == {}
  assert len(two_sample.describe([np.zeros((39, 22, 3))]).clip) == 0


def test_area_is_the_share_of_pairs_in_order():
  score, label = np.array([0.1, 0.4, 0.4, 0.9, 0.2]), np.array([0, 0, 1, 1, 1])
  pairs = [(a > b) + 0.5 * (a == b) for a in score[label == 1] for b in score[label == 0]]
  assert two_sample.area(score, label) == pytest.approx(np.mean(pairs))
  assert two_sample.area(score, np.ones(5)) == 0.5
