"""What tests of evaluations share: procedural motion as an archive, and evaluators with random weights."""
import pytest

from motion_jax.evaluators.evaluator import fresh_evaluator
from tests import processes
from tests.conftest import devices_env


@pytest.fixture(scope="session")
def archive(tmp_path_factory):
  from tests.evaluation import small  # a test module: not before pytest has rewritten it
  return small.write_archive(tmp_path_factory.mktemp("data") / "synthetic", small.make_clips())


@pytest.fixture(scope="session")
def evaluator():
  return fresh_evaluator("t2m")


@pytest.fixture(scope="session")
def evaluators(evaluator):
  return dict(evaluator=evaluator, clip_evaluator=fresh_evaluator("clip"))


@pytest.fixture(scope="session")
def forks():
  """The process that `tests.processes` forks is up, which takes seconds of no test in particular."""
  processes.run(["-c", "pass"], devices_env(1))
