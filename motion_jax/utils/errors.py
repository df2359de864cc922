"""Errors of the user's input, in one line: commands show them without a traceback."""
import contextlib


class InputError(ValueError):
  """A file or a value of the user that cannot be used. States what came, what was expected and what to try."""


class EncoderError(InputError, RuntimeError):
  """A program that writes films is missing, or failed."""


@contextlib.contextmanager
def reading(what, advice="it may be cut or damaged: copy or make it again"):
  """Turns any error inside the block into one InputError that begins with `what`, usually a path.

  For blocks that parse a file, where a flipped bit can raise errors of many kinds (KeyError, TypeError, OverflowError,
  zlib.error, ...). InputErrors and FileNotFoundErrors pass through.
  """
  try:
    yield
  except (InputError, FileNotFoundError):
    raise
  except OSError as error:
    raise InputError(f"{what} cannot be read: {error.strerror or reason(error)}; {advice}") from error
  except MemoryError as error:
    raise InputError(f"{what} is too large for the memory of this machine; {advice}") from error
  except Exception as error:
    raise InputError(f"{what} cannot be read ({reason(error)}); {advice}") from error


def reason(error, longest=120) -> str:
  """The first line of an error's text, shortened, or its type if it has no text."""
  lines = str(error).strip().splitlines()
  if isinstance(error, KeyError):
    lines = [f"{error} is missing"]
  text = lines[0] if lines else type(error).__name__
  return text if len(text) <= longest else text[:longest] + "..."
