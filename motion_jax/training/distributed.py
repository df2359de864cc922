"""Several processes as one run: who takes part, and who of them writes.

Each process starts the same command. They find one another by the address of the first, which a flag names or the
cluster does (Slurm, Open MPI, TPU pods), and then see the devices of all.
"""
import contextlib
import functools
import os

import jax
import numpy as np
from jax.experimental import multihost_utils

from motion_jax.inputs.errors import InputError

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
  try:
    jax.distributed.initialize(**named)
  except (RuntimeError, ValueError) as error:
    raise InputError(f"the processes of this run did not find one another ({error}); check that all run the same "
                     "command and that the first one's address is reached from each") from error


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
def one_speaks():
  """In the block what is printed by other processes than the first is dropped; their errors are not."""
  if is_first():
    yield
    return
  with open(os.devnull, "w") as nowhere, contextlib.redirect_stdout(nowhere):
    yield


def wait_for_all(name):
  """Returns when every process has come to the place of this name."""
  if jax.process_count() > 1:
    multihost_utils.sync_global_devices(name)
