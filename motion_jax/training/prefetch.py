"""Batches made ahead of the steps that take them, and put on the devices, in a background thread."""
import os
import queue
import sys
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

from motion_jax.utils.errors import InputError
from motion_jax.utils.install import pip_install


class Prefetch:
  """make(step) for step = first, first + 1, ... in order, up to `depth` of them ahead; `with` ends its thread.

  `take()` returns the next one, or raises what make raised; `waited` counts the seconds spent waiting in it. As make is
  a function of the step, results are the same as without a thread.
  """

  def __init__(self, make: Callable[[int], Any], first: int, last: int, depth: int = 2):
    """Steps first <= step < last."""
    self.waited = 0.0
    self._made: queue.Queue = queue.Queue(depth)
    self._ended = threading.Event()
    self._thread = threading.Thread(target=self._run, args=(make, first, last), name="batches", daemon=True)

  def _run(self, make, first, last):
    for step in range(first, last):
      try:
        entry = make(step), None
      except BaseException as error:  # raised again where the batch is taken
        entry = None, error
      while not self._ended.is_set():
        try:
          self._made.put(entry, timeout=0.1)
          break
        except queue.Full:
          continue
      if self._ended.is_set() or entry[1] is not None:
        return

  def __enter__(self):
    self._thread.start()
    return self

  def take(self) -> Any:
    """The next batch. Raises what make raised, and RuntimeError after the last step."""
    began = time.perf_counter()
    while True:
      try:
        batch, error = self._made.get(timeout=1)
        break
      except queue.Empty:
        if not self._thread.is_alive() and self._made.empty():
          raise RuntimeError("no batch is left: the thread that makes them has ended") from None
    self.waited += time.perf_counter() - began
    if error is not None:
      raise error
    return batch

  def __exit__(self, *_):
    self._ended.set()
    self._thread.join(timeout=10)


class Batches:
  """The batches of a run, made ahead of its steps and placed on the devices.

  next_batch(number) -> batch; place(batch) -> batch on the devices; num_workers: number of processes that make batches
  (`in_processes`), 0 for a thread of this one.
  """

  def __init__(self, next_batch: Callable[[int], Any], place: Callable[[Any], Any], num_steps: int,
               num_workers: int = 0):
    self._next_batch, self._place, self._num_steps, self._num_workers = next_batch, place, num_steps, num_workers
    self._batches: Prefetch | None = None
    self._waited = 0.0

  @property
  def waited(self) -> float:
    """Seconds that steps have waited for a batch since the run began."""
    return self._waited + (self._batches.waited if self._batches else 0.0)

  def begin(self, step: int, number: int):
    """Makes the batch of `step` the next one, which has this number; the others follow in order."""
    self.close()
    shift, last = number - step, self._num_steps
    if self._num_workers:
      batches = in_processes(self._next_batch, number, last + shift, self._num_workers)
      make = lambda _: self._place(next(batches))
    else:
      make = lambda step: self._place(self._next_batch(step + shift))
    self._batches = Prefetch(make, step, last).__enter__()

  def take(self) -> Any:
    """The next batch; raises what making it raised."""
    return self._batches.take()

  def close(self):
    if self._batches is not None:
      self._batches.__exit__()
      self._waited, self._batches = self.waited, None


def in_processes(make: Callable[[int], Any], first: int, last: int, num_workers: int) -> Iterator[Any]:
  """make(step) for first <= step < last, in order, computed in other processes: the same arrays as make here.

  For batches that take longer to make than a step, such as text to encode or features to read from files. Grain
  distributes the steps and collects the batches; it pickles make for the processes, which use no accelerator. Raises
  InputError without the extra `data`.
  """
  try:
    import grain
  except ImportError as error:
    raise InputError(f"train.workers are Grain's: {pip_install('data')}, or set train.workers=0") from error
  from absl import flags
  flags.FLAGS.mark_as_parsed()  # Grain reads some of them
  steps = grain.MapDataset.range(first, last).map(make)
  reading = grain.ReadOptions(num_threads=1, prefetch_buffer_size=2)
  # No array is large enough for shared memory, so batches come through pipes and nothing stays in /dev/shm when the
  # program ends.
  piped = grain.experimental.DatasetOptions(min_shm_size=sys.maxsize)
  steps = grain.experimental.WithOptionsIterDataset(steps.to_iter_dataset(reading), piped)
  batches = iter(steps.mp_prefetch(grain.MultiprocessingOptions(num_workers=num_workers)))
  before = os.environ.get("JAX_PLATFORMS")
  os.environ["JAX_PLATFORMS"] = "cpu"  # for the new processes, which start with the first batch; here JAX runs already
  try:
    for step in range(first, last):
      yield next(batches)
      if step == first:
        _restore(before)
  finally:
    batches.close()
    _restore(before)


def _restore(platforms):
  if platforms is None:
    os.environ.pop("JAX_PLATFORMS", None)
  else:
    os.environ["JAX_PLATFORMS"] = platforms
