"""How XLA compiles the programs of training: quickly where they run briefly, for speed where they run for hours.

On CPUs most of the compiler's time goes into optimizing loops over numbers. The initial state is computed once, and the
step of a network with few parameters takes milliseconds in any case: both are compiled without that.
"""
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

SMALL = 100_000  # parameters; by size and not by the length of a run, so that a resumed run has the same program

# Loops as they are written, and kernels by XLA's older and faster emitter.
_QUICK = {"xla_backend_optimization_level": 0, "xla_cpu_use_fusion_emitters": False}


@functools.cache
def quick_options() -> dict[str, Any]:
  """XLA's options for programs that run briefly, on CPUs; without those that this version does not have."""
  if jax.default_backend() != "cpu":
    return {}
  options = {}
  for name, value in _QUICK.items():
    try:
      jax.jit(lambda: jnp.int32(0)).lower().compile(compiler_options={name: value})
    except jax.errors.JaxRuntimeError:
      continue
    options[name] = value
  return options


class Step:
  """A mapped training step, for any shapes of its arguments; quick: compiled by `quick_options`."""

  def __init__(self, function: Callable, quick: bool):
    self._function, self._quick, self._programs = function, quick and bool(quick_options()), {}

  def lower(self, *args):
    return self._function.lower(*args)

  def compile(self, *args) -> Callable:
    """The program for arguments of these shapes and dtypes."""
    if not self._quick:
      return self.lower(*args).compile()
    leaves, tree = jax.tree.flatten(args)
    key = tree, tuple((jnp.shape(leaf), jnp.result_type(leaf)) for leaf in leaves)
    if key not in self._programs:
      self._programs[key] = self.lower(*args).compile(compiler_options=quick_options())
    return self._programs[key]

  def __call__(self, *args):
    return (self.compile(*args) if self._quick else self._function)(*args)


def is_small(params: Any) -> bool:
  """Whether a network has so few parameters that its step is compiled quickly."""
  return sum(leaf.size for leaf in jax.tree.leaves(params)) < SMALL
