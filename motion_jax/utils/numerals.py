"""Parse numbers of a command line or a text file: plain digits, finite, within bounds.

Python's int and float also accept "nan", "1_000", digits of every script and huge numbers. `whole` and `real` make
readers of one number that do not; they can be the `type` of argparse, as their error is an error of argparse, too:

  parser.add_argument("--num-samples", type=whole(1, 10_000))
  parser.add_argument("--seconds", type=real(0.2, 3600, "seconds"))
"""
import argparse
import math
import re

from motion_jax.utils.errors import InputError

_WHOLE = re.compile(r"[+-]?[0-9]+")
_REAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
# What is allowed, from and to; the same on the command line, in files and from Python.
FRAME_RATES = (1, 1000)  # frames a second of a motion: slower is a series of pictures, faster a clock's error
SECONDS = (0, 86_400)    # a place in a recording
MOTIONS = (1, 10_000)    # made by one command
SEEDS = (0, 2**32 - 1)   # jax counts on from 0 there
STEPS = (1, 1000)        # of a sampler; a table of modulations holds each
GUIDANCE = (-100, 100)
CONTRAST = (0, 10)
CONTEXT = (1, 18_000)    # latents: an hour
MEMORY = (0, 18_000)     # of a context


class NumberError(InputError, argparse.ArgumentTypeError):
  """A text that is not a number of the expected kind."""


def whole(low=None, high=None, unit=""):
  """A reader of whole numbers from low to high: text -> int. Raises NumberError that says what is allowed."""
  def read(text):
    text = str(text).strip()
    if not _WHOLE.fullmatch(text):
      raise _error(text, "a whole number", low, high, unit)
    value = int(text) if len(text) < 40 else math.copysign(math.inf, -1 if text[0] == "-" else 1)
    return _within(text, value, "a whole number", low, high, unit)

  return read


def real(low=None, high=None, unit="", above=None):
  """A reader of finite numbers from low (or above a number) to high: text -> float. Raises NumberError."""
  def read(text):
    text = str(text).strip()
    if not _REAL.fullmatch(text):
      raise _error(text, "a number", low, high, unit, above)
    return _within(text, float(text), "a number", low, high, unit, above)

  return read


def is_number(text):
  """Whether a text is meant as a number, also one that `real` refuses: nan, one_000, 1,5, digits of another script."""
  try:
    float(text.strip().replace(",", "."))
  except ValueError:
    return False
  return True


def _within(text, value, what, low, high, unit, above=None):
  if not math.isfinite(value) or (low is not None and value < low) or (high is not None and value > high) or (
      above is not None and value <= above):
    raise _error(text, what, low, high, unit, above)
  return value


def _error(text, what, low, high, unit, above=None):
  expected = what + (f" of {unit}" if unit else "") + bounds(low, high, above)
  hint = f"; a decimal point is written {text.replace(',', '.')}" if _REAL.fullmatch(text.replace(",", ".")) and (
      "," in text) else ""
  return NumberError(f"got {shortened(text)!r}, expected {expected}{hint}")


def bounds(low, high, above=None):
  """" from 1 to 9", " over 0, up to 9", " from 1 on", " that is 1", or nothing: the words for what is allowed."""
  if low == high and low is not None:
    return f" that is {_plain(low)}"
  start = f" over {_plain(above)}" if above is not None else f" from {_plain(low)}" if low is not None else ""
  if high is None:
    return start and start + (" on" if above is None else "")
  if start and above is None:
    return f"{start} to {_plain(high)}"
  return f"{start}{',' if start else ''} up to {_plain(high)}"


def _plain(value):
  return f"{value:,}" if isinstance(value, int) else f"{value:g}"


def shortened(text, length=40):
  """A text for a message, in one line and cut where it is long."""
  text = text if text.isprintable() else "".join(sign if sign.isprintable() else " " for sign in text)
  return text if len(text) <= length else text[:length - 1] + "…"


def named(names, most=30) -> str:
  """A list of names for a message, at most `most` of them, each shortened."""
  names = list(names)
  return ", ".join(shortened(name) for name in names[:most]) + (", ..." if len(names) > most else "")


def as_float(value) -> float:
  """A number as float; infinity for an int beyond all floats, nan for what is no number."""
  try:
    return float(value)
  except OverflowError:
    return math.inf
  except (TypeError, ValueError):
    return math.nan


def checked(value, low, high, name, unit="", kind=int):
  """A number that a Python caller gave, as `kind` within bounds; ValueError names the argument."""
  number = as_float(value)
  if not low <= number <= high or (kind is int and number != int(number)):
    said = "of thousands of digits" if isinstance(value, int) and abs(value) > 10**40 else shortened(str(value))
    raise InputError(f"got {name} {said}, expected a {'whole ' if kind is int else ''}number"
                     f"{f' of {unit}' if unit else ''}{bounds(low, high)}")
  return kind(number)


def require_numbers(values, name, expected):
  """Returns the values if all are numbers; raises TypeError, naming the argument and the expected kind."""
  for value in values:
    try:
      if isinstance(value, str | bytes | bool):
        raise TypeError
      float(value)
    except OverflowError:
      pass  # far too large a number, but one
    except (TypeError, ValueError):
      raise TypeError(f"got {format_value(value)} as {name}, expected {expected}") from None
  return values


def format_value(value):
  """A value and its type, for an error: in one line, as arrays are not."""
  text = " ".join(repr(value).split())
  return f"{text if len(text) <= 60 else text[:59] + '…'} ({type(value).__name__})"
