"""Which of the many parameters of a test run always, in CI, and before a release."""
import pytest

from tests.conftest import some_of


def test_parameters_are_quick_slow_or_exhaustive():
  made = some_of(["a", "b", ("c", 1)], quick=["a"], slow=["b"])
  assert [one.values for one in made] == [("a",), ("b",), ("c", 1)]
  assert [[mark.name for mark in one.marks] for one in made] == [[], ["slow"], ["exhaustive"]]
  with pytest.raises(ValueError, match=r"\['d'\] are no parameters"):
    some_of(["a", "b"], slow=["d"])
