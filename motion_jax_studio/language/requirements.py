"""What actions require of a motion, as far as it can be measured on joints: `checks.violations` measures it."""
from collections.abc import Sequence
from typing import NamedTuple

from motion_jax_studio.language import lexicon
from motion_jax_studio.language.actions import Action
from motion_jax_studio.language.meaning import is_a
from motion_jax_studio.language.path_shapes import BENT, is_gait, path_shapes_of

COUNTED = {"kick", "punch", "jump", "hop", "squat", "bow"}  # events of which each is one repetition
_GOING = {"go", "return", "come"}  # verbs besides walking that lead somewhere


class Requirement(NamedTuple):
  """One thing that a motion must show: an event, a state of the body, or the shape or pace of its path."""
  kind: str      # "kick", "seated", "circle", "slowly", "stays", "aside", ...
  side: str      # "left", "right", "backward" for walks, "walk" or "run" for paces; "" for any
  times: int     # repetitions
  counted: bool  # exactly this number of them, otherwise at least
  degrees: tuple[float, float] | None = None  # least and most degrees of a turn in all


def requirements_of(actions: Sequence[Action], text: str) -> list[Requirement]:
  """The measurable requirements of actions; none where their text is a negation ("without turning")."""
  if len(actions) == 1 and "still" in actions[0].slots.states:  # also "does not move"
    return [Requirement("still", "", 1, False)]
  if lexicon.NEGATIONS & set(text.lower().split()):
    return []
  shapes = path_shapes_of(actions)
  required = {key: Requirement(*key, 1, False) for key in (*_states(actions), *shapes, *_climbs(actions),
                                                           *_places(actions, shapes))}
  for action in actions:
    if is_a(action.verb, "run"):
      required["run", ""] = Requirement("run", "", 1, False)
    kind, side, degrees = _event_of(action, shapes, len(actions) == 1) or ("", "", None)
    if not kind or action.part == "head":  # "turns the head"
      continue
    if kind == "raise":
      required[kind, side] = Requirement(kind, side, 1, len(actions) == 1)  # counted: the other hand stays below
      continue
    before = required.get((kind, side), Requirement(kind, side, 0, False))
    times = before.times + (action.times if kind in COUNTED else 1)
    counted = before.counted or action.times > 1 and kind in COUNTED
    degrees = None if before.times or action.times > 1 else degrees
    required[kind, side] = Requirement(kind, side, times, counted, degrees)
  return list(required.values())


def _event_of(action, shapes, alone):
  """(kind, side, degrees) of the event of an action, None where it has none."""
  event = action.slots.event
  if event is None:
    # A hand that is kept in a place does not act.
    acts = alone and action.part == "arms" and len(action.sides) == 1 and not (
        action.slots.hands and action.slots.hands.place)
    return ("acts", action.sides[0], None) if acts else None
  if event.kind == "turn" and is_gait(action.verb) and any(shape.kind in BENT for shape in shapes):
    return None
  return ("step", *event[1:]) if event.kind == "walk" and action.counts_steps else event


def _states(actions):
  """Requirements about the body as a whole."""
  if actions and all("dance" in action.slots.states for action in actions):
    yield "dance", ""
  if _ends_seated(actions):
    yield "seated", ""
  if actions and "rise" in actions[-1].slots.states:
    yield "rise", ""


def _climbs(actions):
  """Going up or down; neither can be measured for a body that goes up and down again."""
  climbs = {"ascend", "descend"} & {state for action in actions for state in action.slots.states}
  return [(kind, "") for kind in climbs] if len(climbs) == 1 else []


def _places(actions, shapes):
  """Requirements on where the body goes: in place or to a side, by the only action that moves it, or back."""
  going = [action for action in actions
           if action.part in ("legs", "body", "") and action.verb not in lexicon.STAYING_VERBS]
  if len(going) == 1 and going[0].part == "legs":
    action, = going
    yield from ((state, "") for state in ("stays", "treads") if state in action.slots.states)
    if action.slots.aside and (is_gait(action.verb) or action.verb in lexicon.GOING_ASIDE | _GOING) and not (
        any(shape.kind in BENT for shape in shapes)):
      yield "aside", action.slots.aside
  gaits = [action for action in going if is_gait(action.verb) or action.verb in _GOING]
  if len(gaits) == 2:
    back = gaits[1]
    if back.goes_back or back.slots.leads_back or "returns" in back.slots.states:
      yield "return", ""


def is_counted(requirements: Sequence[Requirement]) -> bool:
  """Whether the only requirement is an event that can be counted: a kick, a jump, a bow."""
  return len(requirements) == 1 and requirements[0].kind in COUNTED


def exactly_once(requirements: Sequence[Requirement]) -> list[Requirement]:
  """The same requirements, in which an event that can be counted occurs exactly once."""
  return [requirement._replace(counted=True) if requirement.kind in COUNTED and requirement.times == 1 else requirement
          for requirement in requirements]


def _ends_seated(actions):
  """Whether sitting down comes last, apart from actions on the chair: staying there, waving."""
  on_the_chair = [action.words == lexicon.HOLD or action.part in ("arms", "head") for action in actions]
  last = next((i for i, action in enumerate(actions) if action.words == lexicon.HOLD and all(on_the_chair[i:])),
              len(actions))
  return any(action.verb == "sit" for action in actions[last - 1:last])
