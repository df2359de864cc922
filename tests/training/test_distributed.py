"""Several processes train as one."""
import os
import signal
import socket
import subprocess
import time
import types

import numpy as np
import pytest

from motion_jax.training import checkpoint, distributed
from motion_jax.training.metrics import read_metrics
from motion_jax.utils.errors import InputError
from tests import processes
from tests.conftest import ROOT, some_of

CLUSTER = ("SLURM_", "OMPI_", "TPU_")


@pytest.fixture
def no_cluster(monkeypatch):
  for name in [name for name in os.environ if name.startswith(CLUSTER)]:
    monkeypatch.delenv(name)


@pytest.mark.parametrize("given, told", [
    (dict(process_id=0), "got --process-id without --coordinator, --num-processes"),
    (dict(coordinator="localhost:1", num_processes=2), "got --coordinator, --num-processes without --process-id"),
    (dict(coordinator="localhost:1", process_id=2, num_processes=2), "got --process-id 2 of 2 processes"),
    (dict(coordinator="auto", process_id=1, num_processes=2), "or --coordinator=auto alone")])
def test_flags_that_belong_together(given, told, no_cluster):
  with pytest.raises(InputError, match=told):
    distributed.start(**given)


def test_a_cluster_is_known_by_its_environment(monkeypatch, no_cluster):
  assert not distributed.in_cluster()
  for name, value in dict(SLURM_JOB_ID="7", SLURM_STEP_NODELIST="a", SLURM_PROCID="0", SLURM_LOCALID="0").items():
    monkeypatch.setenv(name, value)
  for count, several in (("1", False), ("2", True)):
    monkeypatch.setenv("SLURM_NTASKS", count)
    assert distributed.in_cluster() == several
  monkeypatch.delenv("SLURM_PROCID")  # a shell that salloc gave, outside of srun
  assert not distributed.in_cluster()
  for hosts, several in (("here", False), ("here,there", True)):
    monkeypatch.setenv("TPU_WORKER_HOSTNAMES", hosts)
    assert distributed.in_cluster() == several


def test_processes_ask_one_another_every_five_seconds_at_the_same_steps(monkeypatch):
  """Steps take 0.125 s here and 0.5 s in the other process, which is told to end in between."""
  now, told, asked = [0.0], [0], []

  def gathered(mine):
    asked.append((step, mine[-1]))
    return np.stack([mine, [told[0], 0, -1 if len(asked) == 1 else -10]])

  monkeypatch.setattr(distributed.jax, "process_count", lambda: 2)
  monkeypatch.setattr(distributed.multihost_utils, "process_allgather", gathered)
  monkeypatch.setattr(distributed, "time", types.SimpleNamespace(monotonic=lambda: now[0]))
  agreement, answers = distributed.Agreement(), {}
  for step in range(1, 25):
    now[0] += 0.125
    told[0] = signal.SIGTERM if step > 5 else 0
    if any(answer := agreement.largest(0, 1)):
      answers[step] = answer
  assert asked == [(1, -1), (2, -40), (12, -40), (22, -40)]
  assert answers == {1: (0, 1), 2: (0, 1), 12: (signal.SIGTERM, 1), 22: (signal.SIGTERM, 1)}


TOKENIZER = ("cmdm_tokenizer:tiny", "--config.frozen.teacher=")
LENGTH = ("cdamd_length:tiny",)  # compiles in a fifth of the time
CONFIGS = {config[0]: config for config in (LENGTH, TOKENIZER)}


def begin(folder, num_steps, num_processes, devices, *flags, config=TOKENIZER, environments=None,
          program=("-m", "motion_studio.cli")):
  """[(process, file of what it prints)] of the command in so many processes of one run, each with as many simulated
  devices."""
  with socket.socket() as free:
    free.bind(("localhost", 0))
    address = f"localhost:{free.getsockname()[1]}"
  started = []
  for i in range(num_processes):
    own = ["--coordinator", address, "--process-id", str(i), "--num-processes", str(num_processes)]
    command = [*program, "train", "--config", *config, "--workdir", str(folder),
               f"--config.train.num_steps={num_steps}", "--config.mesh.map=shard_map",
               "--simulate-devices", str(devices), *flags]
    command += own if num_processes > 1 and not environments else []
    env = {name: value for name, value in os.environ.items() if not name.startswith(CLUSTER)}
    env |= {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)} | (environments[i] if environments else {})
    said = folder.parent / f"{folder.name}.{i}.txt"  # a pipe that nobody reads would stop who writes to it
    started.append((processes.Process(command, env, said, said), said))
  return started


def end(started, seconds=900):
  """([exit statuses], [what was printed]); processes that have not ended by then are killed."""
  deadline = time.time() + seconds
  try:
    for process, _ in started:
      process.wait(max(deadline - time.time(), 0))
  except subprocess.TimeoutExpired:
    pass
  finally:
    for process, _ in started:
      process.kill()
  return [process.wait() for process, _ in started], [said.read_text() for _, said in started]


def train(*args, **named):
  """What the processes of a run print, which all end well."""
  statuses, said = end(begin(*args, **named))
  assert not any(statuses), "\n".join(f"process {i}, status {status}: {text[-2000:]}"
                                      for i, (status, text) in enumerate(zip(statuses, said)))
  return said


def numbers(folder):
  """(the loss of each row of metrics, the weights)"""
  rows = [row for row in read_metrics(folder) if "loss" in row]
  return [row["step"] for row in rows], [row["loss"] for row in rows], checkpoint.load_params(folder)["params"]


def assert_alike(one, other, rtol):
  assert one[0] == other[0]
  np.testing.assert_allclose(one[1], other[1], rtol=rtol)
  flat = lambda tree: np.concatenate([leaf.ravel() for leaf in _leaves(tree)])
  np.testing.assert_allclose(flat(one[2]), flat(other[2]), rtol=rtol, atol=rtol)


def _leaves(tree):
  return [leaf for name in sorted(tree) for leaf in (_leaves(tree[name]) if isinstance(tree[name], dict)
                                                     else [tree[name]])]


@pytest.mark.parametrize("config", some_of(CONFIGS, slow=[LENGTH[0]]))
def test_two_processes_train_as_one_with_two_devices_and_go_on_from_each_other(tmp_path, config):
  """Each half of one run is what the other trains in the same steps; both write one run folder."""
  train(tmp_path / "a", 2, 1, 2, config=CONFIGS[config])
  train(tmp_path / "b", 2, 2, 1, config=CONFIGS[config])
  assert_alike(numbers(tmp_path / "a"), numbers(tmp_path / "b"), 1e-6)
  said = train(tmp_path / "a", 4, 2, 1, config=CONFIGS[config])  # goes on by itself
  train(tmp_path / "b", 4, 1, 2, "--resume", config=CONFIGS[config])
  assert_alike(numbers(tmp_path / "a"), numbers(tmp_path / "b"), 1e-6)
  assert numbers(tmp_path / "a")[0] == [1, 2, 3, 4]
  assert "of 2 processes" in said[0]
  assert all("[Gloo]" in line for line in said[1].splitlines())  # a word of the library that connects them


@pytest.mark.exhaustive
def test_four_processes_train_as_one_with_four_devices(tmp_path):
  train(tmp_path / "one", 2, 1, 4)
  train(tmp_path / "four", 2, 4, 1)
  assert_alike(numbers(tmp_path / "one"), numbers(tmp_path / "four"), 1e-5)


_LATE = """
import sys, time
from motion_studio import cli
from motion_jax.training import loop

together = loop.compile_together
late = "--process-id 1" in " ".join(sys.argv)
loop.compile_together = lambda *args: (late and time.sleep(40), together(*args))
sys.exit(cli.main())
"""


@pytest.mark.slow
def test_a_process_that_compiles_for_long_is_waited_for(tmp_path):
  """Longer than the 30 seconds that CPUs look for one another."""
  train(tmp_path / "late", 2, 2, 1, config=LENGTH, program=("-c", _LATE))
  assert numbers(tmp_path / "late")[0] == [1, 2]


_FAILS = """
import sys
from motion_studio import cli
from motion_jax.training import loop

def fail(*args):
  raise ValueError("the disk of this machine is gone")

if "--process-id 0" in " ".join(sys.argv) or WHO == "all":
  loop.compile_together = fail
sys.exit(cli.main())
"""


@pytest.mark.slow
@pytest.mark.parametrize("who", ["first", "all"])
def test_a_process_that_fails_is_not_waited_for(tmp_path, who):
  """It says why; the others, which would wait for it in their first step, end too."""
  program = ("-c", _FAILS.replace("WHO", repr(who)))
  statuses, said = end(begin(tmp_path / "run", 2, 2, 1, config=LENGTH, program=program), 200)
  assert statuses[0] == 1 and "the disk of this machine is gone" in said[0]
  assert statuses[1] == (1 if who == "all" else -signal.SIGABRT)
  assert "the disk of this machine is gone" in said[1] or "another task died" in said[1]


@pytest.mark.slow
def test_a_sharded_state_is_saved_by_both_and_goes_on_in_one_and_back(tmp_path):
  """Each process writes its part; with a whole state the first one writes all."""
  sharded = "--config.mesh.layout=fully_sharded"
  train(tmp_path / "a", 2, 2, 1)
  train(tmp_path / "b", 2, 2, 1, sharded)
  assert_alike(numbers(tmp_path / "a"), numbers(tmp_path / "b"), 1e-4)
  files = lambda name, i: (tmp_path / name / "checkpoints" / "2").rglob(f"*process_{i}/d/*")
  sizes = {name: [sum(file.stat().st_size for file in files(name, i)) for i in (0, 1)] for name in "ab"}
  assert sizes["b"][1] > sizes["a"][0] / 4 and not sizes["a"][1], sizes
  train(tmp_path / "a", 4, 2, 1, sharded)
  train(tmp_path / "b", 4, 1, 1, "--resume")
  train(tmp_path / "b", 6, 2, 1, sharded)
  train(tmp_path / "a", 6, 1, 1, "--resume")
  assert_alike(numbers(tmp_path / "a"), numbers(tmp_path / "b"), 1e-4)
  assert numbers(tmp_path / "a")[0] == [1, 2, 3, 4, 5, 6]


DENOISER = ("cmdm_denoiser:tiny", "--config.data.batch_size=8", "--config.model.width=32")
SPLIT = "--config.mesh.layout=fully_sharded", "--config.mesh.model=2"


@pytest.mark.exhaustive
def test_a_mesh_of_two_axes_trains_and_continues_on_another(tmp_path):
  """Eight devices of one, two and four processes: replicated, 4 x 2 sharded, then 2 x 4 from the same files."""
  train(tmp_path / "whole", 2, 1, 8, config=DENOISER)
  train(tmp_path / "split", 2, 4, 2, *SPLIT, config=DENOISER)
  assert_alike(numbers(tmp_path / "whole"), numbers(tmp_path / "split"), 1e-4)
  train(tmp_path / "split", 4, 2, 4, "--config.mesh.layout=tensor", "--config.mesh.model=4", config=DENOISER)
  train(tmp_path / "whole", 4, 1, 8, "--resume", *SPLIT, config=DENOISER)
  assert_alike(numbers(tmp_path / "whole"), numbers(tmp_path / "split"), 1e-4)
  assert numbers(tmp_path / "split")[0] == [1, 2, 3, 4]


@pytest.mark.slow
def test_a_sharded_run_resumes_to_the_same_bytes(tmp_path):
  train(tmp_path / "once", 4, 1, 8, *SPLIT, config=DENOISER)
  train(tmp_path / "twice", 2, 1, 8, *SPLIT, config=DENOISER)
  train(tmp_path / "twice", 4, 1, 8, "--resume", *SPLIT, config=DENOISER)
  assert_alike(numbers(tmp_path / "once"), numbers(tmp_path / "twice"), 0)


_TOLD = """
import os, signal, sys
from motion_studio import cli
from motion_jax.training import distributed, loop

class Agreement(distributed.Agreement):
  step = 0
  def largest(self, *numbers):
    self.step += 1
    tell(self.step)
    return super().largest(*numbers)

def tell(step):
  if step == STEP and any(f"--process-id {i}" in " ".join(sys.argv) for i in WHO):
    os.kill(os.getpid(), signal.SIGTERM)

together = loop.compile_together
loop.Agreement, loop.compile_together = Agreement, lambda *args: (tell(0), together(*args))
distributed._ASKING = 0
sys.exit(cli.main())
"""


@pytest.mark.parametrize("who, step", some_of([("1", 3), ("0", 0), ("01", 3), ("01", 0)], slow=[("1", 3), ("01", 0)]))
def test_processes_that_are_told_to_end_can_go_on(tmp_path, who, step):
  """Whoever hears it, all save the same step, one says so, and the same command goes on to the same end."""
  program = ("-c", _TOLD.replace("WHO", repr(who)).replace("STEP", str(step)))
  statuses, said = end(begin(tmp_path / "run", 6, 2, 1, config=LENGTH, program=program))
  assert statuses == [75, 75], said
  assert [text.count("motion-jax train: preempted, resumable\n") for text in said] == [1, 0], said
  saved = [path.name for path in (tmp_path / "run" / "checkpoints").iterdir()]
  if who == "01" and not step:
    assert not saved  # there was nothing to lose
  else:
    assert max(map(int, saved)) == (step + 1 if step else 1)
  train(tmp_path / "run", 6, 2, 1, config=LENGTH)
  train(tmp_path / "whole", 6, 2, 1, config=LENGTH)
  assert_alike(numbers(tmp_path / "run"), numbers(tmp_path / "whole"), 0)


_NO_ROOM = """
import errno, sys
from motion_studio import cli
from motion_jax.training import saver

class Meeting(saver.Meeting):
  def wait(self, *seconds):
    if self._name == "meeting 0" and self._places == PLACE and "--process-id WHO" in " ".join(sys.argv):
      raise OSError(errno.ENOSPC, "No space left on device")
    super().wait(*seconds)

saver.Meeting = Meeting
sys.exit(cli.main())
"""


@pytest.mark.parametrize("who, place", some_of([(1, 1), (0, 0), (0, 1), (1, 0), (0, 3)], slow=[(1, 1), (0, 3)]))
def test_a_disk_that_is_full_for_one_process_is_full_for_all(tmp_path, who, place):
  """The first of three saves fails, before orbax begins (place 0), while it writes or after it; all go on at once."""
  program = ("-c", _NO_ROOM.replace("WHO", str(who)).replace("PLACE", str(place)))
  statuses, said = end(begin(tmp_path / "run", 6, 2, 1, config=LENGTH, program=program), 200)
  assert statuses == [0, 0], said
  told = [line for line in said[0].splitlines() if "a state could not be saved (" in line]
  assert len(told) == 1 and "No space left on device" in told[0], said
  assert ("process 1: " in told[0]) == (who == 1)
  assert sorted(path.name for path in (tmp_path / "run" / "checkpoints").iterdir()) == ["4", "6"]
  assert numbers(tmp_path / "run")[0] == [1, 2, 3, 4, 5, 6]


@pytest.mark.slow
def test_slurm_is_found(tmp_path):
  """Two processes with the environment that srun gives them, on this machine."""
  job = {"SLURM_JOB_ID": str(os.getpid()), "SLURM_STEP_NODELIST": "localhost", "SLURM_NTASKS": "2"}
  said = train(tmp_path / "run", 2, 2, 1, config=LENGTH, environments=[
      job | {"SLURM_PROCID": str(i), "SLURM_LOCALID": str(i)} for i in range(2)])
  assert "of 2 processes" in said[0] and numbers(tmp_path / "run")[0] == [1, 2]
