"""A griffe extension: docstrings as Markdown, the way tools/reference.py writes them.

The first paragraph is prose; what follows has drawings and tables whose spacing counts, so it stays as it is.
"""
import pathlib
import sys

import griffe

sys.path.insert(0, str(pathlib.Path(__file__).parents[2]))
from tools import reference  # noqa: E402


class Docstrings(griffe.Extension):
  """Rewrites each docstring once, when its object has been read."""

  def on_instance(self, *, obj, **_):
    if obj.docstring:
      obj.docstring.value = "\n".join(reference.bodies(obj.docstring.value)).strip()
