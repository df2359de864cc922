"""Limits of a studio: lengths, counts and rates."""
import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from motion_jax.utils.errors import InputError, reason
from motion_jax.utils.numerals import checked, require_numbers

_MORE = 0, 100  # the bounds of numbers in `Model.more_choices`


@dataclasses.dataclass(frozen=True)
class Limits:
  """Bounds of one studio; a request beyond them is refused with one sentence."""
  body_bytes: int = 32 << 20      # of a request: ten minutes of motion as JSON, or a capture file
  values: int = 4_000_000         # of a JSON body: half an hour of joints as numbers
  message_bytes: int = 64 << 10   # of one message on a stream
  prompt: int = 1000              # characters
  seconds: float = 120.0          # of a generated motion
  frames: int = 36_000            # of a motion in a request, such as an export: half an hour
  takes: int = 8                  # motions of one request
  blocks: int = 64                # prompts of one multi-prompt motion
  points: int = 4800              # of all paths and targets of one request
  streams: int = 8                # at the same time
  jobs: int = 2                   # generating requests at the same time; twice as many more may wait
  connections: int = 128          # at the same time
  idle: int = 32                  # of them without a request
  patience: float = 15.0          # seconds for the headers of a request, and between parts of its body
  requests: float = 20.0          # per second from one address, after a burst of three times as many
  wrong_tokens: float = 5.0       # per second from one address, likewise
  messages: float = 20.0          # per second on a stream, likewise
  unsent: int = 1000              # messages that wait for a page that does not read


class TokenBucket:
  """A rate limit: `rate` per second after a burst of three times as many; `take(now)` is False beyond it."""

  def __init__(self, rate: float) -> None:
    self._rate, self._left, self._at = rate, 3 * rate, -math.inf

  def take(self, now: float) -> bool:
    self._left = min(3 * self._rate, self._left + max(0.0, min(now - self._at, 3600.0)) * self._rate)
    self._at = now
    if self._left < 1:
      return False
    self._left -= 1
    return True


class ChoiceError(InputError):
  """A sampling choice that a model does not have, or a value that it does not take."""


def check_sampling(model: Any, given: Mapping[str, Any]) -> None:
  """Raises ChoiceError unless a model takes these sampling choices of a request."""
  more = {name: value for name, value in given.items() if name in model.more_choices}
  try:
    model.sampling(**{name: value for name, value in given.items() if name not in more})
    for name, value in more.items():
      checked(*require_numbers([value], name, "a whole number"), *_MORE, name)
  except (TypeError, ValueError) as error:
    raise ChoiceError(f"sampling: {reason(error, 300)}") from None
