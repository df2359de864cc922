"""Splits, captions and statistics of SnapMoGen folders; `snapmogen` says what a folder holds."""
import pathlib
import re
from typing import NamedTuple

import numpy as np

from motion_jax.motion.representations import get_layout
from motion_jax.motion.skeleton import SNAPMOGEN
from motion_jax.motion.stats import Stats
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import load_npy, read_json
from motion_jax.utils.numerals import shortened
from motion_jax.utils.text_files import file_stem, read_lines

SPLITS = ("train", "val", "test")
MIN_FRAMES = 128
FPS = SNAPMOGEN.fps


class Span(NamedTuple):
  """Rows start:end of a recording; its id in files is "NAME#start#end"."""
  recording: str
  start: int
  end: int

  @property
  def id(self) -> str:
    return f"{self.recording}#{self.start}#{self.end}"


def read_ids(folder, split="train") -> list[Span]:
  """The spans of a split. Raises FileNotFoundError if the file is missing, ValueError for a line that is no id."""
  if split not in SPLITS:
    raise ValueError(f"got split {split!r}, expected one of {', '.join(SPLITS)}")
  path = ids_file(folder, split)
  need(path, "ids NAME#start#end, one a line")
  spans = []
  for number, line in enumerate(read_lines(path), 1):
    if not line.strip():
      continue
    parts = line.strip().rsplit("#", 2)
    numbers = [int(part) for part in parts[1:] if re.fullmatch("[0-9]{1,9}", part)]
    if len(numbers) != 2 or not numbers[0] < numbers[1]:
      raise InputError(f"{path} line {number}: got {shortened(line.strip())!r}, expected NAME#start#end with start "
                       "before end")
    spans.append(Span(file_stem(parts[0], f"{path} line {number}"), *numbers))
  return spans


def ids_file(folder, split):
  return pathlib.Path(folder) / "data_split_info" / f"{split}_ids.txt"


def read_captions(folder) -> dict[str, tuple[tuple[str, ...], tuple[str, ...]]]:
  """Captions by id: (captions written by people, captions written by a machine)."""
  path = pathlib.Path(folder) / "all_caption_clean.json"
  need(path, 'a JSON object {id: {"manual": [...], "gpt": [...]}}')
  table = {}
  for name, entry in read_json(path).items():
    lists = [entry.get(kind, []) for kind in ("manual", "gpt")] if isinstance(entry, dict) else [None]
    if not all(isinstance(captions, list) and all(isinstance(text, str) for text in captions) for captions in lists):
      raise InputError(f'{path}: {shortened(name)!r} holds no object {{"manual": [captions], "gpt": [captions]}}')
    table[name] = tuple(map(tuple, lists))
  return table


def folder_stats(folder, layout="snapmogen") -> Stats:
  """The dataset's own statistics. Columns that never move (root's x and z among the positions) have std 1."""
  layout, values = get_layout(layout), []
  for name in ("mean", "std"):
    path = pathlib.Path(folder) / "meta_data" / f"{name}.npy"
    need(path, "the dataset's statistics, (296,)")
    value = load_npy(path).astype(np.float32).ravel()
    if value.shape != (296,):
      raise ValueError(f"{path}: got shape {value.shape}, expected (296,); these statistics belong to another "
                       "representation")
    values.append(value[get_layout("snapmogen").columns_of(layout)])
  return Stats(values[0], np.where(np.abs(values[1]) < 1e-8, np.float32(1), values[1]), layout)


def need(path, what):
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}; expected {what}: a SnapMoGen folder has renamed_feats/, "
                            "data_split_info/, meta_data/ and all_caption_clean.json")
