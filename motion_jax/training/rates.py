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


def memory_mb() -> float:
  """The most memory used: of the fullest accelerator here, or of this process where devices do not tell."""
  told = [(device.memory_stats() or {}).get("peak_bytes_in_use") for device in jax.local_devices()]
  if any(told):
    return max(filter(None, told)) / 1e6
  return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


class Rates:
  """Numbers of the steps since the last row; `schedule(step)` is the learning rate, flops what a step computes."""

  def __init__(self, batch_size, schedule, flops=None):
    self._batch_size, self._schedule = batch_size, schedule
    self._flops, self._peak = flops, peak_flops()
    self._since = self._waited = self._steps = None

  def restart(self, waited=0.0):
    """Time counts from now on: what came before, such as compiling, a save or an evaluation, is no step's."""
    self._since, self._waited, self._steps = time.perf_counter(), waited, 0

  def step(self):
    self._steps += 1

  def row(self, step, waited) -> dict[str, float]:
    """Of the steps since the last row or restart, up to `step`; waited: seconds for data since the run began."""
    row = {"learning_rate": float(self._schedule(step - 1)), "memory_mb": round(memory_mb(), 1)}
    seconds = time.perf_counter() - self._since
    if self._steps and seconds > 0:
      rate = self._steps / seconds
      row |= {"samples_per_second": rate * self._batch_size, "data_wait": min((waited - self._waited) / seconds, 1.0)}
      if self._flops and self._peak:
        row["mfu"] = rate * self._flops / self._peak
    self.restart(waited)
    return row
