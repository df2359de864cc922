"""How fast a run is: samples a second, the share of time that steps wait for data, memory, learning rate, MFU."""
import resource
import sys
import time

import jax

# Dense bfloat16 products, TFLOP/s, by the beginning of a device's name; NVIDIA's and Google's data sheets.
PEAKS = {"NVIDIA B200": 2250, "NVIDIA H200": 989, "NVIDIA H100 PCIe": 756, "NVIDIA H100": 989, "NVIDIA A100": 312,
         "NVIDIA L40S": 362, "NVIDIA L4": 121, "TPU v4": 275, "TPU v5 lite": 197, "TPU v5e": 197, "TPU v5": 459,
         "TPU v6 lite": 918, "TPU v6e": 918}


def peak_flops() -> float | None:
  """FLOPs a second that all devices reach by their data sheets, in bfloat16; None where they are not known."""
  name = jax.devices()[0].device_kind
  known = next((rate for beginning, rate in PEAKS.items() if name.startswith(beginning)), None)
  return known and known * 1e12 * jax.device_count()


def flops_of(train_step, *args) -> float | None:
  """XLA's count of the FLOPs of a compiled step, on all devices; None where no peak is known to compare it with, or it
  is not told."""
  if peak_flops() is None:
    return None
  cost = train_step.lower(*args).cost_analysis()  # of one device's rows
  return (cost or {}).get("flops", 0.0) * jax.device_count() or None


def memory_mb() -> float:
  """The most memory used: of the fullest accelerator here, or of this process where devices do not tell."""
  told = [(device.memory_stats() or {}).get("peak_bytes_in_use") for device in jax.local_devices()]
  if any(told):
    return max(filter(None, told)) / 1e6
  return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


class Rates:
  """Numbers of the steps since the last row; `schedule(step)` is the learning rate, flops what a step computes.

  Time counts between the ends of steps: what lies between a `restart` and the step after it, such as compiling, a save
  or an evaluation, is no step's.
  """

  def __init__(self, batch_size, schedule, flops=None):
    self._batch_size, self._schedule = batch_size, schedule
    self._flops, self._peak = flops, peak_flops()
    self._last, self._seconds, self._waited, self._steps = None, 0.0, 0.0, 0

  def restart(self):
    """The next step's time is left out."""
    self._last = None

  def step(self, waited):
    """A step has ended; waited: seconds for which steps have waited for data since the run began."""
    now = time.perf_counter(), waited
    if self._last is not None:
      self._seconds += now[0] - self._last[0]
      self._waited += now[1] - self._last[1]
      self._steps += 1
    self._last = now

  def row(self, step) -> dict[str, float]:
    """Of the steps since the last row, up to `step`, whose results are there: they are computed while others begin."""
    if self._last is not None:
      now = time.perf_counter()
      self._seconds += now - self._last[0]
      self._last = now, self._last[1]
    row = {"learning_rate": float(self._schedule(step - 1)), "memory_mb": round(memory_mb(), 1)}
    if self._steps and self._seconds > 0:
      rate = self._steps / self._seconds
      row |= {"samples_per_second": rate * self._batch_size, "data_wait": min(self._waited / self._seconds, 1.0)}
      if self._flops and self._peak:
        row["mfu"] = rate * self._flops / self._peak
    self._seconds, self._waited, self._steps = 0.0, 0.0, 0
    return row
