"""What a sentence leaves unsaid because it was said just before: "turns left, then right", "kicks twice with the left
leg, then once with the other", "walks, then speeds up", "stops and goes on".
"""
import re

from motion_studio.language import actions
from motion_studio.language.clause import (
  DIRECTIONS,
  NUMBERS,
  ONE_MORE,
  POSSESSIVES,
  SIDES,
  Clause,
  lower,
  without_times,
)
from motion_studio.language.light_verbs import BLOWS, LIGHT, reworded

_LIMBS = {"hand", "arm", "leg", "foot", "knee", "elbow", "hands", "arms"}
_OF_A_LIMB = set("the with on left right both other one".split())
_GAITS = {"walk", "run", "jog", "march", "sneak", "stroll", "go"}
_CHANGES_PACE = re.compile(
    r"(?:(?:gradually|suddenly|then|slowly|quickly|abruptly) )?(?:(?P<slower>slows?|decelerates?|(?:(?:goes|gets) )?"
    r"slower)|speeds?|accelerates?|(?:(?:goes|gets) )?faster|picks up (?:the |some )?(?:pace|speed))"
    r"(?: up| down)?(?: (?:gradually|suddenly|a bit|a little|again))?(?: (?:in)?to an? (?P<gait>walk|run|jog|sprint))?")
_SHAPES = re.compile(r"(?i)(?:in|along) an? (?:\w+ )?(?:circle|loop|arc|curve|semicircle|spiral)\b")
_GOES_ON = re.compile(r"(?:goes|moves|carries) on|keeps going|continues|resumes|proceeds")


def more_of_it(done, kind, tokens, clause):
  """The clause of words that go on from the clauses before: with no verb of their own, with that of a change of pace,
  or with one that says to go on."""
  previous, words = done[-1], lower(tokens)
  gone = next((one for one in reversed(done) if one.verb in _GAITS), None)
  if gone is not None and _GOES_ON.fullmatch(" ".join(words)):
    return gone._replace(before=[], subject=[])
  changed = _other_pace(previous, tokens)
  taken = previous.verb in LIGHT or previous.reworded or previous.steps
  if changed is None and taken and _steps(words) and kind in ("and", ",", "then"):
    return Clause([], [], "take", "take", list(tokens))  # "and one step back"
  if changed is not None or clause is not None:
    return changed
  if kind == "then":
    return _elliptic(previous, tokens)
  if kind not in ("and", ","):
    return None
  # "jumps forward twice and backward once", "punches left, right"; "walks back and forth" stays what it is.
  both = all(without_times(some)[1] is not None for some in (previous.words, tokens))
  blow = previous.verb in BLOWS and words in (["left"], ["right"])
  return _elliptic(previous, tokens) if both or blow else None


def _steps(words):
  """Whether words are no more than "two steps back"."""
  return words[1:2] in (["step"], ["steps"]) and words[0] in NUMBERS | dict.fromkeys(ONE_MORE) and (
      set(words[2:]) <= DIRECTIONS | {"to", "the"})


def _other_pace(previous, tokens):
  """The clause of "speeds up" behind "walks slowly", of "slows down to a walk" behind "runs"; None of other words."""
  found = _CHANGES_PACE.fullmatch(" ".join(lower(tokens)))
  if found is None or previous.verb not in _GAITS:
    return None
  if found["gait"]:
    return Clause([], [], found["gait"], found["gait"], [])
  words = " ".join(previous.words).replace(" at first", "").split()
  words = [word for word in words if not word.lower().endswith("ly") and word.lower() != "fast"]
  return previous._replace(words=[*words, "slowly" if found["slower"] else "quickly"], before=[], subject=[])


def _elliptic(previous, tokens):
  """The clause of "then right" behind "turns left", of "then the right hand" behind "raises the left hand"."""
  tokens, times = without_times(tokens)
  if times is not None:  # "then twice with the right hand"
    again = previous._replace(words=without_times(previous.words)[0], before=[], subject=[])
    found = _elliptic(previous, tokens) if tokens else again
    return found and found._replace(times=times)
  words = [token.lower() for token in tokens]
  if words and all(word.endswith("ly") for word in words):
    return previous._replace(words=[word for word in previous.words if not word.endswith("ly")] + list(tokens),
                             before=[], subject=[])
  adverbs = {word for word in words if word.endswith("ly")}
  if words and all(word in DIRECTIONS | {"to", "the"} | adverbs for word in words) and words != ["again"] and not (
      _LIMBS.intersection(lower(previous.words)) and words[-1] in SIDES and "to" not in words) and (
          DIRECTIONS.intersection(lower(previous.words))):
    shape = _SHAPES.match(" ".join(previous.words))  # "in a circle to the left, then to the right"
    return previous._replace(words=[*(shape[0].split() if shape else []), *tokens], before=[], subject=[])
  if words[:1] == ["in"] and previous.verb in _GAITS:  # "in a circle, then in a straight line"
    return previous._replace(words=list(tokens), before=[], subject=[])
  if words and words[0] == "like":  # "walks normally, then like an old man"
    return previous._replace(words=[word for word in previous.words if word.lower() != "normally"] + list(tokens),
                             before=[], subject=[])
  if len(words) == 2 and words[0] in ONE_MORE and actions.verb_of(words[1]):  # "followed by a jump"
    return Clause([], [], actions.verb_of(words[1]), actions.verb_of(words[1]), [])
  taken = reworded("take", tokens, NUMBERS)
  if taken is not None:  # "then a right turn", "followed by two bows"
    return Clause([], [], taken.verb, taken.verb, taken.words, taken.times, reworded=True)
  if _steps(words):  # "then a step back"
    return Clause([], [], "take", "take", list(tokens))
  limb = next((word for word in lower(previous.words) if word in _LIMBS), "")
  if words and set(words) <= POSSESSIVES | _LIMBS | _OF_A_LIMB and (
      words[-1] in _LIMBS or limb and words[-1] in (*SIDES, "other")):
    lead = ["with"] if "with" in previous.words and "with" not in words else []
    lead += ["the"] if len(words) == 1 and words[0] in SIDES else []
    side = next((SIDES[word] for word in lower(previous.words) if word in SIDES), "other")
    said = [side if word.lower() == "other" else word for word in tokens]
    return previous._replace(words=[*lead, *said, *([] if words[-1] in _LIMBS else [limb])], before=[], subject=[])
  return None
