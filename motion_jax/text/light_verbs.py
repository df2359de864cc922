"""Verbs that say little, with the noun that says what is done: "takes two bows" is to bow twice, "takes a seat" to sit
down, "throws a left punch" to punch with the left hand. Captions of motion mostly say the verb of such a noun.
"""
from collections.abc import Mapping, Sequence
from typing import NamedTuple

LIGHT = {"take", "do", "make", "throw", "give", "perform"}
_NOUNS = {noun: noun for noun in "bow jump hop squat kick punch jab spin turn wave nod clap lunge leap twirl stretch "
                                 "salute crouch pivot roll".split()} | {"seat": "sit"}
_DOWN = {"seat": ["down"]}
_LIMB = {"kick": "foot", "punch": "hand", "jab": "hand", "wave": "hand", "salute": "hand"}
_ARTICLES = {"a", "an", "another", "the"}
_BEHIND = set("to in into on onto at with from for over towards toward forward forwards backward backwards back left "
              "right up down around high again quickly slowly fast upwards sideways".split())
_ING = {"sit": "sitting", "squat": "squatting", "hop": "hopping", "spin": "spinning", "jab": "jabbing",
        "wave": "waving", "nod": "nodding", "clap": "clapping", "lunge": "lunging"}


class Reworded(NamedTuple):
  """An action by its own verb: base form, participle, the words behind it, how often."""
  verb: str
  participle: str
  words: list[str]
  times: int


def reworded(verb: str, words: Sequence[str], numbers: Mapping[str, float]) -> Reworded | None:
  """What a light verb and the words behind it mean, None where they say more than this reads ("does a front kick").

  numbers: words for numbers, {"two": 2}.
  """
  if verb not in LIGHT:
    return None
  rest, times = [word.lower() for word in words], 1
  if rest[:1] and rest[0] in numbers and rest[0] not in _ARTICLES:
    times, rest = int(numbers[rest[0]]), rest[1:]
  elif rest[:1] and rest[0] in _ARTICLES:
    if rest[1:3] == ["couple", "of"]:
      times, rest = 2, rest[3:]
    elif rest[1:2] == ["few"]:
      times, rest = 3, rest[2:]
    else:
      rest = rest[1:]
  else:
    return None  # "does squats"
  side, rest = (rest[0], rest[1:]) if rest[:1] and rest[0] in ("left", "right") else ("", rest)
  noun = rest[0] if rest else ""
  found = next((one for one in _NOUNS if noun in (one, one + "s", one + "es")), "")
  if not found or times < 1 or rest[1:] and rest[1] not in _BEHIND or side and found not in (*_LIMB, "turn"):
    return None
  own = _NOUNS[found]
  said = [] if not side else [side] if found == "turn" else ["with", "the", side, _LIMB[found]]
  behind = list(words[len(words) - len(rest) + 1:])
  return Reworded(own, _ING.get(own, own + "ing"), [*_DOWN.get(found, []), *said, *behind], times)
