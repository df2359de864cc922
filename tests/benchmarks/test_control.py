"""The control benchmark asks for what a pipeline and its model have."""
import inspect
import sys

import motion_jax
from motion_studio import Pipeline
from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
import control  # noqa: E402


def test_the_ways_to_apply_constraints_exist():
  model = motion_jax.load("cmdm-small")
  known = {*inspect.signature(Pipeline.__call__).parameters, *model.options.described(), *model.more_choices}
  assert {name for options in control.WAYS.values() for name in options or {}} <= known
