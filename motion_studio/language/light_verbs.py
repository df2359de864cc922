"""Verbs that say little, with the noun that says what is done: "takes two bows" is to bow twice, "takes a seat" to sit
down, "throws a left punch" to punch with the left hand, as "punches left" is. Captions of motion mostly say the verb of
such a noun, and "diagonally forward to the left" of what goes "ahead and to the left without turning".
"""
import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from motion_jax.text.morphology import present_participle

LIGHT = {"take", "do", "make", "throw", "give", "perform"}
_NOUNS = {noun: noun for noun in "bow jump hop squat kick punch jab spin turn wave nod clap lunge leap twirl stretch "
                                 "salute crouch pivot roll".split()} | {"seat": "sit"}
_DOWN = {"seat": ["down"]}
_LIMB = {"kick": "foot", "punch": "hand", "jab": "hand", "wave": "hand", "salute": "hand"}
BLOWS = {"kick", "punch", "jab"}
_ARTICLES = {"a", "an", "another", "the"}
_WHOSE = {"the", "his", "her", "their", "its", "my", "your", "both"}
_RESTS = {"rest": "rest", "break": "pause", "breather": "pause", "pause": "pause"}
_RESTS_FOR = {"short": "moment", "brief": "moment", "quick": "moment", "little": "moment", "small": "moment",
              "long": "while", "longer": "while"}
_HURRIES, _AHEAD = {"hurry", "rush"}, ([], ["ahead"], ["forward"], ["forwards"], ["along"])
PACES = {"slow": "slowly", "quick": "quickly", "fast": "quickly", "rapid": "quickly"}
_GOES = {"walk", "stride", "stroll", "step", "move", "go", "run", "jog"}
_DIAGONAL = re.compile(r"(?:straight )?(ahead|forwards?|back|backwards?) and to (?:the|his|her|their) (left|right) ?,? "
                       r"(?:without (?:ever )?turning|without a turn|(?:while |still )?facing (?:forwards?|ahead))"
                       r"(?: around)?")
_POSTURES = {"sitting": ("sit", []), "seated": ("sit", []), "kneeling": ("kneel", []), "crouching": ("crouch", []),
             "crouched": ("crouch", []), "lying": ("lie", ["down"]), "standing": ("stand", ["still"])}
_BEGINS_IN = re.compile(rf"(?:(?:from|in|out|off) )?(?:(?:a|the) )?({'|'.join(_POSTURES)})(?: down)?"
                        r"(?: (?:position|pose|posture))?")
_BEHIND = set("to in into on onto at with from for over towards toward forward forwards backward backwards back left "
              "right up down around high again quickly slowly fast upwards sideways while".split())
_OFTEN = {"once", "twice", "thrice", "times"}
_STANDSTILLS = {"stop", "halt", "standstill"}
_SEVERAL = {"and", "then", ","}  # more is said than one action


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
  rest, times = [word.lower() for word in words], 1
  if verb in _GOES and (found := _DIAGONAL.fullmatch(" ".join(rest))):
    way = "backward" if found[1].startswith("back") else "forward"
    return Reworded(verb, present_participle(verb), ["diagonally", way, "to", "the", found[2]], 1)
  if verb in ("start", "begin") and (found := _BEGINS_IN.fullmatch(" ".join(rest))):
    own, still = _POSTURES[found[1]]
    return Reworded(own, present_participle(own), still, 1)
  if verb == "come" and rest[:2] in (["to", "a"], ["to", "an"]) and rest[-1] in _STANDSTILLS:
    return Reworded("stop", "stopping", [], 1)
  if verb in BLOWS and rest[:1] in (["left"], ["right"]) and (len(rest) == 1 or rest[-1] in _OFTEN):
    return Reworded(verb, present_participle(verb), ["with", "the", rest[0], _LIMB[verb], *words[1:]], 1)
  if verb == "put":
    return _hands_up(rest, words)
  if verb in _HURRIES and rest in _AHEAD:
    return Reworded("walk", "walking", ["forward", "quickly"], 1)
  if verb not in LIGHT:
    return None
  if verb == "take" and rest and rest[-1] in _RESTS and rest[0] in _ARTICLES and set(rest[1:-1]) <= {*_RESTS_FOR}:
    time = [_RESTS_FOR[word] for word in rest[1:-1]]
    return Reworded(_RESTS[rest[-1]], "resting", ["for", "a", time[0]] if time else [], 1)
  if verb == "take" and rest[:1] and rest[0] in PACES and rest[1:2] == ["steps"]:
    way = ["forward"] if rest[2:] in (["ahead"], []) else words[2:]
    if rest[2:] and rest[2] not in (*_BEHIND, "ahead") or not _SEVERAL.isdisjoint(rest[2:]):
      return None
    return Reworded("walk", "walking", [*way, PACES[rest[0]]], 1)
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
  return Reworded(own, present_participle(own), [*_DOWN.get(found, []), *said, *behind], times)


def _hands_up(rest, words):
  """"puts her hands up" is to raise both hands, "puts up a hand" to raise a hand; None for any other thing."""
  named = rest[1:] if rest[:1] == ["up"] else rest
  start = 1 if named[:1] and named[0] in (*_WHOSE, "a") else 0
  side = named[start] if named[start:start + 1] and named[start] in ("left", "right") else ""
  thing = start + bool(side)
  if named[thing:thing + 1] not in (["hand"], ["hands"], ["arm"], ["arms"]):
    return None
  behind = named[thing + 1:]
  if len(named) == len(rest):
    if behind[:1] != ["up"]:
      return None
    behind = behind[1:]
  if behind and behind[0] not in _BEHIND - {"on"} or not (_SEVERAL | {"down"}).isdisjoint(behind):
    return None
  which = ["the", side] if side else ["both"] if named[thing].endswith("s") else ["a"]
  return Reworded("raise", "raising", [*which, named[thing], *(words[len(words) - len(behind):] if behind else [])], 1)
