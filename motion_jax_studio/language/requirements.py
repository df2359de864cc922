"""What actions require of a motion, as far as it can be measured on joints: `checks.violations` measures it."""
import math
from collections.abc import Sequence
from typing import NamedTuple

from motion_jax.text.morphology import verb_of
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.meaning import is_a
from motion_jax_studio.language.path_shapes import BENT, is_gait, path_shapes_of
from motion_jax_studio.language.segments import Action
from motion_jax_studio.language.words import first_of, said, says

COUNTED = {"kick", "punch", "jump", "hop", "squat", "bow"}  # events of which each is one repetition
# (least, most) degrees of a turn by its words. A number in the text has a tolerance of _NEAR degrees, or a fifth of it.
_DEGREES = (((290, 430), "full, all, fully, completely"), ((40, 140), "corner"), ((290, math.inf), "circle, circles"),
            ((130, 230), "around, round, about, back"), ((40, 140), "left, right"))
_NEAR = 40
_ON_FOOT = ("on leg, on foot, on one leg, on one foot, on left leg, on left foot, on right leg, on right foot, "
            "on other leg")
# "turns on his lamp", but not "turns on the spot", "turns on his left heel", "turns off to the left".
_NO_LAMP = set("to spot place ball balls heel heels toe toes foot feet leg legs side sides back stomach way".split())
_TURNING = (("left", "turns left, turning left, turns to left, turning to left, left turn"),
            ("right", "turns right, turning right, turns to right, turning to right, right turn"))
_ADVERBS = set("around back sharply gently quickly slowly".split())  # between "turns" and the side
_TO_A_SIDE = set("around bend corner forward forwards ahead and sideways to toward towards".split())
_NO_SIDE = set("hand hands arm arms leg foot feet knee then bend circle curve corner sided".split())  # after "left"


_ACROSS = "over, through, under, into, in, out, off, on, onto, around"  # no climb up or down
_ON_STAIRS = ", ".join(sorted(lexicon.STAIRS))
_UPRIGHT = "straight, tall, upright"  # "stands up straight" is no getting up
_ELSEWHERE = ("across, along, around, away, backward, backwards, circle, circles, forward, forwards, into, left, out, "
              "right, round, sideways, through, toward, towards")  # words that take a dance to another place
_NOT_UP = ("to, out, front, side, sides, sideways, forward, chest, waist, stomach, hip, hips, face, mouth, shoulder, "
           "level, low, slightly, halfway, parallel, down, bent, across, behind, again")  # of a raised hand
_SHAPED = ", ".join(sorted(lexicon.PATH_NOUNS))


class _Sign(NamedTuple):
  """A rule by which the verb, body part and phrases of an action show a state or an event."""
  kind: str
  verbs: str            # "gait" stands for all kinds of walking and running
  part: str = ""        # of the body; "" for any
  needed: tuple[str, ...] = ()  # lists of phrases; the action has a phrase of each list
  lacking: str = ""     # phrases that the action does not have

  def shows(self, action):
    after = said(action.said.split()[1:])  # "steps up" has no steps
    return (action.verb in self.verbs.split() or "gait" in self.verbs and is_gait(action.verb)) and (
        self.part in ("", action.part) and all(says(after, phrases) for phrases in self.needed)) and not (
            self.lacking and says(after, self.lacking))


_STATES = (
    _Sign("still", "stand stay", "", ("still, place, motionless",), ", ".join(sorted(lexicon.LIMBS))),
    _Sign("dance", "dance", lacking=_ELSEWHERE),
    _Sign("dance", " ".join(sorted(lexicon.LIGHT_VERBS)), "", ("dance, dances",), _ELSEWHERE),
    _Sign("rise", "stand get", "", ("up",), _UPRIGHT), _Sign("rise", "rise", lacking=_UPRIGHT),
    _Sign("descend", "descend", lacking=_ACROSS), _Sign("descend", "climb", "", ("down",), f"up, {_ACROSS}"),
    _Sign("descend", "gait step go come move", "", ("down", _ON_STAIRS), f"up, {_ACROSS}"),
    _Sign("ascend", "climb", lacking=f"down, {_ACROSS}"),
    _Sign("ascend", "gait step go come move", "", ("up", _ON_STAIRS), f"down, {_ACROSS}"))
_EVENTS = (
    _Sign("punch", "strike hit", "", ("fist, fists",)), _Sign("raise", "raise lift", "arms", (), _NOT_UP),
    _Sign("lie", "lie", "", ("down",)), _Sign("balance", "balance stand stay", "", (_ON_FOOT,)),
    _Sign("foot", "raise lift", "legs"), _Sign("bend", "bend", "torso", ("over, forward, forwards, down, waist",)),
    _Sign("sideways", "gait step take move slide go", "", ("sideways",), _SHAPED),
    _Sign("sideways", "sidestep", lacking=_SHAPED), _Sign("walk", "walk", "", ("backward, backwards",)))


class Requirement(NamedTuple):
  """One thing that a motion must show: an event, a state of the body, or the shape or pace of its path."""
  kind: str      # "kick", "seated", "circle", "slowly", "stays", "aside", ...
  side: str      # "left", "right", "backward" for walks, "walk" or "run" for paces; "" for any
  times: int     # repetitions
  counted: bool  # exactly this number of them, otherwise at least
  degrees: tuple[float, float] | None = None  # least and most degrees of a turn in all


def requirements_of(actions: Sequence[Action], text: str) -> list[Requirement]:
  """The measurable requirements of actions; none where their text is a negation ("without turning")."""
  if len(actions) == 1 and "still" in _states_of(actions[0]):  # also "does not move"
    return [Requirement("still", "", 1, False)]
  if lexicon.NEGATIONS & set(text.lower().split()):
    return []
  shapes = path_shapes_of(actions)
  climbs = {kind for action in actions for kind in _states_of(action) if kind in ("ascend", "descend")}
  climbs = climbs if len(climbs) == 1 else ()  # up and down again: neither can be measured
  states, climbs = ([(kind, "") for kind in kinds] for kinds in (_states(actions), climbs))
  required = {key: Requirement(*key, 1, False) for key in (*states, *shapes, *climbs, *_places(actions, shapes))}
  for action in actions:
    if is_a(action.verb, "run") and not action.is_pose:
      required["run", ""] = Requirement("run", "", 1, False)
    kind, side = _event_of(action, shapes)
    if kind is None and len(actions) == 1 and action.part == "arms" and len(action.sides) == 1 and not (
        action.hands and action.hands.place):  # a hand that is kept in a place does not act
      kind, side = "acts", action.sides[0]
    if kind is None or action.is_pose or action.part == "head":  # "turns the head"
      continue
    if kind == "raise":
      required[kind, side] = Requirement(kind, side, 1, len(actions) == 1)  # counted: the other hand stays below
      continue
    before = required.get((kind, side), Requirement(kind, side, 0, False))
    degrees = _degrees_of(action.said) if kind == "turn" and not before.times and action.times == 1 else None
    times = before.times + (action.times if kind in COUNTED else 1)
    counted = before.counted or action.times > 1 and kind in COUNTED
    required[kind, side] = Requirement(kind, side, times, counted, degrees)
  return list(required.values())


def _states_of(action):
  return {sign.kind for sign in _STATES if sign.shows(action)}


def _states(actions):
  """Kinds of requirements about the body as a whole."""
  if actions and all("dance" in _states_of(action) for action in actions):
    yield "dance"
  if _ends_seated(actions):
    yield "seated"
  if actions and "rise" in _states_of(actions[-1]):
    yield "rise"


def _places(actions, shapes):
  """Requirements on where the body goes: in place or to a side, by the only action that moves it, or back."""
  going = [action for action in actions
           if action.part in ("legs", "body", "") and action.verb not in lexicon.STAYING_VERBS]
  gaits = [is_gait(action.verb) or action.verb in ("go", "return", "come") for action in going]
  bent = any(shape.kind in BENT for shape in shapes)
  if len(going) == 1 and going[0].part == "legs":
    action = going[0]
    if action.is_in_place or is_a(action.verb, "turn", "spin") and not says(
        action.said, "while, walk, run, jog, on way, corner, and"):
      yield "stays", ""
    if is_gait(action.verb) and action.is_in_place:
      yield "treads", ""
    side = _side_of(action.said.split())
    if side and (gaits[0] or action.verb in {*lexicon.STEPPING, "jump", "hop"}) and not bent and not says(
        action.said, "turn*, back*, left and, right and"):
      yield "aside", side
  away = next((i for i, gait in enumerate(gaits) if gait), len(gaits))
  last = [action for action, gait in zip(going[away + 1:], gaits[away + 1:]) if gait]
  if len(last) == 1 and (last[0].goes_back or last[0].leads_back or (
      last[0].verb == "return" or says(last[0].said, "to starting, to start, to original"))):
    yield "return", ""


def _side_of(words):
  """The side named next to the verb, words[0]; "" for another direction."""
  at = next((at for at, word in enumerate(words) if at and word not in _TO_A_SIDE and not word.endswith("ly")), 0)
  after = words[at + 2:at + 3] if words[at + 1:at + 2] == ["side"] else words[at + 1:at + 2]
  return words[at] if words[at] in lexicon.SIDES and _NO_SIDE.isdisjoint(after) else ""


def _event_of(action, shapes):
  """(kind, side) of the event of an action; (None, "") where it has none."""
  words = action.said.replace(" , ", " ").split()
  kind = lexicon.EVENTS.get(action.verb)
  if action.verb in lexicon.LIGHT_VERBS and kind is None:
    kind = lexicon.EVENTS.get(verb_of(_head_noun(words[1:])))  # "does a couple of small kicks"
  if kind == "turn" and (action.part not in ("legs", "") or _switches(words)):
    kind = None  # "rotates the wrists", "turns on the light"
  kind = next((sign.kind for sign in _EVENTS if sign.shows(action)), kind)
  if kind == "raise":  # not "lifts a box with both hands"
    lifts = not lexicon.ARMS.isdisjoint(action.said.split(" with ")[0].split())
    return (kind, "both" if len(action.sides) == 2 else "".join(action.sides)) if lifts else (None, "")
  if kind == "walk":
    return "step" if action.counts_steps else kind, "backward"
  if kind is None and is_gait(action.verb) and not any(shape.kind in BENT for shape in shapes):
    side = first_of(_TURNING, said(word for word in words if word not in _ADVERBS), "")  # "walks, turning to the left"
    return ("turn", side) if side else (None, "")
  things = lexicon.LIMBS - {"shoulder"} if kind == "turn" else ()  # the right foot is no way to turn
  sides = {word for word, thing in zip(words, [*words[1:], ""]) if word in lexicon.SIDES and thing not in things}
  return kind, sides.pop() if kind in lexicon.SIDED_EVENTS and len(sides) == 1 else ""


def _switches(said):
  return said[0].startswith("turn") and said[1:2] in (["on"], ["off"]) and len(said) > 2 and (
      _NO_LAMP.isdisjoint(said[2:5]))


def _head_noun(words):
  """The last word of the noun phrase that an object is: "kicks" of "couple of small kicks with left leg"."""
  end = next((i for i, word in enumerate(words) if i and word in lexicon.AFTER_A_NOUN | {"and"}), len(words))
  return words[end - 1] if end else ""


def is_counted(requirements: Sequence[Requirement]) -> bool:
  """Whether the only requirement is an event that can be counted: a kick, a jump, a bow."""
  return len(requirements) == 1 and requirements[0].kind in COUNTED


def once(requirements: Sequence[Requirement]) -> list[Requirement]:
  """The same requirements, in which an event that can be counted occurs exactly once."""
  return [requirement._replace(counted=True) if requirement.kind in COUNTED and requirement.times == 1 else requirement
          for requirement in requirements]


def _degrees_of(text):
  """(least, most) degrees of a turn by its words, None where they give none."""
  words = text.replace("°", " degrees ").split()
  number = next((float(word) for word, unit in zip(words, words[1:])
                 if word.isdigit() and unit.startswith("degree")), 0)
  tolerance = max(_NEAR, number / 5)
  return (number - tolerance, number + tolerance) if number else first_of(_DEGREES, text)


def _ends_seated(actions):
  """Whether sitting down comes last, apart from actions on the chair: staying there, waving."""
  on_the_chair = [action.words == lexicon.HOLD or action.part in ("arms", "head") for action in actions]
  last = next((i for i, action in enumerate(actions) if action.words == lexicon.HOLD and all(on_the_chair[i:])),
              len(actions))
  return any(action.verb == "sit" for action in actions[last - 1:last])
