"""What actions require of a motion, as far as it can be measured on joints: `checks.violations` measures it."""
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from motion_jax.text.morphology import verb_of
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.hand_places import hand_place_of
from motion_jax_studio.language.meaning import is_a
from motion_jax_studio.language.path_shapes import BENT, is_gait, path_shapes_of
from motion_jax_studio.language.segments import Action

# "turns on his lamp", but not "turns on the spot", "turns on his left heel", "turns off to the left".
_SWITCHES = re.compile(r"turn\w* (?:on|off) (?!to\b|(?:\w+ ){0,2}"
                       r"(?:spot|place|balls?|heels?|toes?|foot|feet|legs?|sides?|back|stomach|way)\b)")
_TURNING = re.compile(r"\bturn(?:s|ing)(?: (?:around|back|sharply|gently|quickly|slowly))*(?: to (?:the|his|her))? "
                      r"(left|right)\b|\b(left|right) turn\b")
COUNTED = {"kick", "punch", "jump", "hop", "squat", "bow"}  # events of which each is one repetition
# Degrees, least and most, of a turn by its words; a number in the text may be missed by _NEAR, or by a fifth of it.
_DEGREES = (({"full", "all", "fully", "completely"}, (290, 430)), ({"corner"}, (40, 140)),
            ({"circle", "circles"}, (290, math.inf)), ({"around", "round", "about", "back"}, (130, 230)),
            ({"left", "right"}, (40, 140)))
_NEAR = 40
_RETURNS = re.compile(r"^(?:\w+ly )?\w+(?: \w+ly)? back(?! and forth)\b|^returns?\b|"
                      r"\bto (?:the|his|her|their) (?:starting|start|original)\b")
_OTHER_WAY = re.compile(r"\bturn|\bback|\bleft and\b|\bright and\b")
_SIDE = (r"(?:(?:to|toward|towards) (?:(?:the|his|her|their|its) )?)?(left|right)(?: side)?"
         r"(?! (?:hands?|arms?|leg|foot|feet|knee|then))\b")
_ASIDE = re.compile(rf"\w+(?: \w+ly| around (?:a|the) (?:bend|corner)| forwards?| ahead| and| sideways)* {_SIDE}")


class Requirement(NamedTuple):
  """One thing that a motion has to show: an event, a state of the body, or the shape or pace of its path."""
  kind: str      # "kick", "seated", "circle", "slowly", "stays", "aside", ...
  side: str      # "left", "right", "backward" for walks, "walk" or "run" for paces; "" for any
  times: int     # repetitions
  counted: bool  # exactly this number of them, otherwise at least
  degrees: tuple[float, float] | None = None  # least and most degrees of a turn in all


def requirements_of(actions: "Sequence[Action]", text: str) -> list[Requirement]:
  """The measurable requirements of actions; none where their text is a negation ("without turning")."""
  if len(actions) == 1 and _stands_still(actions[0]):  # also "does not move"
    return [Requirement("still", "", 1, False)]
  if lexicon.NEGATIONS & set(text.lower().split()):
    return []
  shapes = path_shapes_of(actions)
  states = [(kind, "") for kind in _states(actions)]
  climbs = {_climbs(action) for action in actions} - {""}
  climbs = [(kind, "") for kind in climbs] if len(climbs) == 1 else []  # up and down again: neither can be measured
  found = {key: Requirement(*key, 1, False) for key in (*states, *shapes, *climbs, *_places(actions, shapes))}
  for action in actions:
    if is_a(action.verb, "run") and not action.is_pose:
      found["run", ""] = Requirement("run", "", 1, False)
    kind, side = _event_of(action, shapes)
    place = hand_place_of(action) if kind is None else None
    if kind is None and len(actions) == 1 and action.part == "arms" and len(action.sides) == 1 and not (
        place and place.place):  # a hand that is kept in a place does not act
      kind, side = "acts", action.sides[0]
    if kind is None or action.is_pose or action.part == "head":  # "turns the head"
      continue
    if kind == "raise":
      found[kind, side] = Requirement(kind, side, 1, len(actions) == 1)  # counted: the other hand stays below
      continue
    before = found.get((kind, side), Requirement(kind, side, 0, False))
    counted = before.counted or action.times > 1 and kind in COUNTED
    several = before.times or action.times > 1
    degrees = _degrees_of(action.words.lower()) if kind == "turn" and not several else None
    times = before.times + (action.times if kind in COUNTED else 1)
    found[kind, side] = Requirement(kind, side, times, counted, degrees)
  return list(found.values())


def _states(actions):
  """Kinds of requirements about the body as a whole."""
  if actions and all(map(_dances_in_place, actions)):
    yield "dance"
  if _ends_seated(actions):
    yield "seated"
  if actions and _gets_up(actions[-1]):
    yield "rise"


def _places(actions, shapes):
  """Requirements about where the body goes, of the only action that may go anywhere: none, to a side, or back."""
  going = [action for action in actions if action.part in ("legs", "body", "") and (
      action.verb not in lexicon.STAYING_VERBS or action.verb == "jump")]
  words = [action.words.lower() for action in going]
  gaits = [is_gait(action.verb) or action.verb in ("go", "return", "come") for action in going]
  if len(going) == 1 and going[0].part == "legs":
    verb = going[0].verb
    if lexicon.IN_PLACE.search(words[0]) or is_a(verb, "turn", "spin") and _goes_nowhere(words[0]):
      yield "stays", ""
    if is_gait(verb) and lexicon.IN_PLACE.search(words[0]):
      yield "treads", ""
    side = _ASIDE.match(words[0])
    if side and (gaits[0] or verb in {*lexicon.STEPPING, "jump", "hop"}) and not (
        any(shape.kind in BENT for shape in shapes) or _OTHER_WAY.search(words[0])):
      yield "aside", side[1]
  away = next((i for i, gait in enumerate(gaits) if gait), len(gaits))
  last = [at for at in range(away + 1, len(going)) if gaits[at]]
  if len(last) == 1 and (going[last[0]].goes_back or _RETURNS.search(words[last[0]])):
    yield "return", ""


def _goes_nowhere(words):
  return not re.search(r"\b(?:while|walk|run|jog|on (?:the|his|her|their) way|corner|and)\b", words)


def _event_of(action, shapes):
  """(kind, side) of the event of an action; (None, "") where it has none."""
  said, kind, side = action.words.lower().replace(",", " ").split(), lexicon.EVENTS.get(action.verb), ""
  words = set(said)
  if action.verb == "walk" and words & {"backward", "backwards"}:
    kind, side = "step" if action.counts_steps else "walk", "backward"
  if (is_gait(action.verb) or action.verb in lexicon.STEPPING) and not words & lexicon.PATH_NOUNS and (
      "sideways" in words or action.verb == "sidestep"):
    kind = "sideways"
  if action.verb in lexicon.LIGHT_VERBS and kind is None:
    kind = lexicon.EVENTS.get(verb_of(_head_noun(said[1:])))  # "does a couple of small kicks"
  if action.verb == "bend" and action.part == "torso" and words & lexicon.BENT_BODY:
    kind = "bend"
  if action.part == "legs" and action.verb in ("raise", "lift"):
    kind = "foot"
  if action.verb in ("balance", "stand", "stay") and re.search(r"\bon (?:\w+ ){1,2}(?:leg|foot)\b", " ".join(said)):
    kind = "balance"
  if kind == "turn" and (action.part not in ("legs", "") or _SWITCHES.match(action.words.lower())):
    kind = None  # "rotates the wrists", "turns on the light"
  if action.verb == "lie" and "down" in words:
    kind = "lie"
  if action.verb in ("raise", "lift") and action.part == "arms" and (
      not words & lexicon.NOT_RAISED or words & lexicon.UP) and not lexicon.ARMS.isdisjoint(
          action.words.lower().split(" with ")[0].split()):  # not "lifts a box with both hands"
    kind, side = "raise", "both" if len(action.sides) == 2 else next(iter(action.sides), "")
  if action.verb in lexicon.STRIKES and words & lexicon.FISTS:
    kind = "punch"
  turning = _TURNING.search(action.words.lower()) if kind is None and is_gait(action.verb) else None
  if turning and not any(shape.kind in BENT for shape in shapes):  # "walks, turning to the left"
    kind, side = "turn", turning[1] or turning[2]
  if kind == "turn":  # the right foot is no way to turn
    words = {word for word, thing in zip(said, [*said[1:], ""]) if thing not in lexicon.LIMBS - {"shoulder"}}
  named = {"left", "right"} & words
  if kind in lexicon.SIDED_EVENTS and not side and len(named) == 1:
    side = named.pop()
  return kind, side


def _head_noun(words):
  """The last word of the noun phrase that an object is: "kicks" of "a couple of small kicks with the left leg"."""
  end = next((i for i, word in enumerate(words) if word in {*lexicon.AFTER_A_NOUN, "and"} - {"forward", "high"}
              and i and words[i - 1] not in ("a", "the")), len(words))
  return words[end - 1] if end else ""


def is_counted(requirements: Sequence[Requirement]) -> bool:
  """Whether all that is required is one event that can be counted: a kick, a jump, a bow."""
  return len(requirements) == 1 and requirements[0].kind in COUNTED


def once(requirements: Sequence[Requirement]) -> list[Requirement]:
  """The same requirements, in which an event that can be counted occurs exactly once."""
  return [one._replace(counted=True) if one.kind in COUNTED and one.times == 1 else one for one in requirements]


def _degrees_of(words):
  """(least, most) degrees of a turn by its words, None where they give none."""
  number = re.search(r"(\d+)(?: ?°| degrees?)", words)
  if number:
    degrees = float(number[1])
    tolerance = max(_NEAR, degrees / 5)
    return degrees - tolerance, degrees + tolerance
  return next((span for names, span in _DEGREES if names & set(words.split())), None)


def _ends_seated(actions):
  """Whether sitting down comes last, apart from actions on the chair: staying there, waving."""
  on_the_chair = [action.words == lexicon.HOLD or action.part in ("arms", "head") for action in actions]
  last = next((i for i, action in enumerate(actions) if action.words == lexicon.HOLD and all(on_the_chair[i:])),
              len(actions))
  return any(action.verb == "sit" for action in actions[last - 1:last])


def _dances_in_place(action):
  words = set(action.words.lower().split())
  is_dance = action.verb == "dance" or action.verb in lexicon.LIGHT_VERBS and bool(words & {"dance", "dances"})
  return is_dance and not words & lexicon.ELSEWHERE


def _climbs(action):
  """"ascend" or "descend" for stairs, a ladder and the like, "" for other actions."""
  words = set(action.words.lower().replace(",", " ").split()[1:])
  if words & lexicon.ACROSS or {"up", "down"} <= words:
    return ""
  on_stairs = words & lexicon.STAIRS and (is_gait(action.verb) or action.verb in ("step", "go", "come", "move"))
  if action.verb == "descend" or "down" in words and (action.verb == "climb" or on_stairs):
    return "descend"
  return "ascend" if action.verb == "climb" or "up" in words and on_stairs else ""


def _stands_still(action):
  words = set(action.words.lower().split())
  return action.verb in ("stand", "stay") and bool({"still", "place", "motionless"} & words) and not (
      words & lexicon.LIMBS)  # "standing still lifts an arm"


def _gets_up(action):
  words = set(action.words.lower().split())
  rises = any(action.verb == verb and word in words | {""} for verb, word in lexicon.GETTING_UP)
  return rises and not words & lexicon.UPRIGHT
