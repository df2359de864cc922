"""Former names of parameters, which keep working with a warning for one minor version (docs/stability.md)."""
import functools
import warnings
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")


def renamed_parameters(removed_in: str, **names: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
  """Decorator: the function also takes keyword arguments by their former names.

  names: {former name: name}; removed_in: the version, such as "0.3", that no longer takes the former names. A call with
  one of them gives a DeprecationWarning at the caller's line. Raises TypeError for a call with both names.
  """
  def decorate(function: Callable[P, R]) -> Callable[P, R]:
    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
      for former in names.keys() & kwargs.keys():
        name = names[former]
        if name in kwargs:
          raise TypeError(f"{function.__name__} got {name} and {former}, its former name; pass {name} alone")
        warnings.warn(f"the parameter {former} of {function.__name__} is now {name}; version {removed_in} no longer "
                      f"takes {former}", DeprecationWarning, stacklevel=2)
        kwargs[name] = kwargs.pop(former)
      return function(*args, **kwargs)

    return call

  return decorate
