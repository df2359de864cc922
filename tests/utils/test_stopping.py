"""Signals, closed pipes and second launches: nothing half-written, one line, and the status that shells expect; modules
in processes of their own: with our code, without the current folder's, within their memory."""
import fcntl
import os
import pathlib
import signal
import socket
import subprocess
import sys
import time

import pytest

from motion_jax import fit
from motion_jax.data.mocap import child
from motion_jax.training import lock
from motion_jax.training import loop as train
from motion_jax.training.saver import Saver
from motion_jax.utils import atomic, stopping
from motion_jax.utils.atomic import atomic_folder, atomic_path
from tests import processes
from tests.conftest import ROOT, devices_env, load_config
from tests.training.test_train import _config, _equal, _next_batch, _stage, before_each_step

_HALF = """
import os, pathlib, signal, sys
from motion_jax.utils import stopping
from motion_jax.utils.atomic import atomic_folder, atomic_path
folder = pathlib.Path(sys.argv[1])
with stopping.at_once("program"), atomic_path(folder / "a.gif") as file, atomic_folder(folder / "data") as data:
  file.write_text("half")
  (data / "b.npy").write_text("half")
  try:
    os.kill(os.getpid(), int(sys.argv[2]))
  except BaseException:
    pass  # code of others that swallows everything must not keep the program alive
  print("still there")
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_nothing_half_written(tmp_path, forks, number):
  (tmp_path / "data").mkdir()
  (tmp_path / "data" / "old.npy").write_text("old")
  done = processes.run(["-c", _HALF, tmp_path, int(number)], devices_env(1))
  assert done.returncode == 128 + number and done.stdout == ""
  assert done.stderr == "program: stopped; nothing half-written is left\n"
  assert [path.name for path in tmp_path.rglob("*")] == ["data", "old.npy"]


def test_what_killed_writers_left_is_removed_by_the_next(tmp_path):
  """Not what another program writes now, nor what is young, nor what is somebody's."""
  dead = [tmp_path / name for name in (".a-part-abcdefgh.gif", ".a-part-bcdefghi.gif", ".data-part-abcdefgh")]
  kept = [tmp_path / name for name in (".a-original.gif", ".b-part-abcdefgh.gif")]
  dead[2].mkdir()
  for path in (*dead[:2], dead[2] / "half", *kept):
    path.write_text("half")
  for path in (*dead, *kept):
    os.utime(path, (0, 0))
  (tmp_path / ".a-part-young123.gif").touch()
  with open(dead[1]) as other:
    fcntl.flock(other, fcntl.LOCK_EX)
    with atomic_path(tmp_path / "a.gif") as part:
      os.utime(part, (0, 0))
      with atomic_path(tmp_path / "a.gif") as again, atomic_folder(tmp_path / "data"):
        assert part.exists() and part != again
  atomic._parts_at_first.cache_clear()
  assert sorted(path.name for path in tmp_path.iterdir()) == sorted([
      ".a-part-bcdefghi.gif", ".a-part-young123.gif", "a.gif", "data", *(path.name for path in kept)])


def test_a_folder_whose_writer_was_killed_while_it_was_renamed_is_there_again(tmp_path):
  old = tmp_path / ".data-part-abcdefgh-old"
  old.mkdir()
  (old / "old.npy").touch()
  os.utime(old, (0, 0))
  with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "data"):
    raise KeyboardInterrupt
  assert [path.name for path in tmp_path.rglob("*")] == ["data", "old.npy"]


def test_a_folder_that_replaces_another_is_there_at_every_moment(tmp_path, monkeypatch):
  """Stopped between the two renamings, what was there before is there again."""
  (tmp_path / "data").mkdir()
  (tmp_path / "data" / "old.npy").write_text("old")
  replace, calls = pathlib.Path.replace, []

  def stopped(path, target):
    calls.append(path)
    if len(calls) == 2:
      raise KeyboardInterrupt
    return replace(path, target)

  monkeypatch.setattr(pathlib.Path, "replace", stopped)
  with pytest.raises(KeyboardInterrupt), atomic_folder(tmp_path / "data") as folder:
    (folder / "new.npy").write_text("new")
  assert [path.name for path in tmp_path.rglob("*")] == ["data", "old.npy"]
  monkeypatch.setattr(pathlib.Path, "replace", replace)
  with atomic_folder(tmp_path / "data") as folder:
    (folder / "new.npy").write_text("new")
  assert [path.name for path in tmp_path.rglob("*")] == ["data", "new.npy"]
  assert (tmp_path / "data").stat().st_mode & 0o777 == 0o755  # others may read it


def test_handlers_are_given_back_and_ignored_signals_stay_ignored():
  before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
  handlers = lambda: [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
  own = handlers()
  try:
    for taken in (stopping.at_once("program"), stopping.Stop()):
      with taken:
        assert handlers()[2] == signal.SIG_IGN and handlers()[1] != own[1]
      assert handlers() == own
  finally:
    signal.signal(signal.SIGHUP, before)


def test_a_signal_while_jax_is_imported_ends_the_program_with_one_line(tmp_path):
  """Sent by the import itself: an import hook that kills on the first of jax's own modules, and swallows exceptions."""
  arguments = ["train", "--config", "part_tmr:tiny", "--workdir", str(tmp_path / "run")]
  script = f"""
import os, signal, sys
class Hook:
  def find_spec(self, name, path=None, target=None):
    if name.startswith("jax."):
      try:
        os.kill(os.getpid(), signal.SIGTERM)
      except BaseException:
        pass
sys.meta_path.insert(0, Hook())
from motion_jax_studio import cli
sys.exit(cli.main({arguments}))
"""
  done = subprocess.run([sys.executable, "-c", script], env=devices_env(1), capture_output=True, text=True, check=False)
  lines = [line for line in done.stderr.splitlines() if not line.startswith("working: ")]  # of a slow machine
  assert done.returncode == 75 and len(lines) == 1 and lines[0].endswith(": preempted, resumable")


def test_a_reader_that_has_gone_is_no_error():
  read, write = os.pipe()
  os.close(read)
  done = subprocess.run([sys.executable, "-m", "motion_jax_studio.cli", "--help"], env=devices_env(1), stdout=write,
                        stderr=subprocess.PIPE, cwd=ROOT, check=False)
  os.close(write)
  assert done.stderr == b"" and done.returncode in (0, stopping.PIPE_CLOSED)


@pytest.mark.parametrize("number, status", [(signal.SIGTERM, 75), (signal.SIGINT, 130)])
def test_the_status_of_a_training_says_what_stopped_it(tmp_path, monkeypatch, number, status):
  before_each_step(monkeypatch, lambda step: step == 1 and os.kill(os.getpid(), number))
  stop = stopping.Stop()
  assert int(train.train(_config(50), tmp_path, _stage(), _next_batch, stop=stop).step) == 2
  assert stop.raised and stop.status == status
  assert stopping.Stop().status == 0


_BUSY = """
import hashlib, os, signal, sys
from motion_jax.utils import stopping
from motion_jax.training import loop, report
from tests.training.test_train import _config, _next_batch, _stage

def busy(*_):  # as a compiler is: in C, for long, without a look at Python's handlers
  os.kill(os.getpid(), signal.SIGTERM)
  hashlib.pbkdf2_hmac("sha256", b"", b"", 2_000_000_000)

{place} = busy
with stopping.Stop("program") as stop:
  loop.train(_config(6), sys.argv[1], _stage(), _next_batch, evaluate=lambda params: {{}}, stop=stop)
print("still there")
"""


@pytest.mark.slow
@pytest.mark.parametrize("place, saved", [("loop.init_state", None), ("report.was_evaluated", 2)])
def test_sigterm_is_heard_while_the_main_thread_is_busy(tmp_path, forks, place, saved):
  """While the first step is compiled nothing is lost; while a save is judged the state is on disk before the end."""
  began = time.time()
  done = processes.run(["-c", _BUSY.format(place=place), tmp_path], devices_env(1))
  assert done.returncode == 75 and done.stderr == "program: preempted, resumable\n", done.stderr
  assert "still there" not in done.stdout and time.time() - began < 30 and Saver(tmp_path).latest == saved
  rest = train.train(_config(6), tmp_path, _stage(), _next_batch, resume=True)
  whole = train.train(_config(6), tmp_path / "whole", _stage(), _next_batch)
  assert _equal(rest, whole)


def test_a_folder_is_one_programs(tmp_path):
  with lock.locked(tmp_path):
    with pytest.raises(ValueError, match=f"in use by process {os.getpid()} on {socket.gethostname()} since"):
      fit.run(load_config("cdamd_length", "tiny"), tmp_path)
    assert (tmp_path / lock.NAME).is_file()  # the first one's, still
  assert not any(tmp_path.iterdir())


@pytest.mark.parametrize("owner, taken", [
    ("{free}\n{host}\n", True),
    ("{pid}\n{host}\n1\n", True),  # started at another time: the number is another program's now
    ("", True), ("12", True),  # cut short by a machine that went down
    ("1\nanother-machine\n", False)])  # may be alive
def test_the_lock_of_a_dead_program_is_taken_over(tmp_path, owner, taken):
  before = owner.format(free=2**30, pid=os.getpid(), host=socket.gethostname())
  (tmp_path / lock.NAME).write_text(before)
  if not taken:
    with pytest.raises(ValueError, match="in use by process 1 on another-machine since .*; wait for it, stop it, or "
                       "choose another folder; if another-machine does not run it any more, delete .*run.lock"):
      with lock.locked(tmp_path):
        pass
    assert (tmp_path / lock.NAME).read_text() == before
    return
  with lock.locked(tmp_path):
    assert (tmp_path / lock.NAME).read_text().startswith(f"{os.getpid()}\n")
  assert not any(tmp_path.iterdir())


_HOLDS = """
import sys, time
from motion_jax.training import lock
with lock.locked(sys.argv[1]):
  print("holds it", flush=True)
  time.sleep(60)
"""


def test_the_lock_of_a_killed_process_is_free_again(tmp_path):
  """While the process lives, the error names it; SIGKILL leaves the file, which the next program replaces."""
  holder = subprocess.Popen([sys.executable, "-c", _HOLDS, tmp_path], env=devices_env(1), cwd=ROOT, text=True,
                            stdout=subprocess.PIPE)
  assert holder.stdout.readline() == "holds it\n"
  with pytest.raises(ValueError, match=f"in use by process {holder.pid} on {socket.gethostname()} since 20"):
    with lock.locked(tmp_path):
      pass
  holder.kill()
  holder.communicate()
  assert (tmp_path / lock.NAME).is_file()
  with lock.locked(tmp_path):
    pass
  assert not any(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written(tmp_path):
  (tmp_path / "file").touch()
  with pytest.raises(OSError, match="cannot write .*run.lock: .*; choose a folder that you may write to"):
    with lock.locked(tmp_path / "file"):
      pass
  tmp_path.chmod(0o555)
  user = os.geteuid()
  os.seteuid(65534 if user == 0 else user)  # root may write everywhere
  try:
    with pytest.raises(OSError, match="cannot write .*run.lock: Permission denied; choose a folder that you may"):
      with lock.locked(tmp_path):
        pass
  finally:
    os.seteuid(user)
    tmp_path.chmod(0o755)


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
