"""Suggestions for the page: prompts that a model can do, with small animated figures, and training captions."""
import functools
import json
import pathlib
from typing import Any

_FIGURES = pathlib.Path(__file__).parents[1] / "assets" / "suggestions.json"  # made by tools/suggestions.py
_CAPTIONS = 12  # nearest to the typed text
_FEW = 12       # prompts with figures; captions are added for a model that knows fewer


@functools.cache
def _figures() -> dict[str, Any]:
  return json.loads(_FIGURES.read_text(encoding="utf-8"))


def suggest(model: Any, words: str = "") -> dict[str, Any]:
  """{fps, scale, parents, rows: [{prompt, kind, figure}], captions} of a model, or of None before it is loaded.

  rows: prompts whose words the model knows. captions: training captions of similar meaning to the words. See
  tools/suggestions.py for figures.
  """
  figures, captions = _figures(), []
  if model is None:
    return figures | {"captions": captions}
  rows = [row for row in figures["rows"] if not model.captions.unknown_words(row["prompt"])]
  if words.strip() or len(rows) < _FEW:
    captions = [text for text, _ in model.captions.nearest(words.strip() or "a person moves", _CAPTIONS)]
  return figures | {"rows": rows, "captions": captions}
