"""Trainings that are killed end with the bytes of one that was left alone (benchmarks/kills.py, in its small form)."""
import json

import pytest

from benchmarks import kills
from motion_jax.utils import config_files
from tests import processes
from tests.conftest import ROOT, devices_env

STAGES = [name for name in config_files.names() if "/" not in name]


@pytest.mark.parametrize("stage, count", [
    pytest.param("line", 6, marks=pytest.mark.slow),
    *(pytest.param(stage, 1, marks=pytest.mark.exhaustive) for stage in STAGES)])
def test_a_training_that_is_killed_ends_as_if_it_had_not_been(tmp_path, stage, count):
  """The line has a rollback, skipped steps, an average and a best state."""
  done = processes.run([ROOT / "benchmarks" / "kills.py", count, "--stage", stage, "--out", tmp_path], devices_env(1))
  assert done.returncode == 0, done.stdout + done.stderr
  assert f"| in all | {count} |" in done.stdout and "equal bytes | 0" not in done.stdout


def test_an_end_that_differs_is_noticed(tmp_path, monkeypatch):
  """The comparison itself: a changed end of the training that was left alone."""
  calls = []

  def child(stage, folder, point, after):
    folder.mkdir(parents=True, exist_ok=True)
    calls.append(point)
    (folder / "passed.json").write_text(json.dumps(kills.POINTS))
    (folder / "end.json").write_text("one" if folder.name == "whole" else "another")
    return -9 if point else 0

  monkeypatch.setattr(kills, "_child", child)
  assert kills.run(3, "line", tmp_path) == 1 and len(calls) == 2 + 3 + 1
  assert (tmp_path / "trial-0").is_dir()  # to be looked at
