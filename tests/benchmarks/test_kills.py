"""Trainings that are killed end with the bytes of one that was left alone (benchmarks/kills.py, in its small form)."""
import json
import os

import pytest

from benchmarks import kills
from motion_jax.utils import config_files
from tests import processes
from tests.conftest import ROOT, devices_env, some_of

STAGES = [name for name in config_files.names() if "/" not in name]


def _run(count, stage, folder):
  done = processes.run([ROOT / "benchmarks" / "kills.py", count, "--stage", stage, "--out", folder], devices_env(1))
  assert done.returncode == 0, done.stdout + done.stderr
  return done.stdout


@pytest.mark.slow
def test_a_training_that_is_killed_ends_as_if_it_had_not_been(tmp_path):
  count = 8
  printed = _run(count, "line", tmp_path)
  assert f"| in all | {count} |" in printed and "equal bytes | 0" not in printed
  # It goes on with what is on record.
  assert f"| in all | {count + 1} |" in _run(count + 1, "line", tmp_path)
  rows = kills._lines(tmp_path / "line" / "kills.jsonl")
  assert sum('"point"' in row for row in rows) == count + 1


@pytest.mark.parametrize("stage", some_of(STAGES, slow=("cmdm_denoiser", "cdamd_rvq", "cdamd_length")))
def test_every_stage_that_is_killed_ends_as_if_it_had_not_been(tmp_path, stage):
  assert "| in all | 1 |" in _run(1, stage, tmp_path)


def test_an_end_that_differs_is_found(tmp_path, monkeypatch):
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
  assert os.path.isdir(tmp_path / "trial-0")  # to be looked at
