"""Captions that contradict a motion: the same sentence with another side, count, pace or direction.

A generator that follows captions has a larger error with such a sentence than with the true one; `loss.contrast` of
CMDM's denoiser and CDAMD's generator makes it so (docs/training.md#contradicting-captions).
"""
import functools
import re

from motion_jax.data.mirror import mirror_caption

# What is changed for what, by kind; of several one is drawn. A number of things keeps them plural.
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
  """The captions that contradict one, by kind; kinds that it says nothing of are left out.

    "walks forward slowly"           ("walks forward quickly",), ("walks backward slowly",)
    "kicks with the left leg twice"  (... right leg twice,), (... left leg once, ... three times, ... four times)

  Every word of a kind is changed. A caption of both sides, or of both directions, may say the same with the two
  exchanged ("waves with the left and the right hand"), so that kind is left out.
  """
  found = [] if any(both.search(caption) for both in _BOTH[:2]) else [(mirror_caption(caption),)]
  for words, table in _KINDS:
    if table is _DIRECTION and _BOTH[2].search(caption) or not (match := words.search(caption)):
      continue
    others = table[match[0].lower()]
    if isinstance(others, str):
      found.append((words.sub(lambda one, table=table: table[one[0].lower()], caption),))
    else:
      found.append(tuple(f"{caption[:match.start()]}{other}{caption[match.end():]}" for other in others))
  return tuple(kind for kind in found if kind[0] != caption)


def contradict(caption: str, chance: float) -> str:
  """One of the contradictions of a caption by a number of [0, 1), each kind as often; the caption itself for none."""
  kinds = contradictions(caption)
  if not kinds:
    return caption
  place, rest = divmod(chance * len(kinds), 1)
  return kinds[int(place)][int(rest * len(kinds[int(place)]))]
