"""What a run says while it trains: on a terminal a bar, elsewhere lines; loss, samples a second, time left."""
import sys
import threading
import time

from tqdm import tqdm


class Progress:
  """A bar on a terminal (where stderr is one), otherwise a line often at first and then once a minute.

  Both say step, loss, samples a second and the time left, the bar also MFU, where it is known, and held-out numbers.
  """

  def __init__(self, first, num_steps, batch_size):
    self.first, self.num_steps, self.batch_size = first, num_steps, batch_size
    self.began = self.told = time.monotonic()
    self.warm = None  # when the first step was done, which waits for the compiler
    self.bar = tqdm(total=num_steps, initial=first, unit="step", dynamic_ncols=True, disable=None)
    self._numbers = {}  # what rows of metrics say, for the bar
    self._patience = threading.Event()
    if first < num_steps:
      threading.Thread(target=self._wait, daemon=True).start()

  def _wait(self, every=5):
    """Says every few seconds that the first step is being compiled, until it is done."""
    while not self._patience.wait(every):
      tqdm.write(f"step {self.first} of {self.num_steps}: compiling the first step, "
                 f"{time.monotonic() - self.began:.0f} s so far")
      sys.stdout.flush()

  def close(self):
    self._patience.set()
    self.bar.close()

  def seen(self, row):
    """A row of metrics, whose MFU and held-out numbers the bar shows from now on."""
    self._numbers |= {name: f"{value:.4g}" for name, value in row.items() if name.startswith(("held_out", "r1"))}
    if "mfu" in row:
      self._numbers["MFU"] = f"{100 * row['mfu']:.1f}%"

  def step(self, step, metrics):
    """Tells that a step was taken, if nothing was said just now; a step may be an earlier one, after a rollback."""
    if not self.bar.disable:
      self.bar.update(step - self.bar.n)
    line = self.line(step, metrics)
    if line and (self.bar.disable or step == self.first + 1):
      tqdm.write(line)
      sys.stdout.flush()

  def line(self, step, metrics) -> str | None:
    """What to say after this step, or None where something was said just now."""
    now, done = time.monotonic(), step - self.first
    often = 5 if now - self.began < 60 or not self.bar.disable else 60
    if done > 2 and now - self.told < often and step < self.num_steps:
      return None
    loss = float(metrics["loss"])  # waits until the step is done
    said = f"step {step} of {self.num_steps}: loss {loss:.4g}"
    now = self.told = time.monotonic()
    if self.warm is None:
      self._patience.set()
      self.warm = now
      return f"{said}, the first step took {now - self.began:.0f} s, most of it for the compiler"
    rate = max(done - 1, 1) / max(now - self.warm, 1e-6)
    if not self.bar.disable:
      terms = {name: f"{float(metrics[name]):.4g}" for name in ("loss", "mse") if name in metrics}
      self.bar.set_postfix(terms | {"samples/s": f"{rate * self.batch_size:.1f}"} | self._numbers)
    return f"{said}, {rate * self.batch_size:.1f} samples/s, {duration((self.num_steps - step) / rate)} left"


def duration(seconds) -> str:
  """12 s, 3 min, 2 h 05 min."""
  minutes = round(seconds / 60)
  if seconds < 90:
    return f"{seconds:.0f} s"
  return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
