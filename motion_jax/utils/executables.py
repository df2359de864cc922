"""Compiled programs as bytes: what a second process loads instead of tracing, lowering and compiling a function again.

A stored program is a JSON header, which says what the outputs are, and the executable as XLA serializes it. It belongs
to one machine and one version of everything: `machine` is part of its key. Where this version of jax or the device
cannot serialize, or arguments are spread over several devices, `can_store` is false.

This is our own code because `jax.experimental.serialize_executable` unpickles what it loads, which a file in a cache
folder must not be able to use. The names of jaxlib below are those that it uses; a test names the versions that have
them.
"""
import contextlib
import functools
import hashlib
import importlib
import json
import os
import platform
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from motion_jax.utils.lazy import jax, jnp

# Settings by which jax checks or replaces each call; a stored program would ignore them.
_CHECKS = ("jax_debug_nans", "jax_debug_infs", "jax_disable_jit", "jax_no_execution")

_lock = threading.Lock()
_inside: list[float] = []  # jax's setting before each thread that is in `outside_jax_cache`: the usual one first


def can_store(leaves: Sequence[Any]) -> bool:
  """Whether a program of these arguments can be stored: one process, and one device that holds all of them."""
  if jax.config.jax_default_device is not None or any(getattr(jax.config, name, False) for name in _CHECKS):
    return False
  client = jax.devices()[0].client
  if not all(hasattr(client, name) for name in ("serialize_executable", "deserialize_executable")):
    return False
  if jax.device_count() == 1:
    return True
  return jax.process_count() == 1 and all(
      leaf.devices() == {jax.devices()[0]} for leaf in leaves if isinstance(leaf, jax.Array))


@functools.cache
def machine() -> str:
  """A digest of what compiled code depends on besides versions: the device, the processor's abilities, XLA's flags."""
  device = jax.devices()[0]
  about = [device.platform, device.device_kind, device.client.platform_version, platform.machine(), platform.system(),
           os.environ.get("XLA_FLAGS", ""), str(_num_cpus()), _processor()]
  library = sys.modules[type(device.client).__module__]  # jaxlib's extension module
  if getattr(library, "__file__", None):
    stat = os.stat(library.__file__)
    about.append(f"{stat.st_size} {stat.st_mtime_ns}")  # of a build that has the version number of another
  return hashlib.sha256("\n".join(about).encode()).hexdigest()


def _num_cpus():
  return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def _processor():
  """Model and instruction sets of the first processor."""
  try:
    with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
      lines = file.read(16_384).split("\n\n")[0].splitlines()
  except OSError:
    return platform.processor()
  names = ("model name", "flags", "features", "cpu part", "cpu variant", "cpu implementer")
  return "\n".join(line for line in lines if line.lower().startswith(names))


# XLA's CPU compiler without what takes most of its time: loops around matrix products become as fast by these.
_LIGHT = {"xla_backend_optimization_level": 1, "xla_cpu_use_fusion_emitters": False}


@functools.cache
def light_options() -> dict[str, Any]:
  """Options of XLA by which programs of matrix products compile in a third of the time and run as fast, on CPUs
  (docs/lab/speed.md#programs); none on other devices, and in versions that do not have them."""
  if jax.devices()[0].platform != "cpu":
    return {}
  try:
    jax.jit(lambda: jnp.int32(0)).lower().compile(compiler_options=_LIGHT)
  except ERRORS:
    return {}
  return _LIGHT


def compile_and_store(fn: Callable, leaves: Sequence[Any], compiler_options: dict[str, Any] | None = None
                      ) -> tuple[Callable, bytes]:
  """(the compiled function of a flat list of arrays, the bytes from which `load` makes it again)."""
  kinds = [_key_kind(leaf) for leaf in leaves]
  about: dict[str, Any] = {}

  def stored_program(*arrays):  # of plain arrays alone, no keys
    results, tree = jax.tree.flatten(fn(*(array if kind is None else jax.random.wrap_key_data(array, impl=kind)
                                          for array, kind in zip(arrays, kinds))))
    about.update(tree=_describe(jax.tree.unflatten(tree, range(len(results)))),
                 keys=[_key_kind(leaf) for leaf in results])
    return [jnp.asarray(leaf, leaf.dtype) if kind is None else jax.random.key_data(leaf)
            for leaf, kind in zip(map(jnp.asarray, results), about["keys"])]

  lowered = jax.jit(stored_program, keep_unused=True).lower(*(
      leaf if kind is None else jax.random.key_data(leaf) for leaf, kind in zip(leaves, kinds)))
  with outside_jax_cache():
    executable = lowered.compile(compiler_options=compiler_options or None).runtime_executable()
  header = json.dumps(about).encode()
  payload = executable.client.serialize_executable(executable)
  return _callable(executable, about), len(header).to_bytes(4, "little") + header + payload


@contextlib.contextmanager
def outside_jax_cache():
  """Keeps programs that are compiled in the block out of jax's own cache on disk; several threads may be inside.

  An executable that jax reads from there lacks functions once it is serialized again ("Function ... not found").
  """
  name = "jax_persistent_cache_min_compile_time_secs"
  with _lock:
    _inside.append(getattr(jax.config, name))
    jax.config.update(name, 1e9)
  try:
    yield
  finally:
    with _lock:
      jax.config.update(name, _inside.pop())


def load(stored: bytes) -> Callable:
  """The function that `compile_and_store` stored. Raises one of `ERRORS` where that cannot be done."""
  from jaxlib import xla_client
  size = int.from_bytes(stored[:4], "little")
  device = jax.devices()[0]
  devices = xla_client.DeviceList((device,))
  executable = device.client.deserialize_executable(stored[4 + size:], devices, None)
  return _callable(executable, json.loads(stored[4:4 + size]))


# What jaxlib raises for bytes or arguments that it does not take, and what is missing in another version of it.
ERRORS = (RuntimeError, ValueError, TypeError, AttributeError, ImportError, LookupError, NotImplementedError)


def _callable(executable, about):
  """The function of a flat list of arrays that runs an executable."""
  tree, kinds = jax.tree.structure(_build(about["tree"])), about["keys"]
  has_keys, array = any(kinds), _array_type()

  def run(*leaves):
    arrays = [leaf if type(leaf) is array else _on_device(leaf) for leaf in leaves]
    outputs = [arrays[0] for arrays in executable.execute_sharded(arrays).disassemble_into_single_device_arrays()]
    if has_keys:
      outputs = [leaf if kind is None else jax.random.wrap_key_data(leaf, impl=kind)
                 for leaf, kind in zip(outputs, kinds)]
    return jax.tree.unflatten(tree, outputs)

  return run


@functools.cache
def _array_type():
  """The type of JAX's arrays; no constant of this file, as an import must not start the devices."""
  return type(jax.device_put(np.zeros(())))


def _on_device(leaf):
  return jax.device_put(leaf) if _key_kind(leaf) is None else jax.random.key_data(leaf)


def _key_kind(leaf):
  """The name of the generator of random keys, None of other arrays."""
  dtype = getattr(leaf, "dtype", None)
  if dtype is None or not jax.dtypes.issubdtype(dtype, jax.dtypes.prng_key):
    return None
  return str(jax.random.key_impl(leaf))


# --- trees as JSON: tuples, lists, dicts, named tuples ----------------------------------------------------------------


def _describe(node):
  if node is None or isinstance(node, int):
    return node
  if isinstance(node, dict):
    return {"dict": [[key, _describe(value)] for key, value in node.items()]}
  if isinstance(node, tuple | list):
    kind = type(node)
    name = kind.__name__ if kind in (tuple, list) else f"{kind.__module__}:{kind.__qualname__}"
    return {name: [_describe(value) for value in node]}
  raise NotImplementedError(f"got outputs in a {type(node).__name__}, expected tuples, lists, dicts and named tuples")


def _build(node):
  if not isinstance(node, dict):
    return node
  (name, values), = node.items()
  if name == "dict":
    return {key: _build(value) for key, value in values}
  values = [_build(value) for value in values]
  if name in ("tuple", "list"):
    return tuple(values) if name == "tuple" else values
  module, _, kind = name.partition(":")
  return functools.reduce(getattr, kind.split("."), importlib.import_module(module))._make(values)
