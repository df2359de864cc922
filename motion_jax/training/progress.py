"""What a run says while it trains: step, loss, samples a second, time left."""
import threading
import time


class Progress:
  """A line about a run, often at first and then once a minute: step, loss, samples a second, time left."""

  def __init__(self, first, num_steps, batch_size):
    self.first, self.num_steps, self.batch_size = first, num_steps, batch_size
    self.began = self.told = time.monotonic()
    self.warm = None  # when the first step was done, which waits for the compiler
    self._patience = threading.Event()
    if first < num_steps:
      threading.Thread(target=self._wait, daemon=True).start()

  def _wait(self, every=5):
    """Says every few seconds that the first step is being compiled, until it is done."""
    while not self._patience.wait(every):
      print(f"step {self.first} of {self.num_steps}: compiling the first step, "
            f"{time.monotonic() - self.began:.0f} s so far", flush=True)

  def close(self):
    self._patience.set()

  def line(self, step, metrics) -> str | None:
    """What to say after this step, or None where something was said just now."""
    now, done = time.monotonic(), step - self.first
    often = 5 if now - self.began < 60 else 60
    if done > 2 and now - self.told < often and step < self.num_steps:
      return None
    said = f"step {step} of {self.num_steps}: loss {float(metrics['loss']):.4g}"  # waits until the step is done
    now = self.told = time.monotonic()
    if self.warm is None:
      self.close()
      self.warm = now
      return f"{said}, the first step took {now - self.began:.0f} s, most of it for the compiler"
    rate = max(done - 1, 1) / max(now - self.warm, 1e-6)
    return f"{said}, {rate * self.batch_size:.1f} samples/s, {duration((self.num_steps - step) / rate)} left"


def duration(seconds) -> str:
  """12 s, 3 min, 2 h 05 min."""
  minutes = round(seconds / 60)
  if seconds < 90:
    return f"{seconds:.0f} s"
  return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
