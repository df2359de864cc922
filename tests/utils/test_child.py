"""A module in a process of its own: with our code, without the current folder's, within its memory."""
import os
import subprocess

import pytest

from motion_jax.utils import child


@pytest.mark.slow
def test_a_child_runs_nothing_of_the_current_folder(tmp_path, monkeypatch):
  for name in ("numpy", "struct", "runpy"):
    (tmp_path / f"{name}.py").write_text("open('RAN', 'w')\n")
  (tmp_path / "walk.fbx").write_bytes(b"Kaydara FBX Binary")
  monkeypatch.chdir(tmp_path)
  monkeypatch.setenv("PYTHONPATH", os.pathsep.join([".", ""]))
  done = child.run("motion_jax.data.mocap.fbx_child", tmp_path / "walk.fbx", tmp_path / "out.npz", seconds=60)
  assert done.returncode and not (tmp_path / "RAN").exists(), done.stderr


def test_a_child_is_limited_in_memory_and_time(tmp_path, monkeypatch):
  # The standard library has modules that take an amount of work.
  small = child.run("base64", "-t", seconds=60, memory=1e9)
  assert small.returncode == 0, small.stderr
  assert child.run("base64", "-t", seconds=60, memory=2e6).returncode != 0
  with pytest.raises(subprocess.TimeoutExpired):
    child.run("timeit", "-n", "1", "import time; time.sleep(60)", seconds=0.5)
