"""Tables of times are the reference's, number for number."""
import pytest

from motion_jax.diffusion.schedules import staircase, staircase_levels
from tests import fixtures
from tests.golden import check, golden


@golden("schedules", bounds={"k/": (0, 0), "t/": (1.2e-7, 1.2e-7)})
def run_schedules(fixture, dtype):
  made = {}
  for name, (num_steps, lag, length, block) in fixture.under("in/case/").items():
    made[f"k/{name}"] = num_steps - staircase_levels(num_steps, length, lag, block)
    made[f"t/{name}"] = staircase(num_steps, length, lag, block)
  return made


def test_golden():
  assert not check(fixtures.path("cmdm/schedules.npz")).failures


def test_a_table_written_out():
  """4 blocks, K = 50, L = 2: 57 rows; row 7 and the last three (docs/papers/cmdm.md#fss)."""
  k = 50 - staircase_levels(50, 4, 2)
  assert len(k) == 57
  assert k[7].tolist() == [43, 45, 47, 49]
  assert k[-3:].tolist() == [[0, 0, 0, 2], [0, 0, 0, 1], [0, 0, 0, 0]]


@pytest.mark.parametrize("length, block, lag, evaluations", [
    (30, 3, 2, 68), (48, 1, 2, 144), (30, 1, 50, 1500), (48, 3, 50, 800), (30, 3, 0, 50)])
def test_evaluations(length, block, lag, evaluations):
  """Table of docs/papers/cmdm.md#fss; lag 50 is autoregressive, lag 0 all at once."""
  assert len(staircase(50, length, lag, block)) - 1 == evaluations


def test_bad_numbers_are_refused():
  for bad in (dict(num_steps=0), dict(length=0), dict(lag=-1), dict(block=0)):
    with pytest.raises(ValueError, match="expected positive"):
      staircase_levels(**(dict(num_steps=5, length=4, lag=2, block=1) | bad))
