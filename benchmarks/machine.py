"""Which machine a measurement ran on, and how much of it other work used in the meantime."""
import contextlib
import dataclasses
import datetime
import os
import pathlib
import platform
import resource
import subprocess
import time

QUIET = 0.2  # cores that other work may use beside a measurement on a quiet machine


@dataclasses.dataclass
class Cost:
  """Seconds on the clock and of processors that a `cost` block took, and the mean number of cores that others used."""
  wall: float = 0.0
  processor: float = 0.0
  others: float | None = None


def describe() -> dict:
  """The machine in words, without loading JAX: processor, cores, memory, Python."""
  info = pathlib.Path("/proc/cpuinfo")
  names = [line.partition(":")[2].strip() for line in (info.read_text().splitlines() if info.exists() else ())
           if line.startswith("model name")]
  memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2 ** 30 if hasattr(os, "sysconf") else None
  return dict(processor=names[0] if names else platform.processor() or platform.machine(), cores=os.cpu_count(),
              memory_gib=memory and round(memory, 1), python=platform.python_version())


def today() -> str:
  return datetime.date.today().isoformat()


def words(about: dict) -> str:
  """The line that stands over a table: `describe`'s dict as text."""
  return ", ".join([f"{about['cores']} cores of {about['processor']}",
                    *([f"{about['memory_gib']:.0f} GiB"] if about.get("memory_gib") else []),
                    f"Python {about['python']}"])


@contextlib.contextmanager
def cost():
  """Measures a block: yields a Cost that is filled in when the block ends.

  processor counts this process and its children that have ended; others is None where /proc/stat is missing.
  """
  found, start, own, busy = Cost(), time.perf_counter(), _own_seconds(), _busy_seconds()
  try:
    yield found
  finally:
    found.wall, found.processor = time.perf_counter() - start, _own_seconds() - own
    if busy is not None:
      found.others = max(0.0, (_busy_seconds() - busy - found.processor) / max(found.wall, 1e-9))


def load(seconds=1.0) -> float | None:
  """Cores that other work uses now, over some seconds of waiting."""
  with cost() as found:
    time.sleep(seconds)
  return found.others


def mark(others: float | None) -> str:
  """"" for a measurement on a quiet machine, otherwise a remark for its row."""
  return f"shared: others used {others:.1f} cores" if others is not None and others > QUIET else ""


def _own_seconds():
  return sum(used.ru_utime + used.ru_stime for used in map(
      resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)))


def _busy_seconds():
  try:
    fields = pathlib.Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]
  except OSError:
    return None
  user, nice, system, _, _, irq, softirq, steal = map(int, fields)
  return (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")


def commit(checkout: pathlib.Path) -> str:
  """The commit of a checkout, with "-dirty" where files differ from it."""
  ran = subprocess.run(["git", "-C", checkout, "describe", "--always", "--dirty"], capture_output=True, text=True)
  return ran.stdout.strip() or "unknown"


class Memory:
  """The largest memory that this process held since `__init__`, beyond what it held then: `peak_mb`, None elsewhere
  than on Linux."""

  def __init__(self):
    self._at_first = self._status("VmRSS")
    with contextlib.suppress(OSError):
      pathlib.Path("/proc/self/clear_refs").write_text("5")  # the peak begins again from what is held now

  def peak_mb(self) -> float | None:
    peak = self._status("VmHWM")
    return None if peak is None or self._at_first is None else peak - self._at_first

  def held_mb(self) -> float | None:
    return self._status("VmRSS")

  @staticmethod
  def _status(name):
    try:
      lines = pathlib.Path("/proc/self/status").read_text().splitlines()
    except OSError:
      return None
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith(f"{name}:")), None)
