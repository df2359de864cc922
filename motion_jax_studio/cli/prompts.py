"""Prompts of the command line: a sentence, several in sequence, and prompt files."""
import pathlib
import re
from typing import NamedTuple

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import MOTIONS, NumberError, is_number, real, shortened, whole
from motion_jax_studio.cli.reading import MOTION_FILES

MOMASK_FPS = 20.0
_MOMASK = re.compile(r"(?P<prompt>.*[^\s#])#(?P<length>[0-9]+|NA)")
_HEADERS = ("prompt", "text", "caption")
_FRAMES = whole(1, 72_000, "frames")
_SECONDS = real(above=0, high=3600, unit="seconds")


class Line(NamedTuple):
  """A prompt and its length: `count` frames at `fps`, at the model's rate where fps is None; no length where count is
  None."""
  prompt: str
  count: int | None = None
  fps: float | None = None

  def frames(self, fps):
    """The length at another frame rate, or None."""
    return self.count if self.count is None or self.fps is None else max(1, round(self.count * fps / self.fps))


def read_lines(text) -> list[Line]:
  """Prompts with lengths, from a sentence, a .txt file of prompts, or a .csv file of prompts and lengths.

  Lines of a .txt may end like MoMask's: text#80, a length in frames at 20 fps, or text#NA.
  """
  path = pathlib.Path(text)
  if not text.strip():
    raise InputError(f"got the prompt {text!r}; say what the person does, as in \"a person waves\"")
  if path.suffix.lower() not in (".txt", ".csv"):
    _check_is_prompt(text)
    return [Line(text)]
  from motion_jax.utils import text_files
  if not path.is_file():
    raise FileNotFoundError(f"there is no prompt file {text}; put a sentence in quotes")
  if path.suffix.lower() == ".txt":
    rows = [_without_length(path, number, line.strip())
            for number, line in enumerate(text_files.read_lines(path), 1) if line.strip()]
  else:
    rows = text_files.read_table(path, _are_prompts)
    rows = [_prompt_and_frames(path, row) for row in rows[_has_header(rows):]]
  if not 0 < len(rows) <= MOTIONS[1]:
    raise InputError(f"{path} holds {f'{len(rows):,} prompts' if rows else 'no prompt'}, expected 1 to {MOTIONS[1]:,}")
  return rows


def check_count(prompts, num_samples):
  """Raises InputError for more motions than one run may generate, before the model is loaded."""
  if prompts * num_samples > MOTIONS[1]:
    raise InputError(f"got {prompts:,} prompts with --num-samples {num_samples:,}, {prompts * num_samples:,} motions; "
                     f"expected at most {MOTIONS[1]:,} in one run")


def _check_is_prompt(text):
  """Raises InputError for the name of a motion file or of a project, where a sentence was expected."""
  use = {".json": "motion-jax make makes a studio's project"} | dict.fromkeys(
      MOTION_FILES, "motion-jax extend, edit and render read motion files")
  ending = pathlib.Path(text).suffix.lower()
  if ending in use and " " not in text:
    raise InputError(f"got {shortened(text)!r} as the prompt, expected a sentence in quotes, or a .txt or .csv file of "
                     f"prompts; {use[ending]}")


def _without_length(path, number, line):
  """The prompt and length of a line of a MoMask prompt file."""
  match = _MOMASK.fullmatch(line)
  if not match:
    return Line(line)
  try:
    count = None if match["length"] == "NA" else _FRAMES(match["length"])
  except NumberError as error:
    raise InputError(f"{path} line {number}: in the length after #: {error}") from None
  return Line(match["prompt"], count, MOMASK_FPS)


def _has_header(rows):
  return bool(rows) and rows[0].cells[0].lower() in _HEADERS


def _are_prompts(rows):
  """Whether a table was split into prompts and lengths."""
  rows = rows[_has_header(rows):]
  return all(len(row.cells) == 1 or _is_length(row.cells[1]) for row in rows) and (
      any(len(row.cells) > 1 for row in rows) or not any(mark in row.cells[0] for row in rows for mark in ",;\t"))


def _is_length(text):
  return not text or text.isdecimal()


def _prompt_and_frames(path, row):
  if not row.cells[0]:
    raise InputError(f"{path} line {row.line}: no prompt before the length")
  length = row.cells[1] if len(row.cells) > 1 else ""
  try:
    return Line(row.cells[0], _FRAMES(length) if length else None)
  except NumberError as error:
    raise InputError(f"{path} line {row.line}: in the length: {error}; a comma inside a prompt needs quotes around "
                     "it") from None


def read_sequences(text, fps=20.0):
  """[[(prompt, seconds or None)]]: lists of segments, from prompts separated by | or from a file, see `motion-jax
  multi-prompt --help`. fps: frame rate of lengths in frames."""
  from motion_jax.data import timelines
  from motion_jax.utils import text_files
  path = pathlib.Path(text)
  if path.suffix.lower() == ".txt" and path.is_file() and timelines.is_timeline(text_files.read_text(path)):
    return [timelines.single_track(timeline) for timeline in timelines.read_timelines(path)]
  lines, is_table = read_lines(text), path.suffix.lower() == ".csv"
  if len(lines) == 1 and lines[0].count is None and not is_table:
    return [[_prompt_and_seconds(part) for part in lines[0].prompt.split("|")]]
  return [[_prompt_and_seconds(line.prompt) if line.count is None and not is_table else
           (line.prompt, None if line.count is None else line.frames(fps) / fps) for line in lines]]


def _prompt_and_seconds(part):
  """("a person walks", 4.0) from "a person walks:4"; a colon without a number belongs to the sentence."""
  prompt, colon, seconds = part.strip().rpartition(":")
  seconds = seconds.strip().removesuffix("s").strip()
  if not colon or not is_number(seconds):
    return part.strip(), None
  try:
    return prompt.strip(), _SECONDS(seconds)
  except NumberError as error:
    raise InputError(f"in {shortened(part.strip())!r}: {error}") from None
