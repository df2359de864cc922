"""Limits of a studio: lengths, counts and rates."""
import contextlib
import dataclasses
import math

from motion_jax.utils.errors import InputError


@dataclasses.dataclass(frozen=True)
class Limits:
  """Bounds of one studio; a request beyond them is refused with one sentence."""
  body_bytes: int = 32 << 20      # of a request: ten minutes of motion as JSON, or a capture file
  message_bytes: int = 64 << 10   # of one message on a stream
  prompt: int = 1000              # characters
  seconds: float = 120.0          # of a generated motion
  frames: int = 36_000            # of a motion in a request, such as an export: half an hour
  takes: int = 8                  # motions of one request
  blocks: int = 64                # prompts of one multi-prompt motion
  points: int = 4800              # of all paths and targets of one request
  streams: int = 8                # at the same time
  jobs: int = 2                   # generating requests at the same time; twice as many more may wait
  requests: float = 20.0          # per second from one address, after a burst of three times as many
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


@contextlib.contextmanager
def unknown_choices_as_input_errors():
  """Reports a sampling choice that the model does not have as a mistake of the request."""
  try:
    yield
  except TypeError as error:
    if "choice of sampling" not in str(error) and "has no argument" not in str(error):
      raise
    raise InputError(str(error)) from None
