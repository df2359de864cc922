"""Public names of a package, imported on first use, so that importing one component does not import the others."""
import ast
import importlib
import importlib.util
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeGuard

__all__ = ["LazyModule", "attach", "is_jax", "jax", "jnp"]


def attach(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
  """`(__getattr__, __dir__)` of a package whose public names stand under `if TYPE_CHECKING:` as plain imports.

  Type checkers and editors read those imports. At run time they are read from the package's source, and each name is
  imported when it is first used; submodules are found by name, too.
  """
  module = sys.modules[package]
  source = module.__spec__.loader.get_source(package)
  source_of = {alias.name: node.module for block in ast.parse(source).body
               if isinstance(block, ast.If) and "TYPE_CHECKING" in ast.unparse(block.test)
               for node in block.body if isinstance(node, ast.ImportFrom) for alias in node.names}

  def getattr_(name: str) -> Any:
    source = source_of.get(name) or package
    is_module = not name.startswith("_") and _is_package(source) and importlib.util.find_spec(f"{source}.{name}")
    if is_module:
      value = importlib.import_module(f"{source}.{name}")
    elif source != package:
      value = getattr(importlib.import_module(source), name)
    else:
      raise AttributeError(f"{package} has no {name!r}; it has {', '.join(sorted(source_of))}")
    setattr(module, name, value)
    return value

  return getattr_, lambda: sorted({*source_of, *vars(module)})


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
else:  # for rooms that mostly compute with numpy: loading JAX takes longer than their work
  jax, jnp = LazyModule("jax"), LazyModule("jax.numpy")


def is_jax(x: Any) -> "TypeGuard[jax.Array]":
  """Whether x is an array or a tracer of JAX; loads no JAX."""
  loaded = sys.modules.get("jax")
  return loaded is not None and isinstance(x, loaded.Array)


def _is_package(name):
  return hasattr(importlib.import_module(name), "__path__")
