"""The caption files of HumanML3D-layout folders: one line caption#tokens#start#end for each caption of a clip."""
from typing import NamedTuple

from motion_jax.text.tagger import tag
from motion_jax.utils.numerals import SECONDS, NumberError, real
from motion_jax.utils.text_files import read_lines

_SECONDS = real(*SECONDS, unit="seconds")


class TextLine(NamedTuple):
  """A line of a text file: caption, its tokens "lemma/POS", and the seconds it describes (0, 0: the whole clip)."""
  caption: str
  tokens: tuple[str, ...] = ()
  start: float = 0.0
  end: float = 0.0


def read_texts(path) -> list[TextLine]:
  """Reads caption#tokens#start#end lines; a tag that is NaN or missing counts as 0."""
  lines = []
  for number, line in enumerate(read_lines(path), 1):
    if not line.strip():
      continue
    parts = line.strip().split("#")
    try:
      start, end = (_tag(part) for part in (parts[2:4] + ["", ""])[:2])
    except NumberError as error:
      raise ValueError(f"{path} line {number}: in a time tag: {error}; expected caption#tokens#start#end") from None
    lines.append(TextLine(parts[0].strip(), tuple(parts[1].split()) if len(parts) > 1 else (),
                          start, end))
  return lines


def _tag(text):
  return 0.0 if text.strip().lower() in ("", "nan") else _SECONDS(text)


def format_texts(clip) -> str:
  """Captions of a clip as lines caption#tokens#start#end; a "#" inside a caption becomes a blank."""
  lines = []
  for caption in clip.captions:
    text = " ".join(caption.text.replace("#", " ").split())
    lines.append(f"{text}#{' '.join(tag(text))}#{float(caption.start)}#{float(caption.end)}\n")
  return "".join(lines)
