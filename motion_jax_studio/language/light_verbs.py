"""Light verbs: other words than the verb name the action, as in "takes two bows" or "puts her hands up".

Each rule rewrites the action with a verb of its own, as most motion captions do. The first rule that applies counts.
"""
import re
from collections.abc import Sequence

from motion_jax.text import wordnet
from motion_jax.text.morphology import verb_of
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.counting import without_times
from motion_jax_studio.language.hand_places import limb_at
from motion_jax_studio.language.meaning import pace_of
from motion_jax_studio.language.words import normalize

_UP = {"up", "overhead", "air", "sky", "head"}
_UPWARD = _UP | lexicon.NUMBERS.keys() | set(
    "straight high in into the above over his her their slowly quickly again once twice thrice times".split())
# "step to the left", "sidestep right", "take a step sideways", "take side steps to his right"
_TO_A_SIDE = r"(?:to )?(?:(?:the|his|her|their|its) )?(?P<side>left|right|side)(?: side)?"
_SOME = r"(?:(?:an?|some|several|a few|another) )?(?:(?:small|big|large|little|short|long|quick|slow) )*"
_SIDE_STEPS = re.compile(
    rf"(?:(?:sidestep|strafe|(?:step|shuffle|walk|move) sideways|(?:take|do|make) {_SOME}(?:sidesteps?|sideways steps?|"
    rf"steps? sideways))(?: {_TO_A_SIDE})?|step {_TO_A_SIDE.replace('<side>', '<way>')})"
    r"(?: (?P<times>once|twice|thrice|\w+ times))?(?P<after>(?: (?:slowly|quickly|again))*(?: (?:,|with|in|and) .+)?)")
_MOTION = re.compile(r"(?:an? )?(?:\w+ )?(?P<verb>\w+ing) (?:motion|movement|gesture|action)s?\b")
_TO_A_POSTURE = {"from", "in", "out", "off", "to", "into", "back", "down", "position", "pose", "posture"}


def reworded(verb: str, words: Sequence[str]) -> tuple[str, list[str], int] | None:
  """(verb, the words after it, repetitions) that a verb and its words mean; None where no rule applies ("does a front
  kick")."""
  action = next((action for rule in _RULES if (action := rule(verb, words)) is not None), None)
  return action and (*action, 1)[:3]


def _start_in_a_posture(verb, words):
  postures = [word for word in normalize(words).split() if word not in _TO_A_POSTURE]
  if verb not in ("start", "begin", "return") or len(postures) != 1:
    return None
  posture = "sit" if postures == ["seated"] else verb_of(postures[0])
  if posture not in lexicon.LOW | {"stand"}:
    return None
  return (posture, {"lie": ["down"], "stand": ["still"]}.get(posture, []))


def _come_to_a_stop(verb, words):
  stops = verb == "come" and words[:2] in (["to", "a"], ["to", "an"]) and words[-1] in lexicon.STANDSTILLS
  return ("stop", []) if stops else None


def _strike_with_explicit_side(verb, words):
  if verb not in lexicon.LIMB_OF_ACTION or words[:1] not in (["left"], ["right"]) or without_times(words[1:])[0]:
    return None
  return (verb, ["with", "the", words[0], lexicon.LIMB_OF_ACTION[verb], *words[1:]])


def _put_hands_up(verb, words):
  limb = limb_at(tuple(words), int(words[:1] == ["up"])) if verb in lexicon.PUTTING_VERBS else None
  if limb is None or not limb.ends or not _UPWARD.issuperset(limb.after) or _UP.isdisjoint(words):
    return None
  which = ["the", *limb.sides] if len(limb.sides) == 1 else ["both"] if limb.sides else ["a"]
  where = [word for word in limb.after if word not in ("up", "straight")]
  return ("raise", [*which, limb.thing, *where])


def _side_steps(verb, words):
  steps = _SIDE_STEPS.fullmatch(" ".join([verb, *words]))
  if steps is None:
    return None
  side = {"left": "left", "right": "right"}.get(steps["side"] or steps["way"] or "", "")
  way = ["to", "the", side] if side else []
  times = {"once": "one", "twice": "two", "thrice": "three"}.get(steps["times"], (steps["times"] or "").split(" ")[0])
  if times in lexicon.NUMBERS:  # counted steps have a duration
    return ("take", [times, "steps", *(way or ["sideways"]), *steps["after"].split()])
  return ("walk", ["sideways", *way, *steps["after"].split()])


def _stretch(verb, words):
  bare = verb == "stretch" and all(word.endswith("ly") or word in ("out", "again") for word in words)
  return (verb, ["both", "arms", "up", *(word for word in words if word != "out")]) if bare else None


def _motion_of_an_action(verb, words):
  motion = _MOTION.match(" ".join(words)) if verb in lexicon.LIGHT_VERBS else None
  base = motion and verb_of(motion["verb"])
  return (base, words[len(motion[0].split()):]) if base else None


def _steps_at_a_pace(verb, words):
  pace = pace_of(words[0]) if verb == "take" and words[1:2] == ["steps"] else ""
  after = words[2:]
  if not pace or after and after[0] not in (*lexicon.AFTER_A_NOUN, "ahead"):
    return None
  return ("walk", [*(["forward"] if after in (["ahead"], []) else after), pace])


def _noun_of_an_action(verb, words):
  if verb == "go" and words[:1] == ["for"]:
    verb, words = "take", words[1:]  # "goes for a walk"
  times, rest = _number_in_front(words)
  if verb not in lexicon.LIGHT_VERBS or rest is None:
    return None  # "does squats"
  side, paces, adverbs = "", [], []
  while rest and (rest[0] in lexicon.SIDES or rest[0] in lexicon.ADVERBS or pace_of(rest[0])):
    if rest[0] in lexicon.SIDES:
      side = rest[0]
    elif pace_of(rest[0]):
      paces = [pace_of(rest[0])]
    else:
      adverbs.append(lexicon.ADVERBS[rest[0]])  # "does a forward kick"
    rest = rest[1:]
  if rest[:1] in (["90"], ["180"], ["360"]) and rest[1:2] not in (["degree"], ["degrees"]):  # "does a 180"
    rest = [rest[0], "degrees", *(rest[1:] if rest[1:2] in (["turn"], ["spin"]) else ["turn", *rest[1:]])]
  if rest[1:2] in (["degree"], ["degrees"]) and rest[0].isdigit():  # "does a 180 degree turn"
    adverbs, rest = [*adverbs, rest[0], "degrees"], rest[2:]
  base = _verb_of_noun(rest[0]) if rest else []
  if not base or times < 1 or rest[1:] and rest[1] not in lexicon.AFTER_A_NOUN or (
      side and base[0] not in (*lexicon.LIMB_OF_ACTION, "turn")):
    return None
  with_side = [] if not side else [side] if base[0] == "turn" else [
      "with", "the", side, lexicon.LIMB_OF_ACTION[base[0]]]
  return (base[0], [*base[1:], *adverbs, *with_side, *words[len(words) - len(rest) + 1:], *paces], times)


def _verb_of_noun(noun):
  """The words of the action that a noun names: ["bow"] of "bows"; [] of a noun that names none."""
  for form in (noun, noun.removesuffix("s"), noun.removesuffix("es")):
    if form in lexicon.IDIOMS:
      return lexicon.IDIOMS[form].split()
    if verb := "" if form in lexicon.NO_ACTION_NOUNS else wordnet.verb_of_noun(form):
      return [verb]
  return []


def _number_in_front(words):
  """(repetitions, the words after the number or article); (1, None) where there is neither."""
  first = words[0] if words else ""
  if first in lexicon.NUMBERS and first not in lexicon.ARTICLES:
    return int(lexicon.NUMBERS[first]), words[1:]
  if first not in lexicon.ARTICLES:
    return 1, None
  if words[1:3] == ["couple", "of"]:
    return 2, words[3:]
  return (3, words[2:]) if words[1:2] == ["few"] else (1, words[1:])


_RULES = (_start_in_a_posture, _come_to_a_stop, _strike_with_explicit_side, _put_hands_up, _side_steps,
          _stretch, _motion_of_an_action, _steps_at_a_pace, _noun_of_an_action)
