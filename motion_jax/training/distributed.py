"""Several processes as one run: who takes part, and who of them writes.

Each process starts the same command. They find one another by the address of the first, which a flag names or the
cluster does (Slurm, Open MPI, TPU pods), and then see the devices of all.
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

_PATIENCE = 3600  # seconds for which processes wait for one that reads data, compiles or evaluates
_PARTING = 10     # seconds for which a process that has failed, or is told to end, waits for the others to end with it
_ASKING = 5       # seconds between the steps at which processes ask one another
_failed = False

_CLUSTERS = {  # environment variables that say how many processes there are, and those that JAX reads beside them
    "SLURM_NTASKS": ("SLURM_JOB_ID", "SLURM_STEP_NODELIST", "SLURM_PROCID", "SLURM_LOCALID"),
    "OMPI_COMM_WORLD_SIZE": ("OMPI_MCA_orte_hnp_uri", "OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_LOCAL_RANK"),
}


def start(coordinator=None, process_id=None, num_processes=None, simulate_devices=0):
  """Joins this process with the others of its run, if there are any; before anything else of JAX.

  coordinator: HOST:PORT of process 0, with process_id and num_processes; "auto": JAX finds all three, or fails. Without
  any of them a cluster is looked for in the environment. simulate_devices: so many CPU devices in this process.
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
  jax.config.update("jax_enable_preemption_service", False)  # it would take SIGTERM, which `stopping.Stop` is to hear
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
  """Before JAX's own end of a process, which waits for all the others: what has failed does not, as they may be waiting
  for it inside of a sum over devices, forever."""
  if _failed:
    try:
      wait_for_all("the processes have failed", _PARTING)
    except jax.errors.JaxRuntimeError:
      sys.stdout.flush()
      sys.stderr.flush()
      os._exit(exit_status.FAILED)


def in_cluster() -> bool:
  """Whether the environment is that of one of several processes, started by a cluster that JAX knows."""
  environment = os.environ
  for count, others in _CLUSTERS.items():
    if environment.get(count, "1") != "1" and all(name in environment for name in others):
      return True
  return "," in environment.get("TPU_PROCESS_ADDRESSES", environment.get("TPU_WORKER_HOSTNAMES", ""))


def is_first() -> bool:
  """Whether this process is the one that writes metrics, weights and pictures, and prints."""
  return not jax.distributed.is_initialized() or jax.process_index() == 0


def by_first(function):
  """The function, which writes something, for the first process; in others it does nothing."""
  @functools.wraps(function)
  def written(*args, **named):
    return function(*args, **named) if is_first() else None

  return written


def on_host(tree):
  """Arrays of the host, the same in every process, of arrays that lie on the devices of all, in parts or whole.

  Every process calls it, in the same place.
  """
  local = lambda leaf: not isinstance(leaf, jax.Array) or leaf.is_fully_addressable or leaf.is_fully_replicated
  return jax.tree.map(lambda leaf: np.asarray(leaf) if local(leaf)
                      else multihost_utils.process_allgather(leaf, tiled=True), tree)


@contextlib.contextmanager
def as_one():
  """In the block what is printed by other processes than the first is dropped; their errors are not. A process that an
  error ends in it ends for the others, too, which JAX stops when they miss it."""
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
  """Returns when every process has come to the place of this name; any thread may ask.

  Not the devices meet, as in `multihost_utils.sync_global_devices`, but the processes by their coordinator: nobody is
  missed before its time. Raises JaxRuntimeError after so many seconds, or when a process has gone.
  """
  if jax.process_count() > 1:
    from orbax.checkpoint import multihost  # here: who only uses a model need not wait for it
    multihost.get_barrier_sync_fn()(key=name, timeout_ms=int(1000 * seconds))


class Meeting:
  """A row of places at which processes wait for one another while they do something that may fail in any of them: then
  the others do not wait on, but fail too, and say why.

  Every process makes its own and comes to the same places in the same order; any thread may use it. They meet by their
  coordinator: a place is a word there, which the last to come says, or one that will never come.
  """
  _numbers = itertools.count()

  def __init__(self):
    self._name, self._several, self._places = f"meeting {next(self._numbers)}", jax.process_count() > 1, 0
    if self._several:
      from orbax.checkpoint import multihost  # here: who only uses a model need not wait for it
      self._coordinator = multihost.get_jax_distributed_client()

  @property
  def _place(self):
    return f"{self._name}, place {self._places}"

  def wait(self, seconds=_PATIENCE):
    """Returns when every process is at this place. Where one has failed it raises an OSError if that did, and else a
    RuntimeError; JaxRuntimeError after so many seconds."""
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
    """This process comes to no further place."""
    if self._several:
      failure = dict(of_system=isinstance(error, OSError), text=f"process {jax.process_index()}: {reason(error, 1000)}")
      with contextlib.suppress(jax.errors.JaxRuntimeError):  # the coordinator has gone
        self._coordinator.key_value_set(self._place, json.dumps(failure), allow_overwrite=True)


def end_together() -> bool:
  """Whether all processes have been told to end, and are about to: then their connection is closed, as JAX stops those
  which miss the first. If not, they have to agree on it between two steps."""
  if jax.process_count() > 1:
    try:
      wait_for_all("all are told to end", _PARTING)
    except jax.errors.JaxRuntimeError:
      return False
    jax.distributed.shutdown()
  return True


class Agreement:
  """What processes decide together between two steps: they ask one another every few seconds, all at the same steps."""

  def __init__(self):
    self._left, self._count, self._asked = 1, 0, None

  def largest(self, *numbers) -> tuple:
    """The largest of each of these whole numbers in any process, the same in all; 0 after steps at which nobody asks.

    Every process calls it after every step.
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
    found = multihost_utils.process_allgather(np.array([*numbers, -steps], np.int32)).max(axis=0).tolist()
    self._left, self._count, self._asked = -found[-1], 0, now
    return tuple(found[:-1])


def compile_together(function, *args):
  """Compiles a jitted function for these arguments in every process, before any of them calls it.

  CPUs find one another when they first sum over a group of devices, and no longer than 30 seconds (Gloo): one process
  that compiled longer would find the others gone.
  """
  if jax.process_count() > 1:
    function.lower(*args).compile()
    wait_for_all("the step is compiled")
