"""What a studio takes: how long, how many, how often; and how it reads the fields of a request."""
import contextlib
import dataclasses
import math
from typing import Any

import numpy as np

from motion_jax.control import files
from motion_jax.control.constraints import Constraint, KeepParts
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import SEEDS
from motion_jax.utils.text_files import is_text


@dataclasses.dataclass(frozen=True)
class Limits:
  """Bounds of one studio; a request beyond them is refused with one sentence."""
  body_bytes: int = 32 << 20      # of a request: ten minutes of motion as JSON, a capture file
  message_bytes: int = 64 << 10   # of one message on a stream
  prompt: int = 1000              # characters
  seconds: float = 120.0          # of a motion that is made
  frames: int = 36_000            # of a motion that is sent to be exported: half an hour
  takes: int = 8                  # motions of one request
  blocks: int = 64                # prompts of one story
  points: int = 4800              # of all paths and targets of one request
  streams: int = 8                # at once
  jobs: int = 2                   # requests that make motion, at once; as many more wait
  requests: float = 20.0          # a second from one address, after a burst of three times as many
  messages: float = 20.0          # a second on a stream, likewise


class Bucket:
  """So many a second, after a burst of three times as many. `take(now)` says whether there is one left."""

  def __init__(self, rate: float) -> None:
    self._rate, self._left, self._at = rate, 3 * rate, -math.inf

  def take(self, now: float) -> bool:
    self._left = min(3 * self._rate, self._left + max(0.0, min(now - self._at, 3600.0)) * self._rate)
    self._at = now
    if self._left < 1:
      return False
    self._left -= 1
    return True


_MISSING = object()
# What the methods of models take beside choices of sampling.
_NO_CHOICES = frozenset((
    "self", "prompt", "prompts", "segments", "lists", "clip", "clips", "motion", "seed", "seeds", "rng", "seconds",
    "num_frames", "cleanup", "polish", "literal", "control", "project", "keep", "change", "task", "past",
    "past_prompt", "hold_until_done", "ease", "rest", "way", "num_past", "paste", "mask"))


class Fields:
  """The fields of a JSON object that somebody sent, each read once with what is allowed; `done` refuses the rest."""

  def __init__(self, value: Any, limits: Limits) -> None:
    if not isinstance(value, dict):
      raise InputError(f"got {_called(value)}, expected a JSON object such as {{\"prompt\": \"a person waves\"}}")
    self._left, self._limits = dict(value), limits

  def any(self, name: str, usual: Any = None) -> Any:
    return self._left.pop(name, usual)

  def _take(self, name, usual):
    value = self._left.pop(name, _MISSING)
    if value is _MISSING or value is None:
      if usual is _MISSING:
        raise InputError(f"{name} is missing")
      return usual, False
    return value, True

  def text(self, name: str, usual: Any = _MISSING, longest: int = 200) -> Any:
    value, given = self._take(name, usual)
    if given and (not isinstance(value, str) or not is_text(value) or len(value) > longest):
      raise InputError(f"got {name} {str(value)[:40]!r}, expected a text of at most {longest} characters")
    return value

  def prompt(self, name: str = "prompt", usual: Any = _MISSING) -> Any:
    value, given = self._take(name, usual)
    return check_prompt(value, self._limits) if given else value

  def number(self, name: str, low: float, high: float, usual: Any = _MISSING, whole: bool = False) -> Any:
    value, given = self._take(name, usual)
    if given:
      fits = type(value) is int or not whole and type(value) is float and math.isfinite(value)
      if not fits or not low <= value <= high:
        raise InputError(f"got {name} {str(value)[:40]}, expected a {'whole ' if whole else ''}number from {low:,} to "
                         f"{high:,}")
    return value

  def seed(self, name: str = "seed", usual: Any = 0) -> Any:
    return self.number(name, *SEEDS, usual, whole=True)

  def switch(self, name: str, usual: bool) -> bool:
    value, given = self._take(name, usual)
    if given and not isinstance(value, bool):
      raise InputError(f"got {name} {str(value)[:40]!r}, expected true or false")
    return value

  def spans(self, name: str) -> list[tuple[int, int]] | None:
    """[[first, past], ...] in frames."""
    value, given = self._take(name, None)
    if given and not (isinstance(value, list) and 0 < len(value) <= 100 and all(
        isinstance(span, list) and len(span) == 2 and all(type(frame) is int for frame in span)
        and 0 <= span[0] < span[1] for span in value)):
      raise InputError(f"got {name} {str(value)[:40]}, expected spans of frames such as [[20, 60]]")
    return [tuple(span) for span in value] if given else None

  def choices(self, name: str = "sampling") -> dict[str, Any]:
    """Choices of sampling: names and plain values; the model says what they may be."""
    value, given = self._take(name, {})
    if given and not (isinstance(value, dict) and len(value) <= 20 and all(
        item is None or type(item) in (int, float, str, bool) for item in value.values())):
      raise InputError(f"got {name} {str(value)[:40]}, expected an object such as {{\"guidance_scale\": 3}}")
    if strange := sorted(_NO_CHOICES & set(value)):
      raise InputError(f"got {strange[0]!r} in {name}, which is no choice of sampling; a request says it by a field of "
                       "its own, or not at all")
    return {str(key)[:60]: item for key, item in value.items() if item is not None}

  def control(self, name: str = "control") -> list[Constraint]:
    """Constraints in the form of docs/control.md; none where there is no such field."""
    value, given = self._take(name, None)
    if not given:
      return []
    try:
      found = files.from_json(value)
    except InputError as error:
      raise InputError(f"{name}: {error}") from None
    check_points(found, self._limits, name)
    frames = max((len(one.joints) for one in found if isinstance(one, KeepParts)), default=0)
    if frames > self._limits.frames:
      raise InputError(f"{name}: got {frames:,} frames to keep parts of, expected at most {self._limits.frames:,}")
    return found

  def done(self) -> None:
    """Raises InputError where there are fields that nobody asked for: a misspelled one would be ignored."""
    if self._left:
      raise InputError(f"got the unknown field {str(min(self._left, key=str))[:60]!r}; docs/protocol.md lists all")


def check_points(constraints: list[Constraint], limits: Limits, name: str) -> None:
  """Raises InputError where paths and targets have more points in all than a request may have."""
  count = sum(max((len(value) for field, value in vars(one).items()
                   if field != "joints" and isinstance(value, np.ndarray) and value.ndim), default=0)
              for one in constraints)
  if count > limits.points:
    raise InputError(f"{name}: got {count:,} points of paths and targets, expected at most {limits.points:,}")


def check_prompt(value: Any, limits: Limits) -> str:
  """A prompt that a model may be given. Raises InputError for what is empty, too long or no text."""
  if not isinstance(value, str) or not value.strip():
    raise InputError("got an empty prompt; say what the person does, as in \"a person waves\"")
  if len(value) > limits.prompt:
    raise InputError(f"got a prompt of {len(value):,} characters, expected at most {limits.prompt:,}")
  if not is_text(value):
    raise InputError("got a prompt with bytes that are no UTF-8 text")
  return value


@contextlib.contextmanager
def told_plainly():
  """A choice of sampling that a model does not have is told as a mistake of the request."""
  try:
    yield
  except TypeError as error:
    if "choice of sampling" not in str(error) and "has no argument" not in str(error):
      raise
    raise InputError(str(error)) from None


def _called(value):
  return {list: "a list", str: "a text", type(None): "nothing", bool: "a truth value"}.get(type(value), "a number")
