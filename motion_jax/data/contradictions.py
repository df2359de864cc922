"""Captions that contradict a motion: the same sentence with another side, count, pace or direction.

A generator that follows captions has a larger error with such a sentence than with the true one; `loss.contrast` of
CMDM's denoiser and CDAMD's generator trains this (docs/training.md#contradicting-captions).
"""
import functools
import re

from motion_jax.data.mirror import mirror_caption

# Replacements by kind; of several one is drawn. Numbers of things stay plural.
_TIMES = {"once": ("twice", "three times"), "twice": ("once", "three times", "four times"),
          "two times": ("once", "three times", "four times"), "three times": ("once", "twice"),
          "four times": ("once", "twice"), "five times": ("once", "twice")}
_THINGS = {"two": ("four", "three"), "three": ("two",), "four": ("two",), "five": ("two",), "six": ("three",)}
_PACE = {"slowly": "quickly", "slow": "fast", "leisurely": "hurriedly", "quickly": "slowly", "quick": "slow",
         "fast": "slowly", "rapidly": "slowly", "briskly": "slowly", "hurriedly": "slowly", "brisk": "slow",
         "rapid": "slow"}
_DIRECTION = {"forward": "backward", "forwards": "backwards", "backward": "forward", "backwards": "forwards",
              "ahead": "backward"}
_COUNTED = r"(?= (?:\w+ ){0,2}?(?:steps|jumps|hops|kicks|punches|squats|bows|waves|claps|turns|strides|paces)\b)"


def _words(table, after=""):
  return re.compile(rf"\b(?:{'|'.join(table)})\b{after}", re.IGNORECASE)


_KINDS = tuple((_words(table, after), table) for table, after in (
    (_TIMES, ""), (_THINGS, _COUNTED), (_PACE, ""), (_DIRECTION, "")))
_BOTH = tuple(re.compile(rf"\b{a}\b[^.;]*\b(?:and|or|then|to)\b[^.;]*\b{b}\b", re.IGNORECASE) for a, b in (
    ("left", "right"), ("right", "left"), ("(?:forward|back|backward)s?", "(?:forward|forth|back|backward)s?")))


@functools.lru_cache(1 << 16)
def contradictions(caption: str) -> tuple[tuple[str, ...], ...]:
  """Captions that contradict one, by kind; kinds that it does not mention are omitted.

    "walks forward slowly"           ("walks forward quickly",), ("walks backward slowly",)
    "kicks with the left leg twice"  (... right leg twice,), (... left leg once, ... three times, ... four times)

  Every word of a kind is changed. A caption of both sides, or of both directions, may mean the same with the two
  exchanged ("waves with the left and the right hand"): that kind is omitted.
  """
  kinds = [] if any(both.search(caption) for both in _BOTH[:2]) else [(mirror_caption(caption),)]
  for words, table in _KINDS:
    if table is _DIRECTION and _BOTH[2].search(caption) or not (match := words.search(caption)):
      continue
    others = table[match[0].lower()]
    if isinstance(others, str):
      kinds.append((words.sub(lambda word, table=table: table[word[0].lower()], caption),))
    else:
      kinds.append(tuple(f"{caption[:match.start()]}{other}{caption[match.end():]}" for other in others))
  return tuple(kind for kind in kinds if kind[0] != caption)


def contradict(caption: str, chance: float) -> str:
  """Picks a contradiction of a caption by a number in [0, 1), kinds equally likely; the caption itself if none exists.
  """
  kinds = contradictions(caption)
  if not kinds:
    return caption
  place, rest = divmod(chance * len(kinds), 1)
  return kinds[int(place)][int(rest * len(kinds[int(place)]))]
