"""Batches made ahead of the steps that take them, and put on the devices, by a thread of their own."""
import queue
import threading
import time
from collections.abc import Callable
from typing import Any


class Prefetch:
  """make(step) for step = first, first + 1, ... in that order, up to `depth` of them ahead; `with` ends its thread.

  `take()` gives the next one, whatever make raised is raised there, and `waited` are the seconds for which takers
  had to wait. What is made is the same as without it: make is a function of the step.
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
        made = make(step), None
      except BaseException as error:  # raised again where the batch is taken
        made = None, error
      while not self._ended.is_set():
        try:
          self._made.put(made, timeout=0.1)
          break
        except queue.Full:
          continue
      if self._ended.is_set() or made[1] is not None:
        return

  def __enter__(self):
    self._thread.start()
    return self

  def take(self) -> Any:
    """The next batch. Raises what make raised, and RuntimeError behind the last step."""
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
