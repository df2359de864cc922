"""Python values as JSON can hold them."""
import numpy as np


def plain(value):
  """A copy that JSON can hold: arrays become lists, other objects their text."""
  if isinstance(value, dict):
    return {str(key): plain(item) for key, item in value.items()}
  if isinstance(value, list | tuple):
    return [plain(item) for item in value]
  if isinstance(value, np.ndarray | np.generic):
    return value.tolist()
  return value if value is None or isinstance(value, str | int | float | bool) else str(value)
