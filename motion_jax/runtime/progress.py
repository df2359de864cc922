"""Progress bars on the terminal. Nothing is shown until `show` is called, as the command line does."""
import sys

_shown = False


def show():
  """From now on bars are drawn on stderr if it is a terminal; files and pipes get none."""
  global _shown
  _shown = sys.stderr is not None and sys.stderr.isatty()


def each(items, what, total=None, unit="it"):
  """Yields the items; a bar named `what` counts them while they are used, and vanishes at the end."""
  if not _shown:
    yield from items
    return
  from tqdm import tqdm
  yield from tqdm(items, desc=what, total=total, unit=unit, leave=False, dynamic_ncols=True, file=sys.stderr)
