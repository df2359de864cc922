"""What several tests share: a tiny trained run, made once."""
import atexit
import gc
import importlib.util
import os
import pathlib
import shutil
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

from motion_jax import training

ROOT = pathlib.Path(__file__).parents[1]


def load_config(name, size):
  """configs/NAME.py's config of a size, as launch.py would read it."""
  spec = importlib.util.spec_from_file_location(name, ROOT / "configs" / f"{name}.py")
  module = importlib.util.module_from_spec(spec)
  spec.loader.exec_module(module)
  return module.get_config(size)


def devices_env(count):
  """Environment of a process that sees `count` CPU devices, and imports from this checkout."""
  flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count={count}"
  return os.environ | {"XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT)}


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
