"""Slots of an action: what its words say of hands, trunk, path and checks, read once when the action is made.

Each slot is read from tables of phrases (`words`): a row says which verbs and phrases fill the slot, and which exclude
it. All other files, and the rooms that plan, pose and check, read the slots and no words.
"""
import functools
import math
from typing import NamedTuple

from motion_jax.text.morphology import is_participle, verb_of
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.hand_places import HandPlace, hand_place_of, without_hands
from motion_jax_studio.language.meaning import is_a
from motion_jax_studio.language.path_shapes import PathShape, course_of, is_gait, shapes_of
from motion_jax_studio.language.words import has_phrase, lookup, normalize, tokens, until

# (rows of states, then of events) kind; verbs, "gait" for all kinds of walking and running, "turning" for all kinds of
# turning, "" for any; body part; lists of phrases, the action has a phrase of each; phrases that it does not have.
_ON_STAIRS = ", ".join(sorted(lexicon.STAIRS))
_ACROSS = "over, through, under, into, in, out, off, on, onto, around"  # no climb up or down
_UPRIGHT = "straight, tall, upright"  # "stands up straight" is no getting up
_ELSEWHERE = ("across, along, around, away, backward, backwards, circle, circles, forward, forwards, into, left, out, "
              "right, round, sideways, through, toward, towards")  # words that take a dance to another place
_STATES = (
    ("still", "stand stay", "", ("still, place, motionless",), ", ".join(sorted(lexicon.LIMBS))),
    ("dance", "dance", "", (), _ELSEWHERE),
    ("dance", " ".join(sorted(lexicon.LIGHT_VERBS)), "", ("dance, dances",), _ELSEWHERE),
    ("rise", "stand get", "", ("up",), _UPRIGHT), ("rise", "rise", "", (), _UPRIGHT),
    ("descend", "descend", "", (), _ACROSS), ("descend", "climb", "", ("down",), f"up, {_ACROSS}"),
    ("descend", "gait step go come move", "", ("down", _ON_STAIRS), f"up, {_ACROSS}"),
    ("ascend", "climb", "", (), f"down, {_ACROSS}"),
    ("ascend", "gait step go come move", "", ("up", _ON_STAIRS), f"down, {_ACROSS}"),
    ("stays", "", "legs", (lexicon.IN_PLACE,), ""),
    ("stays", "turning", "legs", (), "while, walk, run, jog, on way, corner, and"),
    ("treads", "gait", "legs", (lexicon.IN_PLACE,), ""),
    ("returns", "return", "", (), ""), ("returns", "", "", ("to starting, to start, to original",), ""))
_NOT_UP = ("to, out, front, side, sides, sideways, forward, chest, waist, stomach, hip, hips, face, mouth, shoulder, "
           "level, low, slightly, halfway, parallel, down, bent, across, behind, again")  # of a raised hand
_ON_FOOT = ("on leg, on foot, on one leg, on one foot, on left leg, on left foot, on right leg, on right foot, "
            "on other leg")
_SHAPED = ", ".join(sorted(lexicon.PATH_NOUNS))
_EVENTS = (
    ("punch", "strike hit", "", ("fist, fists",), ""), ("raise", "raise lift", "arms", (), _NOT_UP),
    ("lie", "lie", "", ("down",), ""), ("balance", "balance stand stay", "", (_ON_FOOT,), ""),
    ("foot", "raise lift", "legs", (), ""), ("bend", "bend", "torso", ("over, forward, forwards, down, waist",), ""),
    ("sideways", "gait step take move slide go", "", ("sideways",), _SHAPED),
    ("sideways", "sidestep", "", (), _SHAPED), ("walk", "walk", "", ("backward, backwards",), ""))
# "turns on his lamp", but not "turns on the spot", "turns on his left heel", "turns off to the left".
_NO_LAMP = set("to spot place ball balls heel heels toe toes foot feet leg legs side sides back stomach way".split())
_TURNING = (("left", "turns left, turning left, turns to left, turning to left, left turn"),
            ("right", "turns right, turning right, turns to right, turning to right, right turn"))
_ADVERBS = set("around back sharply gently quickly slowly".split())  # between "turns" and the side
# (least, most) degrees of a turn by its words. A number in the text has a tolerance of _NEAR degrees, or a fifth of it.
_DEGREES = (((290, 430), "full, all, fully, completely"), ((40, 140), "corner"), ((290, math.inf), "circle, circles"),
            ((130, 230), "around, round, about, back"), ((40, 140), "left, right"))
_NEAR = 40
_TO_A_SIDE = set("around bend corner forward forwards ahead and sideways to toward towards".split())
_NO_SIDE = set("hand hands arm arms leg foot feet knee then bend circle curve corner sided".split())  # after "left"

_LEANING, _SWAYING = {"lean", "sway", "tilt", "rock", "slouch", "slump", "hunch"}, {"sway", "rock"}
_NO_TRUNK = set("head neck hand hands arm arms leg legs foot feet hip hips heel heels toe toes on against chair seat "
                "sofa couch ground floor while then".split())
_LEANS = (
    ((0, 1, True), "back and forth, forward and backward, forwards and backwards, front to back"),
    ((1, 0, True), "side to side, left and right, right and left, left to right, right to left"),
    ((1, 0, False), "left"), ((-1, 0, False), "right"), ((0, -1, False), "back, backward, backwards"),
    ((0, 1, False), "forward, forwards, over, down, ahead, in"))


class Lean(NamedTuple):
  """A lean of the trunk."""
  direction: tuple[int, int]  # to the left, ahead: 1, 0 or -1
  sways: bool  # between this direction and the opposite one, repeatedly


class Event(NamedTuple):
  """An event that an action requires (`requirements`)."""
  kind: str
  side: str = ""
  degrees: tuple[float, float] | None = None  # least and most, of a turn


class Slots(NamedTuple):
  """What the words of an action say."""
  hands: HandPlace | None = None  # a hand pose or gesture
  lean: Lean | None = None
  shapes: tuple[PathShape, ...] = ()  # shape and pace of the path
  course: str | None = None  # the side that a walk leads to, "" for a walk elsewhere, None for other actions
  aside: str = ""  # the side named next to the verb, where the body may go to that side
  event: Event | None = None
  states: frozenset[str] = frozenset()  # still, dance, rise, ascend, descend, stays, treads, returns
  is_backward: bool = False
  stays: bool = False  # done on the spot: sits down, but not "kicks forward"
  leads_back: bool = False  # "walks back to the door", but not "walks back and forth"


@functools.lru_cache(maxsize=1 << 14)
def slots_of(verb: str, part: str, sides: tuple[str, ...], times: int, text: str) -> Slots:
  """The slots of an action by its verb, body part, arms, repetitions and words."""
  all_words = tokens(text)
  whole = normalize(all_words)
  words = whole.split()
  after, plain = normalize(words[1:]), [word for word in words if not word.endswith("ly")]
  states = frozenset(kind for kind, *row in _STATES if _shows(row, verb, part, after))
  return Slots(
      hand_place_of(verb, part, sides, times, all_words), _lean_of(verb, text), shapes_of(verb, all_words),
      course_of(verb, part, whole), _aside_of(whole), _event_of(verb, part, sides, after, words, whole), states,
      has_phrase(whole, "backward, backwards"), _stays(verb, part, words),
      plain[1:2] == ["back"] and plain[2:4] != ["and", "forth"])


def _shows(row, verb, part, after):
  """Whether an action shows the state or event of a row; after: its words after the first."""
  verbs, row_part, needed, lacking = row
  named = verbs.split()
  return (not named or verb in named or "gait" in named and is_gait(verb) or (
      "turning" in named and is_a(verb, "turn", "spin"))) and row_part in ("", part) and (
          all(has_phrase(after, phrases) for phrases in needed)) and not (lacking and has_phrase(after, lacking))


def _stays(verb, part, words):
  travels = not {"forward", "forwards", "sideways", "around"}.isdisjoint(words)
  return part in ("arms", "head", "torso") or verb in lexicon.STAYING_VERBS and not travels


def _event_of(verb, part, sides, after, words, whole):
  words = [word for word in words if word != ","]
  kind = lexicon.EVENTS.get(verb)
  if verb in lexicon.LIGHT_VERBS and kind is None:
    kind = lexicon.EVENTS.get(verb_of(_head_noun(words[1:])))  # "does a couple of small kicks"
  if kind == "turn" and (part not in ("legs", "") or _switches(words)):
    kind = None  # "rotates the wrists", "turns on the light"
  kind = next((row_kind for row_kind, *row in _EVENTS if _shows(row, verb, part, after)), kind)
  if kind == "raise":  # not "lifts a box with both hands"
    lifts = not lexicon.ARMS.isdisjoint(whole.split(" with ")[0].split())
    return Event(kind, "both" if len(sides) == 2 else "".join(sides)) if lifts else None
  if kind == "walk":
    return Event(kind, "backward")
  if kind is None:  # "walks, turning to the left"
    side = is_gait(verb) and lookup(_TURNING, normalize(word for word in words if word not in _ADVERBS))
    return Event("turn", side, _degrees_of(whole)) if side else None
  things = lexicon.LIMBS - {"shoulder"} if kind == "turn" else ()  # the right foot is no way to turn
  named = {word for word, thing in zip(words, [*words[1:], ""]) if word in lexicon.SIDES and thing not in things}
  return Event(kind, named.pop() if kind in lexicon.SIDED_EVENTS and len(named) == 1 else "",
               _degrees_of(whole) if kind == "turn" else None)


def _switches(words):
  return words[0].startswith("turn") and words[1:2] in (["on"], ["off"]) and len(words) > 2 and (
      _NO_LAMP.isdisjoint(words[2:5]))


def _head_noun(words):
  """The last word of the noun phrase that an object is: "kicks" of "couple of small kicks with left leg"."""
  end = next((i for i, word in enumerate(words) if i and word in lexicon.AFTER_A_NOUN | {"and"}), len(words))
  return words[end - 1] if end else ""


def _degrees_of(text):
  """(least, most) degrees of a turn by its words, None where they give none."""
  words = text.replace("°", " degrees ").split()
  number = next((float(word) for word, unit in zip(words, words[1:])
                 if word.isdigit() and unit.startswith("degree")), 0)
  tolerance = max(_NEAR, number / 5)
  return (number - tolerance, number + tolerance) if number else lookup(_DEGREES, text)


def _aside_of(whole):
  words = whole.split()
  at = next((at for at, word in enumerate(words) if at and word not in _TO_A_SIDE and not word.endswith("ly")), 0)
  after = words[at + 2:at + 3] if words[at + 1:at + 2] == ["side"] else words[at + 1:at + 2]
  is_side = words and words[at] in lexicon.SIDES and _NO_SIDE.isdisjoint(after)
  return words[at] if is_side and not has_phrase(whole, "turn*, back*, left and, right and") else ""


def _lean_of(verb, text):
  if verb not in _LEANING:
    return None
  words = until(tokens(without_hands(text)), {","})
  of_a_thing = not (lexicon.DETERMINERS | lexicon.POSSESSIVES).isdisjoint(words[1:2])
  if of_a_thing or not _NO_TRUNK.isdisjoint(words) or any(map(is_participle, words[1:])):
    return None
  left, ahead, sways = lookup(_LEANS, normalize(words), (1, 0, True) if verb in _SWAYING else (0, 1, False))
  return Lean((left, ahead), sways)
