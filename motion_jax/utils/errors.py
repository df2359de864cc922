"""What is wrong with a user's input, told in one line: the errors that commands show without a traceback."""
import contextlib


class InputError(ValueError):
  """A file or a value that a user gave cannot be used. Says what came, what was expected and what to try."""


class EncoderError(InputError, RuntimeError):
  """A program that writes films is missing, or failed."""


@contextlib.contextmanager
def reading(what, advice="it may be cut or damaged: copy or make it again"):
  """Whatever a reader stumbles over inside the block becomes one InputError that begins with `what`, mostly a path.

  For blocks that take a file apart, where a flipped bit raises whatever the parser did not foresee (KeyError,
  TypeError, OverflowError, zlib.error, ...). Our own InputErrors pass through; a FileNotFoundError stays one.
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
  """The first line of an error's own words, not too long, or its kind where it has none."""
  lines = str(error).strip().splitlines()
  if isinstance(error, KeyError):
    lines = [f"{error} is missing"]
  text = lines[0] if lines else type(error).__name__
  return text if len(text) <= longest else text[:longest] + "..."
