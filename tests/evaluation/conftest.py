"""What tests of evaluations share: procedural motion as an archive, and evaluators with random weights."""
import pytest

from motion_jax.evaluators.evaluator import fresh_evaluator


@pytest.fixture(scope="session")
def archive(tmp_path_factory):
  from tests.evaluation.test_run import make_clips, write_archive  # a test module: not before pytest has rewritten it
  return write_archive(tmp_path_factory.mktemp("data") / "synthetic", make_clips())


@pytest.fixture(scope="session")
def evaluators():
  return dict(evaluator=fresh_evaluator("t2m"), clip_evaluator=fresh_evaluator("clip"))
