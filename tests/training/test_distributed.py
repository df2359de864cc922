"""Several processes train as one."""
import errno
import os
import signal
import socket
import subprocess
import sys
import time
import types

import jax
import numpy as np
import pytest

from motion_jax.nets.partitioning import partitioned
from motion_jax.training import checkpoint, distributed, loop, saver
from motion_jax.training.metrics import read_metrics
from motion_jax.training.stage import Stage
from motion_jax.utils.errors import InputError
from tests import processes
from tests.conftest import ROOT, some_of
from tests.training.test_train import _config

CLUSTER = ("SLURM_", "OMPI_", "TPU_")


@pytest.fixture
def no_cluster(monkeypatch):
  for name in [name for name in os.environ if name.startswith(CLUSTER)]:
    monkeypatch.delenv(name)


@pytest.mark.parametrize("given, told", [
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
  """Steps take 0.125 s here and 0.5 s in the other process, which gets a signal in between."""
  now, theirs, asked = [0.0], [0], []

  def gathered(mine):
    asked.append((step, mine[-1]))
    return np.stack([mine, [theirs[0], 0, -1 if len(asked) == 1 else -10]])

  monkeypatch.setattr(distributed.jax, "process_count", lambda: 2)
  monkeypatch.setattr(distributed.multihost_utils, "process_allgather", gathered)
  monkeypatch.setattr(distributed, "time", types.SimpleNamespace(monotonic=lambda: now[0]))
  agreement, answers = distributed.Agreement(), {}
  for step in range(1, 25):
    now[0] += 0.125
    theirs[0] = signal.SIGTERM if step > 5 else 0
    if any(answer := agreement.largest(0, 1)):
      answers[step] = answer
  assert asked == [(1, -1), (2, -40), (12, -40), (22, -40)]
  assert answers == {1: (0, 1), 2: (0, 1), 12: (signal.SIGTERM, 1), 22: (signal.SIGTERM, 1)}


# --- processes --------------------------------------------------------------------------------------------------------


def begin(folder, num_processes, *arguments, environments=None):
  """[(process, file of what it prints)] of Python in the processes of one run; the arguments of each end with the
  address of the first one, its own number and how many there are."""
  with socket.socket() as free:
    free.bind(("localhost", 0))
    address = f"localhost:{free.getsockname()[1]}"
  started = []
  for i in range(num_processes):
    env = {name: value for name, value in os.environ.items() if not name.startswith(CLUSTER)}
    env |= {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)} | (environments[i] if environments else {})
    output = folder / f"{len(list(folder.glob('*.txt')))}.txt"
    output.touch()
    started.append((processes.Process([*arguments, "--coordinator", address, "--process-id", i, "--num-processes",
                                       num_processes], env, output, output), output))
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
  return [process.wait() for process, _ in started], [output.read_text() for _, output in started]


def call(name, *given):
  """Arguments for `begin`: a function of this module, in processes that know one another."""
  return "-c", f"from tests.training import test_distributed; test_distributed.{name}(*{given!r})"


def together(folder, num_processes, *arguments, **named):
  """What the processes of a run print, which all end well."""
  statuses, printed = end(begin(folder, num_processes, *arguments, **named))
  assert not any(statuses), "\n".join(f"process {i}, status {status}: {text[-2000:]}"
                                      for i, (status, text) in enumerate(zip(statuses, printed)))
  return printed


def join(devices):
  """Connects this process, one of `begin`'s, with as many simulated devices; -> its number."""
  address, process_id, num_processes = sys.argv[-5], int(sys.argv[-3]), int(sys.argv[-1])
  if num_processes > 1:
    distributed.start(address, process_id, num_processes, devices)
  else:
    distributed.start(simulate_devices=devices)
  return process_id


def _matrix():
  """Points through a matrix that has names for its axes: the smallest stage that every mesh splits."""
  weights = partitioned(lambda rng: 0.1 * jax.random.normal(rng, (32, 64)), ("embed", "mlp"))

  def loss(params, frozen, batch, step, rng):
    noise = jax.vmap(lambda i: jax.random.normal(jax.random.fold_in(rng, i)))(batch["index"])
    error = (batch["x"] @ params["w"]).sum(1) - batch["y"] + 0.01 * noise
    return {"loss": (batch["mask"] * error ** 2).sum()}, batch["mask"].sum()

  return Stage(lambda batch, rng: {"w": weights(rng)}, loss, None)


def _rows(step, rows=slice(None)):
  x = np.random.default_rng(step).normal(size=(8, 32)).astype(np.float32)
  return {name: array[rows] for name, array in dict(
      x=x, y=x[:, 0] - 2 * x[:, 1], mask=np.float32([0.2, 1, 1, 0.3, 1, 1, 1, 1]), index=np.arange(8)).items()}


def train(folder, num_steps, resume=False, stage=None, **mesh):
  """A run folder after these steps, two between saves."""
  config = _config(num_steps)
  config.mesh.update(map="shard_map", **mesh)
  state = loop.train(config, folder, stage or _matrix(), _rows, resume=resume)
  distributed.wait_for_all(f"{folder} has {num_steps} steps")
  return state


def slices(devices, *runs):
  """Trains in this process, one of several; runs: (folder, steps, whether it continues, sections of the mesh)."""
  join(devices)
  with distributed.as_one():
    for folder, num_steps, resume, mesh in runs:
      train(folder, num_steps, resume, **dict(mesh))


def numbers(folder):
  """(steps, losses, weights)"""
  rows = [row for row in read_metrics(folder) if "loss" in row]
  weights = [leaf.ravel() for leaf in jax.tree.leaves(checkpoint.load_params(folder))]
  return [row["step"] for row in rows], [row["loss"] for row in rows], np.concatenate(weights)


def assert_alike(one, other, rtol):
  assert one[0] == other[0]
  np.testing.assert_allclose(one[1], other[1], rtol=rtol)
  np.testing.assert_allclose(one[2], other[2], rtol=rtol, atol=rtol)


SHARDED, SPLIT = dict(layout="fully_sharded"), dict(layout="fully_sharded", model=2)


def alone(whole, handed, once, twice):
  """Eight devices of one process: a sharded run in two slices ends with the bytes of one in one."""
  join(8)
  train(whole, 4)
  train(handed, 2)
  state = train(once, 4, **SPLIT)
  train(twice, 2, **SPLIT)
  again = train(twice, 4, True, **SPLIT)
  for a, b in zip(jax.tree.leaves(state), jax.tree.leaves(again), strict=True):
    np.testing.assert_array_equal(a, b)
  assert numbers(once)[:2] == numbers(twice)[:2]


@pytest.mark.slow
def test_one_process_and_two_train_the_same_and_hand_their_states_to_each_other(tmp_path):
  """Whole and sharded; of a sharded state each process writes its part, of a whole one the first writes all."""
  names = "whole", "handed", "once", "twice", "pair", "parts"
  whole, handed, once, twice, pair, parts = (str(tmp_path / name) for name in names)
  together(tmp_path, 1, *call("alone", whole, handed, once, twice))
  together(tmp_path, 2, *call("slices", 4, (pair, 4, False, {}), (parts, 2, False, SHARDED), (handed, 4, True, SPLIT)))
  files = lambda name, step, i: (tmp_path / name / "checkpoints" / str(step)).rglob(f"*process_{i}/d/*")
  sizes = {name: [sum(file.stat().st_size for file in files(name, step, i)) for i in (0, 1)]
           for name, step in (("pair", 4), ("parts", 2))}
  assert sizes["parts"][1] > sizes["pair"][0] / 4 and not sizes["pair"][1], sizes
  together(tmp_path, 1, *call("slices", 1, (parts, 4, True, {})))
  for folder in (pair, handed, parts, once):
    assert_alike(numbers(whole), numbers(folder), 1e-5)
  assert numbers(whole)[0] == [1, 2, 3, 4]


@pytest.mark.exhaustive
def test_a_mesh_of_two_axes_trains_and_continues_on_another(tmp_path):
  """Eight devices of one, two and four processes: replicated, 4 x 2 sharded, then 2 x 4 from the same files."""
  whole, split = str(tmp_path / "whole"), str(tmp_path / "split")
  together(tmp_path, 1, *call("slices", 8, (whole, 4, False, {})))
  together(tmp_path, 4, *call("slices", 2, (split, 2, False, SPLIT)))
  together(tmp_path, 2, *call("slices", 4, (split, 4, True, dict(layout="tensor", model=4))))
  assert_alike(numbers(whole), numbers(split), 1e-5)


def late(folder):
  """The second process traces its step for longer than the 30 seconds that CPUs look for one another."""
  number, stage, waits = join(1), _matrix(), [40]

  def loss(*given):
    time.sleep(waits.pop() if waits and number else 0)
    return stage.loss(*given)

  train(folder, 2, stage=stage._replace(loss=loss))


@pytest.mark.slow
def test_a_process_that_compiles_for_long_is_waited_for(tmp_path):
  together(tmp_path, 2, *call("late", str(tmp_path / "run")))
  assert numbers(tmp_path / "run")[0] == [1, 2]


def fails(folder, who):
  with distributed.as_one():
    if str(join(1)) in who:
      raise ValueError("the disk of this machine is gone")
    train(folder, 2)


@pytest.mark.parametrize("who", some_of(["0", "01"], slow=["0"]))
def test_a_process_that_fails_is_not_waited_for(tmp_path, who):
  """It says why; the others, which would wait for it in their first step, end too."""
  statuses, printed = end(begin(tmp_path, 2, *call("fails", str(tmp_path / "run"), who)), 200)
  assert statuses == [1, 1 if who == "01" else -signal.SIGABRT] and "the disk of this machine is gone" in printed[0]
  assert "the disk of this machine is gone" in printed[1] or "another task died" in printed[1]


_SIGNALLED = """
import os, signal, sys
from motion_jax_studio import cli
from motion_jax.training import distributed, loop

class Agreement(distributed.Agreement):
  step = 0
  def largest(self, *numbers):
    self.step += 1
    end_at(self.step)
    return super().largest(*numbers)

def end_at(step):
  if step == STEP and any(f"--process-id {i}" in " ".join(sys.argv) for i in WHO):
    os.kill(os.getpid(), signal.SIGTERM)

together = loop.compile_together
loop.Agreement, loop.compile_together = Agreement, lambda *args: (end_at(0), together(*args))
distributed._ASKING = 0
sys.exit(cli.main())
"""


@pytest.mark.parametrize("who, step", some_of([("1", 3), ("0", 0), ("01", 3), ("01", 0)], slow=[("1", 3)]))
def test_processes_that_get_a_signal_save_the_same_step_and_continue(tmp_path, who, step):
  """By the command: whichever hears it, all save the same step, one reports it, and the same command continues to the
  end of one process with two devices."""
  folder = tmp_path / "run"
  command = lambda folder, *flags: ("train", "--config", "cdamd_length:tiny", "--workdir", folder, *flags,
                                    "--config.train.num_steps=6", "--config.mesh.map=shard_map")
  program = "-c", _SIGNALLED.replace("WHO", repr(who)).replace("STEP", str(step))
  statuses, printed = end(begin(tmp_path, 2, *program, *command(folder, "--simulate-devices=1")))
  assert statuses == [75, 75], printed
  assert [text.count("motion-jax train: preempted, resumable\n") for text in printed] == [1, 0], printed
  saved = [path.name for path in (folder / "checkpoints").iterdir()]
  if who == "01" and not step:
    assert not saved  # there was nothing to lose
  else:
    assert max(map(int, saved)) == (step + 1 if step else 1)
  module = "-m", "motion_jax_studio.cli"
  printed = together(tmp_path, 2, *module, *command(folder, "--simulate-devices=1"))
  assert "of 2 processes" in printed[0]
  assert all("[Gloo]" in line for line in printed[1].splitlines())  # of the library that connects them
  done = processes.run([*module, *command(tmp_path / "whole", "--simulate-devices=2")], os.environ | {
      "JAX_PLATFORMS": "cpu"})
  assert done.returncode == 0, done.stderr
  assert_alike(numbers(folder), numbers(tmp_path / "whole"), 1e-6)


def no_room(*cases):
  """Trains for each (folder, process, place) with a first save that fails there: before orbax begins (place 0), while
  it writes or after it."""
  number = join(1)

  class Meeting(distributed.Meeting):
    made = 0

    def __init__(self):
      super().__init__()
      self.place, self.fails, Meeting.made = 0, Meeting.made == 0 and number == who, Meeting.made + 1

    def wait(self, *seconds):
      if self.fails and self.place == place:
        raise OSError(errno.ENOSPC, "No space left on device")
      self.place += 1
      super().wait(*seconds)

  saver.Meeting = Meeting
  for folder, who, place in cases:
    Meeting.made = 0
    with distributed.as_one():
      print(f"--- {who} {place}", flush=True)
      train(folder, 6)


@pytest.mark.slow
def test_a_disk_that_is_full_for_one_process_is_full_for_all(tmp_path):
  """The first of three saves fails in one of two processes; both continue at once."""
  cases = [(str(tmp_path / f"{who}-{place}"), who, place) for who, place in ((1, 1), (0, 0), (0, 1), (1, 0), (0, 3))]
  printed = together(tmp_path, 2, *call("no_room", *cases))
  for text, (folder, who, place) in zip(printed[0].split("--- ")[1:], cases, strict=True):
    (line,) = [line for line in text.splitlines() if "a state could not be saved (" in line]
    assert text.startswith(f"{who} {place}\n") and "No space left on device" in line
    assert ("process 1: " in line) == (who == 1)
    assert sorted(int(path.name) for path in (tmp_path / folder / "checkpoints").iterdir()) == [4, 6]
    assert numbers(folder)[0] == [1, 2, 3, 4, 5, 6]


@pytest.mark.slow
def test_slurm_is_known(tmp_path):
  """Two processes with the environment that srun gives them, on this machine."""
  job = {"SLURM_JOB_ID": str(os.getpid()), "SLURM_STEP_NODELIST": "localhost", "SLURM_NTASKS": "2"}
  code = ("import jax; from motion_jax.training import distributed; distributed.start(); "
          "print('process', jax.process_index(), 'of', jax.process_count())")
  printed = together(tmp_path, 2, "-c", code, environments=[
      job | {"SLURM_PROCID": str(i), "SLURM_LOCALID": str(i)} for i in range(2)])
  assert [f"process {i} of 2" in text for i, text in enumerate(printed)] == [True, True]
