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


def test_bad_numbers_are_refused():
  for bad in (dict(num_steps=0), dict(length=0), dict(lag=-1), dict(block=0)):
    with pytest.raises(ValueError, match="expected positive"):
      staircase_levels(**(dict(num_steps=5, length=4, lag=2, block=1) | bad))
