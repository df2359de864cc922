"""JAX and Pillow, imported on first use, for rooms that mostly compute with numpy, which is faster than loading JAX.

Public names of packages are lazy by the library lazy_loader. Its `load` cannot serve here: it puts an unloaded "jax"
into `sys.modules`, where SciPy finds it, and the first import of SciPy loads JAX after all (1.4 processor seconds).
"""
import importlib
import sys
from typing import TYPE_CHECKING, Any, TypeGuard

__all__ = ["LazyModule", "is_jax", "jax", "jnp"]


class LazyModule:
  """A module that is imported when one of its names is first used: `Image = LazyModule("PIL.Image")`."""

  def __init__(self, name: str) -> None:
    self._name = name

  def __getattr__(self, attribute: str) -> Any:
    value = getattr(importlib.import_module(self._name), attribute)
    setattr(self, attribute, value)
    return value


if TYPE_CHECKING:
  import jax
  import jax.numpy as jnp
else:
  jax, jnp = LazyModule("jax"), LazyModule("jax.numpy")


def is_jax(x: Any) -> "TypeGuard[jax.Array]":
  """Whether x is an array or a tracer of JAX; loads no JAX."""
  loaded = sys.modules.get("jax")
  return loaded is not None and isinstance(x, loaded.Array)
