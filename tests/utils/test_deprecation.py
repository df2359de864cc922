"""Former names of parameters warn at the caller's line, and are gone in the version that their warning names."""
import re
import warnings

import numpy as np
import pytest

import motion_jax
from motion_jax.metrics import scores
from motion_jax.utils.deprecation import renamed_parameters
from tests.conftest import ROOT


@renamed_parameters(removed_in="9.1", made="generated")
def double(generated, factor=2):
  """Twice a number."""
  return generated * factor


def test_a_former_name_works_and_warns_once_at_the_callers_line():
  with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("default")
    results = [double(made=value) for value in (1, 2, 3)]
  assert results == [2, 4, 6] and len(caught) == 1
  assert caught[0].category is DeprecationWarning and caught[0].filename == __file__
  assert str(caught[0].message) == ("the parameter made of double is now generated; version 9.1 no longer takes made")


def test_other_calls_are_as_they_were():
  with warnings.catch_warnings(action="error"):
    assert double(3) == double(generated=3) == double(3, factor=2) == 6
  assert double.__name__ == "double" and double.__doc__ == "Twice a number."
  with pytest.raises(TypeError, match="got generated and made, its former name; pass generated alone"):
    double(made=1, generated=1)
  with pytest.raises(TypeError, match="others"):
    double(others=1)


def test_parameters_of_metrics_that_0_2_renamed():
  a, b = np.random.default_rng(0).normal(size=(2, 12, 3))
  with pytest.warns(DeprecationWarning, match="made of fid is now generated"):
    assert scores.fid(a, made=b) == scores.fid(a, b)
  column = np.arange(12)[::-1].copy()
  with pytest.warns(DeprecationWarning, match="own of hits is now column"):
    assert (scores.hits(a @ b.T, own=column) == scores.hits(a @ b.T, column=column)).all()


def test_no_former_name_outlives_its_version():
  number = lambda version: tuple(map(int, version.split(".")))[:2]
  names = [(path.name, version) for path in sorted((ROOT / "motion_jax").rglob("*.py"))
           for version in re.findall(r'removed_in="([\d.]+)"', path.read_text(encoding="utf-8"))]
  assert len(names) > 5
  overdue = [place for place, version in names if number(version) <= number(motion_jax.__version__)]
  assert not overdue, f"remove the former names, whose last version is over: {overdue}"
