"""What a model can do, for a page to suggest: prompts with small moving figures, and captions that it learned from."""
import functools
import json
import pathlib
from typing import Any

_FIGURES = pathlib.Path(__file__).parents[1] / "assets" / "suggestions.json"  # made by tools/suggestions.py
_CAPTIONS = 12  # that are nearest to what was typed
_FEW = 12       # prompts with figures; of a model that knows fewer of them captions are shown as well


@functools.cache
def _figures() -> dict[str, Any]:
  return json.loads(_FIGURES.read_text(encoding="utf-8"))


def found(model: Any, words: str = "") -> dict[str, Any]:
  """{fps, scale, parents, rows: [{prompt, kind, figure}], captions} of a model, or of none that has been loaded yet.

  rows are the prompts whose words it knows, all of them; captions those of its training that mean nearly what the words
  do. See tools/suggestions.py for figures.
  """
  figures, captions = _figures(), []
  if model is None:
    return figures | {"captions": captions}
  rows = [row for row in figures["rows"] if not model.unknown_words(row["prompt"])]
  if words.strip() or len(rows) < _FEW:
    captions = [text for text, _ in model.nearest_captions(words.strip() or "a person moves", _CAPTIONS)]
  return figures | {"rows": rows, "captions": captions}
