"""Warnings about many files, as one line for each kind."""
import contextlib
import warnings


@contextlib.contextmanager
def merged():
  """Holds back warnings "file: text" until the end; those of one text become one that counts the files."""
  with warnings.catch_warnings(record=True) as found:
    warnings.simplefilter("always")
    yield
  files = {}
  for one in found:
    name, colon, text = str(one.message).partition(": ")
    names = files.setdefault((text, one.category) if colon else (name, one.category), [])
    if colon and name not in names:
      names.append(name)
  for (text, category), names in files.items():
    more = f" and {len(names) - 1} more" if len(names) > 1 else ""
    warnings.warn(f"{names[0]}{more}: {text}" if names else text, category, stacklevel=3)
