"""Functions mapped over many items by several processes, with the results in order and equal to those of one."""
import concurrent.futures
import contextlib
import multiprocessing
import os
from collections.abc import Callable, Iterable, Iterator
from typing import Any


class Workers:
  """map(function, items) -> an iterator of the results in order, as the builtin; see `workers`."""

  def __init__(self, pool: concurrent.futures.ProcessPoolExecutor | None = None):
    self._pool = pool

  def map(self, function: Callable, items: Iterable[Any], chunk: int = 1) -> Iterator[Any]:
    """function: of a module, or a functools.partial of one. chunk: number of items that a process takes at a time."""
    return map(function, items) if self._pool is None else self._pool.map(function, items, chunksize=chunk)


@contextlib.contextmanager
def workers(count: int) -> Iterator[Workers]:
  """Yields `Workers` of `count` processes, which start with the first map and end with the block; below 2 there is no
  process but this one.

  The processes import the program's main module, so a script that uses them keeps its own work below
  `if __name__ == "__main__"`. They use no accelerator.
  """
  if count < 2:
    yield Workers()
    return
  with on_cpu(), concurrent.futures.ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as pool:
    yield Workers(pool)


@contextlib.contextmanager
def on_cpu():
  """Processes that begin inside the block use no accelerator; JAX in this process must run already to be unaffected."""
  changed = {"JAX_PLATFORMS": "cpu", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
             "PYTHONSAFEPATH": "1"}  # nor does a file of the current folder stand for a module of Python's
  before = {name: os.environ.get(name) for name in changed}
  os.environ.update(changed)
  try:
    yield
  finally:
    for name, value in before.items():
      if value is None:
        del os.environ[name]
      else:
        os.environ[name] = value
