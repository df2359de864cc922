"""What several tests share: a tiny trained run, made once."""
import atexit
import gc
import importlib.util
import os
import pathlib
import shutil
import signal
import tempfile

import pytest

# Compiling is most of what these tests do; without the compiler's late optimizations it takes half the time, and
# numbers differ by rounding only. Has to be said before jax is imported.
os.environ["XLA_FLAGS"] = (os.environ.get("XLA_FLAGS", "") + " --xla_backend_optimization_level=0"
                           " --xla_llvm_disable_expensive_passes=true").strip()

# What one test has compiled no other compiles again, nor another worker of xdist, which inherits these variables.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
  os.environ["JAX_COMPILATION_CACHE_DIR"] = tempfile.mkdtemp(prefix="motion_jax_tests_")
  os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.2"
  os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
  atexit.register(shutil.rmtree, os.environ["JAX_COMPILATION_CACHE_DIR"], ignore_errors=True)

import jax

from motion_jax import fit as training
from motion_jax.inputs import config_files
from motion_jax.runtime import cache

ROOT = pathlib.Path(__file__).parents[1]


def pytest_addoption(parser):
  parser.addoption("--torch", action="store_true",
                   help="run the tests that need torch and transformers, and no others; without this option they are "
                   "skipped where these are not installed")


def pytest_collection_modifyitems(config, items):
  """Tests marked `torch` need the extra `convert`: skipped without it, and alone in the run that is about them."""
  absent = [name for name in ("torch", "transformers") if importlib.util.find_spec(name) is None]
  wanted = config.getoption("--torch")
  if wanted and absent:
    raise pytest.UsageError(f"--torch, but {' and '.join(absent)} not installed: pip install 'motion-jax[convert]'")
  if wanted:
    config.hook.pytest_deselected(items=[item for item in items if not item.get_closest_marker("torch")])
    items[:] = [item for item in items if item.get_closest_marker("torch")]
  elif absent:
    for item in items:
      if item.get_closest_marker("torch"):
        item.add_marker(pytest.mark.skip(reason="needs torch and transformers; .ci/run runs it where they are"))


def load_config(name, size):
  """configs/NAME.py's config of a size, as `motion-jax train` reads it."""
  return config_files.load(f"{name}:{size}")


def devices_env(count):
  """Environment of a process that sees `count` CPU devices, and imports from this checkout."""
  flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count={count}"
  return os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)}


@pytest.fixture(autouse=True)
def no_cache_folder(monkeypatch):
  """What a test of the command line keeps on disk ends with it."""
  monkeypatch.setattr(cache, "_folder", None)


@pytest.fixture(autouse=True, scope="session")
def signals_are_heard():
  """A shell's background job ignores Ctrl-C, one of nohup hangups, and so would the programs that tests start."""
  ignored = {number for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
             if signal.getsignal(number) == signal.SIG_IGN}
  for number in ignored:
    signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
  yield
  for number in ignored:
    signal.signal(number, signal.SIG_IGN)


@pytest.fixture(autouse=True, scope="module")
def few_maps():
  """Compiled functions stay in memory, each with pieces of its own, of which Linux allows a process 65,530: a worker
  that ran all tests would die of it, and hold 8 GB before."""
  yield
  maps = pathlib.Path("/proc/self/maps")
  if maps.is_file() and maps.read_bytes().count(b"\n") > 8_000:
    jax.clear_caches()
    gc.collect()


@pytest.fixture(scope="session")
def tiny_run(tmp_path_factory):
  """The run folder of configs/cmdm_denoiser.py:tiny after its two steps."""
  folder = tmp_path_factory.mktemp("runs") / "denoiser"
  training.run(load_config("cmdm_denoiser", "tiny"), folder)
  return folder


@pytest.fixture
def unjudged(monkeypatch):
  """Where a test proves that a config trains: compiling its evaluation as well would double the time."""
  for stage, recipe in training.RECIPES.items():
    monkeypatch.setitem(training.RECIPES, stage, lambda config, recipe=recipe: recipe(config)._replace(evaluate=None))
