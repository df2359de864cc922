"""Parts of a motion as people write them: "0:1.5s", "25%:0.5", "30:"."""
from collections.abc import Iterable

from motion_jax.utils.numerals import SECONDS, NumberError, real, whole

TASKS = {  # tasks of editing: the parts of a motion that are new, as shares of its frames
    "inpainting": ((0.25, 0.75),), "outpainting": ((0.0, 0.25), (0.75, 1.0)),
    "prefix": ((0.5, 1.0),), "suffix": ((0.0, 0.5),),
}


def spans_of(texts: Iterable[str], num_frames: int, fps: float) -> list[tuple[int, int]]:
  """[(first, past)] in frames from texts "A:B", each side in seconds ("1.5s"), as a share ("0.25", "25%") or in frames
  ("30"); an empty side is the end on that side."""
  def place(text, empty):
    text = text.strip()
    try:
      if not text:
        return empty
      if text.endswith("s"):
        return round(real(*SECONDS)(text[:-1]) * fps)
      if text.endswith("%"):
        return round(real(0, 100)(text[:-1]) / 100 * num_frames)
      return round(real(0, 1)(text) * num_frames) if "." in text else whole(0, 10**9)(text)
    except NumberError as error:
      raise ValueError(f"{error}; a side is seconds (1.5s), a share (0.25, 25%) or frames (30)") from None

  spans = []
  for text in texts:
    first, colon, past = text.partition(":")
    if not colon:
      raise ValueError(f"got the span {text!r}, expected A:B as in 0:1.5s")
    spans.append((place(first, 0), min(place(past, num_frames), num_frames)))
  return spans
