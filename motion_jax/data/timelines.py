"""Timelines: sentences with a start, an end and body parts, in the multi-track format of STMC and its MTT data.

A text file with one interval per line, an empty line between timelines, times in seconds:

  walking in a circle # 0.0 # 6.0 # legs
  raising both hands in the air # 2.0 # 5.0 # right arm # left arm

`single_track` turns one into consecutive prompts, for models that take one caption at a time.

`read_sequences` reads consecutive prompts in the format of FlowMDM's evaluation: JSON, [{"id": "0",
"lengths": [frames, ..], "text": [caption, ..]}, ..].
"""
from typing import NamedTuple

from motion_jax.utils.errors import InputError, reason
from motion_jax.utils.input_files import read_json
from motion_jax.utils.numerals import SECONDS, NumberError, real, shortened
from motion_jax.utils.text_files import lines_of, read_lines

PARTS = ("head", "left arm", "right arm", "legs", "spine")
_ALSO = {"neck": "head", "torso": "spine", "left hand": "left arm", "right hand": "right arm", "left leg": "legs",
         "right leg": "legs"}
_SECONDS = real(*SECONDS, unit="seconds")


class Interval(NamedTuple):
  """A caption of the seconds start:end, of some body parts (none: the whole body)."""
  text: str
  start: float
  end: float
  parts: tuple[str, ...] = ()


def read_timelines(path) -> list[list[Interval]]:
  """Reads all timelines of a file, each shifted to begin at 0. Raises InputError with the number of a bad line."""
  timelines, current = [], []
  for number, line in enumerate(read_lines(path), 1):
    if line.strip():
      current.append(_interval(line, f"{path} line {number}"))
    elif current:
      timelines.append(current)
      current = []
  timelines += [current] if current else []
  if not timelines:
    raise InputError(f"{path} holds no timeline; a line is: caption # start # end # body parts, times in seconds")
  return [_from_zero(timeline) for timeline in timelines]


def read_sequences(path) -> list[list[tuple[str, int]]]:
  """Reads sequences [[(caption, frames), ..], ..], in the order of their ids. Raises InputError for other content."""
  expected = 'expected a list of {"id", "lengths": [frames, ..], "text": [caption, ..]}, as many lengths as texts'
  content = read_json(path, list, advice=expected)
  try:
    sequences = [list(zip(sequence["text"], map(int, sequence["lengths"]), strict=True))
               for sequence in sorted(content, key=lambda sequence: int(sequence["id"]))]
  except (KeyError, TypeError, ValueError, OverflowError) as error:
    raise InputError(f"{path} is no file of multi-prompt sequences ({reason(error)}); {expected}") from None
  bad = [i for i, sequence in enumerate(sequences) if len(sequence) < 2 or any(
      not isinstance(text, str) or not text.strip() or frames < 1 for text, frames in sequence)]
  if bad or not sequences:
    raise InputError(f"{path}: " + (f"sequence {bad[0]} of {len(sequences)} has an empty caption, a length under 1 or "
                                    "no second prompt" if bad else "no sequence of prompts") + f"; {expected}")
  return sequences


def is_timeline(text) -> bool:
  """Whether the lines of a file look like a timeline: at least three fields, separated by #."""
  lines = [line for line in lines_of(text) if line.strip()]
  return bool(lines) and all(line.count("#") >= 2 for line in lines)


def _interval(line, where):
  text, *fields = (field.strip() for field in line.split("#"))
  if len(fields) < 2 or not text:
    raise InputError(f"{where}: got {shortened(line.strip())!r}, expected: caption # start # end # body parts, times "
                     "in seconds")
  try:
    start, end = map(_SECONDS, fields[:2])
  except NumberError as error:
    raise InputError(f"{where}: in a time: {error}") from None
  if not start < end:
    raise InputError(f"{where}: got an interval from {start:g} to {end:g} s; an end comes after its start")
  parts = []
  for part in filter(None, fields[2:]):
    part = _ALSO.get(part.lower(), part.lower())
    if part not in PARTS:
      raise InputError(f"{where}: got the body part {shortened(part)!r}, expected one of {', '.join([*PARTS, *_ALSO])}")
    parts.append(part)
  return Interval(text, start, end, tuple(dict.fromkeys(parts)))


def _from_zero(timeline):
  first = min(interval.start for interval in timeline)
  return [interval._replace(start=interval.start - first, end=interval.end - first) for interval in timeline]


def single_track(timeline, shortest=0.6) -> list[tuple[str, float]]:
  """Converts a timeline of overlapping intervals to consecutive prompts [(caption, seconds)].

  Time is cut at every start and end. The caption of a piece joins those of all its intervals by "and", in the order of
  their starts; body parts are not used, as captions name them. A gap continues the caption before it. Pieces under
  `shortest` seconds are merged into the longer neighbour, equal neighbours into one.
  """
  timeline = sorted(timeline, key=lambda interval: interval.start)
  cuts = sorted({time for interval in timeline for time in (interval.start, interval.end)})
  pieces = []
  for start, end in zip(cuts[:-1], cuts[1:]):
    said = [interval.text.rstrip(" .") for interval in timeline if interval.start < end and interval.end > start]
    caption = " and ".join(dict.fromkeys(said)) or pieces[-1][0]
    pieces.append((caption, end - start))
  while len(pieces) > 1 and min(seconds for _, seconds in pieces) < shortest - 1e-9:
    short = min(range(len(pieces)), key=lambda i: pieces[i][1])
    sides = [i for i in (short - 1, short + 1) if 0 <= i < len(pieces)]
    longer = max(sides, key=lambda i: pieces[i][1])
    pieces[longer] = pieces[longer][0], pieces[longer][1] + pieces[short][1]
    del pieces[short]
  joined = pieces[:1]
  for caption, seconds in pieces[1:]:
    if caption == joined[-1][0]:
      joined[-1] = caption, joined[-1][1] + seconds
    else:
      joined.append((caption, seconds))
  return joined
