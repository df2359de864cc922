"""Where the tests keep compiled programs: a folder for each version of jax and jaxlib and each set of flags.

Compiling is most of what these tests do, so what one test has compiled no other worker compiles again, nor the next
run. `JAX_COMPILATION_CACHE_DIR` names another folder; XDG_CACHE_HOME=$(mktemp -d) makes a cold run. A home that cannot
be written to is no obstacle: the programs are then kept for this run only.
"""
import atexit
import hashlib
import importlib.metadata
import os
import pathlib
import shutil
import tempfile

KEPT = 1_000_000_000  # bytes, of all versions of jax together; programs unused for longest go first
WHERE = "MOTION_JAX_TESTS_PROGRAMS"  # variable with the words of the summary


def _home():
  return pathlib.Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "motion_jax", "tests")


def choose_folder():
  """Names the folder to JAX, before it is imported, and to the processes that start from here; a folder that
  JAX_COMPILATION_CACHE_DIR names already stays."""
  if "JAX_COMPILATION_CACHE_DIR" in os.environ:
    os.environ.setdefault(WHERE, f"in {os.environ['JAX_COMPILATION_CACHE_DIR']}")
    return
  flags = hashlib.sha256(os.environ.get("XLA_FLAGS", "").encode()).hexdigest()[:8]
  jax, jaxlib = map(importlib.metadata.version, ("jax", "jaxlib"))
  programs = _home() / f"jax-{jax}-jaxlib-{jaxlib}-{flags}"
  try:
    programs.mkdir(parents=True, exist_ok=True)
    tempfile.TemporaryFile(dir=programs).close()
    size = sum(path.stat().st_size for path in programs.glob("*"))
    os.environ[WHERE] = f"in {programs}, {size / 1e6:.0f} MB at the start"
  except OSError as error:
    programs = pathlib.Path(tempfile.mkdtemp(prefix="motion_jax_tests_"))
    atexit.register(shutil.rmtree, programs, ignore_errors=True)
    os.environ[WHERE] = f"for this run only, since {_home()} cannot be written to ({error.strerror})"
  os.environ["JAX_COMPILATION_CACHE_DIR"] = str(programs)
  os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.05"
  os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"


def summary():
  """Where compiled programs are kept, one line."""
  return f"compiled programs: {os.environ[WHERE]}"


def prune():
  """Keeps the programs of all versions below KEPT bytes."""
  used = lambda path: max(path.stat().st_atime, path.stat().st_mtime)
  total = 0
  for path in sorted(_home().glob("jax-*/*"), key=used, reverse=True):
    total += path.stat().st_size
    if total > KEPT:
      path.unlink(missing_ok=True)
