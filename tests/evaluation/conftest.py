"""What tests of evaluations share: procedural motion as an archive, models and evaluators with random weights."""
import pytest

from motion_jax.evaluators.evaluator import fresh_evaluator
from tests import processes
from tests.conftest import devices_env
from tests.evaluation import small


@pytest.fixture(scope="session")
def archive(tmp_path_factory):
  return small.write_archive(tmp_path_factory.mktemp("data") / "synthetic", small.make_clips())


@pytest.fixture(scope="session")
def evaluator():
  return fresh_evaluator("t2m")


@pytest.fixture(scope="session")
def evaluators(evaluator):
  return dict(evaluator=evaluator, clip_evaluator=fresh_evaluator("clip"))


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory):
  """As in tests/conftest.py, but with random weights: an evaluation is the same, and nothing trains."""
  return small.random_run(tmp_path_factory.mktemp("runs") / "denoiser", "cmdm_denoiser")


@pytest.fixture(scope="session")
def tiny_generator(tmp_path_factory):
  return small.random_run(tmp_path_factory.mktemp("runs") / "generator", "cdamd_generator",
                          num_iterations=3, num_steps=1, solver="euler")


@pytest.fixture(scope="session")
def forks():
  """The process that `tests.processes` forks is up, which takes seconds of no test in particular."""
  processes.run(["-c", "pass"], devices_env(1))
