"""Wall and processor seconds of a command's named parts, for `--timings`."""
import contextlib
import time

parts: dict[str, list[float]] | None = None  # {name: [wall seconds, processor seconds]}, or nothing is measured


def start():
  """From now on parts are measured."""
  global parts
  parts = {}


@contextlib.contextmanager
def part(name):
  """Measures the block; times of one name add up, and those of a nested part are not counted in the outer one."""
  if parts is None:
    yield
    return
  wall, cpu, inner = time.perf_counter(), time.process_time(), _total()
  try:
    yield
  finally:
    within = [now - before for now, before in zip(_total(), inner)]
    took = parts.setdefault(name, [0.0, 0.0])
    took[0] += time.perf_counter() - wall - within[0]
    took[1] += time.process_time() - cpu - within[1]


def _total():
  return [sum(took[i] for took in parts.values()) for i in (0, 1)]


def report() -> str:
  """One line: each part with its wall seconds, and in brackets those of the processors."""
  lines = [f"{name} {wall:.2f} ({cpu:.2f})" for name, (wall, cpu) in parts.items()]
  return "seconds, wall (processors): " + ", ".join([*lines, "in all {:.2f} ({:.2f})".format(*_total())])
