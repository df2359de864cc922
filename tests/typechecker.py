"""How annotated types are checked in tests: numpy's numbers stand for Python's, and an int for a float, as for mypy."""
import functools

import beartype
import numpy as np

_check = beartype.beartype(conf=beartype.BeartypeConf(hint_overrides=beartype.FrozenDict({
    int: int | np.integer, float: float | int | np.number, bool: bool | np.bool_})))


def check(function):
  """The function with its types checked; the checks are written at its first call, for most are never called in a
  process, and writing those of all takes a second or two."""
  checked = functools.cache(lambda: _check(function))

  @functools.wraps(function)
  def call(*args, **named):
    return checked()(*args, **named)

  return call
