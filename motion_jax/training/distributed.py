"""Several processes as one run: how they connect, which one writes, and how they wait for one another.

Each process starts the same command. They connect by the address of the first process, from a flag or from the cluster
(Slurm, Open MPI, TPU pods), and then see the devices of all.
"""
import atexit
import contextlib
import functools
import itertools
import json
import os
import sys
import time

import jax
import numpy as np
from jax.experimental import multihost_utils

from motion_jax.utils import exit_status
from motion_jax.utils.errors import InputError, reason

_PATIENCE = 3600  # seconds to wait for a process that reads data, compiles or evaluates
_PARTING = 10     # seconds that a process that has failed, or got a signal, waits for the others to end with it
_ASKING = 5       # seconds between two steps at which processes exchange signals
_failed = False

_CLUSTERS = {  # environment variables that hold the number of processes, and others that JAX reads with them
    "SLURM_NTASKS": ("SLURM_JOB_ID", "SLURM_STEP_NODELIST", "SLURM_PROCID", "SLURM_LOCALID"),
    "OMPI_COMM_WORLD_SIZE": ("OMPI_MCA_orte_hnp_uri", "OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_LOCAL_RANK"),
}


def start(coordinator=None, process_id=None, num_processes=None, simulate_devices=0):
  """Connects this process with the others of its run, if there are any; call it before anything else of JAX.

  coordinator: HOST:PORT of process 0, with process_id and num_processes; "auto": JAX finds all three, or fails. Without
  any of them the environment is searched for a cluster. simulate_devices: number of CPU devices to simulate.
  """
  given = {"--coordinator": coordinator, "--process-id": process_id, "--num-processes": num_processes}
  if simulate_devices:
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_num_cpu_devices", simulate_devices)
  if coordinator == "auto" and process_id is None and num_processes is None or (
      not any(value is not None for value in given.values()) and in_cluster()):
    _initialize()
    return
  missing = [name for name, value in given.items() if value is None]
  if len(missing) == len(given):
    return
  if missing or coordinator == "auto":
    raise InputError(f"got {', '.join(name for name in given if name not in missing)} without "
                     f"{', '.join(missing) or 'an address'}; give all three, HOST:PORT of process 0 for --coordinator, "
                     "or --coordinator=auto alone, with which JAX finds them")
  if not 0 <= process_id < num_processes:
    raise InputError(f"got --process-id {process_id} of {num_processes} processes, expected 0 to {num_processes - 1}")
  _initialize(coordinator_address=coordinator, process_id=process_id, num_processes=num_processes)


def _initialize(**named):
  jax.config.update("jax_enable_preemption_service", False)  # it would take SIGTERM, which is for `stopping.Stop`
  try:
    jax.distributed.initialize(**named)
  except (RuntimeError, ValueError) as error:
    raise InputError(f"the processes of this run did not find one another ({error}); check that all run the same "
                     "command and that the first one's address is reached from each") from error
  atexit.register(_leave)
  jax.devices()
  wait_for_all("the processes know their devices")
  multihost_utils.sync_global_devices("the devices are connected")  # see `compile_together`


def _leave():
  """Runs before JAX's own exit handler, which waits for all other processes: a process that has failed must not wait,
  as they may be waiting for it inside a sum over devices, forever."""
  if _failed:
    try:
      wait_for_all("the processes have failed", _PARTING)
    except jax.errors.JaxRuntimeError:
      sys.stdout.flush()
      sys.stderr.flush()
      os._exit(exit_status.FAILED)


def in_cluster() -> bool:
  """Whether the environment is that of one of several processes started by a cluster that JAX supports."""
  environment = os.environ
  for count, others in _CLUSTERS.items():
    if environment.get(count, "1") != "1" and all(name in environment for name in others):
      return True
  return "," in environment.get("TPU_PROCESS_ADDRESSES", environment.get("TPU_WORKER_HOSTNAMES", ""))


def is_first() -> bool:
  """Whether this process is the one that prints and writes metrics, weights and pictures."""
  return not jax.distributed.is_initialized() or jax.process_index() == 0


def by_first(function):
  """Decorates a function that writes something: it runs in the first process only."""
  @functools.wraps(function)
  def written(*args, **named):
    return function(*args, **named) if is_first() else None

  return written


def on_host(tree):
  """Arrays on the host, the same in every process, of arrays on the devices of all processes, sharded or replicated.

  Every process has to call it, at the same point.
  """
  local = lambda leaf: not isinstance(leaf, jax.Array) or leaf.is_fully_addressable or leaf.is_fully_replicated
  return jax.tree.map(lambda leaf: np.asarray(leaf) if local(leaf)
                      else multihost_utils.process_allgather(leaf, tiled=True), tree)


@contextlib.contextmanager
def as_one():
  """In the block only the first process prints; errors of all are shown. An error that ends one process ends the
  others, too, as JAX stops them when they miss it."""
  global _failed
  with contextlib.ExitStack() as stack:
    if not is_first():
      stack.enter_context(contextlib.redirect_stdout(stack.enter_context(open(os.devnull, "w"))))
    try:
      yield
    except BaseException:
      _failed = True
      raise


def wait_for_all(name, seconds=_PATIENCE):
  """A barrier of this name for all processes; any thread may call it.

  The processes meet by their coordinator, not the devices as in `multihost_utils.sync_global_devices`, whose time limit
  is short. Raises JaxRuntimeError after `seconds`, or when a process is gone.
  """
  if jax.process_count() > 1:
    from orbax.checkpoint import multihost  # here: using a model does not need it
    multihost.get_barrier_sync_fn()(key=name, timeout_ms=int(1000 * seconds))


class Meeting:
  """A series of barriers for work that may fail in any process: then the others stop waiting, and raise its error.

  Every process makes its own Meeting and comes to the same barriers in the same order; any thread may use it. A barrier
  is a key of the coordinator, which the last process to arrive sets, or one that fails and will not arrive.
  """
  _numbers = itertools.count()

  def __init__(self):
    self._name, self._several, self._places = f"meeting {next(self._numbers)}", jax.process_count() > 1, 0
    if self._several:
      from orbax.checkpoint import multihost  # here: using a model does not need it
      self._coordinator = multihost.get_jax_distributed_client()

  @property
  def _place(self):
    return f"{self._name}, place {self._places}"

  def wait(self, seconds=_PATIENCE):
    """Returns when every process is at this barrier. Raises OSError where one has failed with an OSError, RuntimeError
    where it failed otherwise, JaxRuntimeError after `seconds`."""
    if not self._several:
      return
    if self._coordinator.key_value_increment(f"{self._place}, processes", 1) == jax.process_count():
      self._coordinator.key_value_set(self._place, "null")
    failure = json.loads(self._coordinator.blocking_key_value_get(self._place, int(1000 * seconds)))
    if failure:
      self._several = False  # all know
      raise (OSError if failure["of_system"] else RuntimeError)(failure["text"])
    self._places += 1

  def fail(self, error):
    """Lets the others know that this process has failed and will not arrive."""
    if self._several:
      failure = dict(of_system=isinstance(error, OSError), text=f"process {jax.process_index()}: {reason(error, 1000)}")
      with contextlib.suppress(jax.errors.JaxRuntimeError):  # the coordinator has gone
        self._coordinator.key_value_set(self._place, json.dumps(failure), allow_overwrite=True)


def end_together() -> bool:
  """Whether all processes got a signal and are about to end; then their connection is closed, as JAX stops processes
  that miss the first one. Otherwise they have to agree on it between two steps."""
  if jax.process_count() > 1:
    try:
      wait_for_all("all end", _PARTING)
    except jax.errors.JaxRuntimeError:
      return False
    jax.distributed.shutdown()
  return True


class Agreement:
  """Decisions of all processes between two steps, exchanged every few seconds, at the same steps in all."""

  def __init__(self):
    self._left, self._count, self._asked = 1, 0, None

  def largest(self, *numbers) -> tuple:
    """The largest value of each of these whole numbers in any process, the same in all; 0 after steps without exchange.

    Every process has to call it after every step.
    """
    if jax.process_count() == 1:
      return numbers
    self._left -= 1
    self._count += 1
    if self._left:
      return (0,) * len(numbers)
    now, steps = time.monotonic(), 1
    if self._asked is not None:
      steps = int(np.clip(_ASKING * self._count / max(now - self._asked, 1e-6), 1, 1000))
    maxima = multihost_utils.process_allgather(np.array([*numbers, -steps], np.int32)).max(axis=0).tolist()
    self._left, self._count, self._asked = -maxima[-1], 0, now
    return tuple(maxima[:-1])


def compile_together(compile_for, *args):
  """Calls a function that compiles for these arguments in every process, before any of them runs what it compiled.

  CPU processes connect at their first sum over devices and wait 30 seconds at most (Gloo): a process that compiles
  longer would find the others gone.
  """
  if jax.process_count() > 1:
    compile_for(*args)
    wait_for_all("the step is compiled")
