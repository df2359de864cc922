"""Prompts that are too near to sentences of an evaluation list, by the edit distance in words."""
import collections
import pathlib
import re
from collections.abc import Iterable

import numpy as np

from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import read_json_lines
from motion_jax.utils.text_files import read_lines

MARGIN = 3  # words: prompts at this distance or nearer are left out
_WORD = re.compile(r"[a-z0-9']+")


def words_of(sentence: str) -> tuple[str, ...]:
  """The words of a sentence in lower case, without punctuation."""
  return tuple(_WORD.findall(sentence.lower()))


def read_sentences(path: str | pathlib.Path, split: str = "") -> list[str]:
  """The sentences of a file, without duplicates: a .jsonl with "text" (a list or one), a .tsv, or one a line.

  split: of a .jsonl, only rows of this split. Of a .tsv the column "sentence" is read, lines that begin with # are
  skipped. Raises InputError for a file without sentences.
  """
  path = pathlib.Path(path)
  if path.suffix == ".jsonl":
    rows = [row for _, row in read_json_lines(path) if not split or row.get("split") == split]
    texts = [text for row in rows for text in ([row["text"]] if isinstance(row.get("text"), str) else
                                               row.get("text", ()))]
  else:
    texts = [line for line in read_lines(path) if line.strip() and not line.startswith("#")]
    if path.suffix == ".tsv":
      head, *rows = [line.split("\t") for line in texts] or [[]]
      if "sentence" not in head:
        raise InputError(f"{path}: got the columns {', '.join(head)}, expected one called sentence")
      texts = [row[head.index("sentence")] for row in rows]
  if not texts:
    raise InputError(f"{path} holds no sentences" + (f" of the split {split!r}" if split else "")
                     + '; expected a .jsonl with "text", a .tsv with a column sentence, or one sentence a line')
  return list(dict.fromkeys(text.strip() for text in texts if words_of(text)))


class Apart:
  """Sentences from which prompts keep a distance of more than `MARGIN` words."""

  def __init__(self, sentences: Iterable[str]) -> None:
    self._sentences = list(dict.fromkeys(filter(None, map(words_of, sentences))))
    self._lengths = np.array([len(words) for words in self._sentences], int)
    rows: dict[tuple[str, int], list[int]] = collections.defaultdict(list)
    for place, words in enumerate(self._sentences):
      for word, count in collections.Counter(words).items():
        for number in range(count):
          rows[word, number].append(place)
    self._rows = {key: np.array(places) for key, places in rows.items()}

  def __len__(self) -> int:
    return len(self._sentences)

  def nearest(self, prompt: str) -> str | None:
    """A sentence within `MARGIN` words of a prompt, None if there is none."""
    words = words_of(prompt)
    shared = np.zeros(len(self._sentences), int)
    for word, count in collections.Counter(words).items():
      for number in range(count):
        if (word, number) in self._rows:
          shared[self._rows[word, number]] += 1
    # The distance is at least the number of words that the longer sentence has beyond the common ones.
    possible = np.flatnonzero(np.maximum(self._lengths, len(words)) - shared <= MARGIN)
    return next((" ".join(self._sentences[place]) for place in possible
                 if edit_distance(words, self._sentences[place]) <= MARGIN), None)


def edit_distance(first: tuple[str, ...], second: tuple[str, ...]) -> int:
  """Fewest insertions, deletions and replacements of words that turn one sentence into the other."""
  row = list(range(len(second) + 1))
  for number, word in enumerate(first, 1):
    before, row[0] = row[0], number
    for place, other in enumerate(second, 1):
      before, row[place] = row[place], min(row[place] + 1, row[place - 1] + 1, before + (word != other))
  return row[-1]
