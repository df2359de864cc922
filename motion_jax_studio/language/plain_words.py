"""Actions in plain words: "kicks with the left foot" for "gives a slight kick with his left leg, not very high".

Captions of motion name actions in few ways. Where a model does not do what a sentence says in its own words, another
attempt gets each action of it that can be checked in the words of captions; manner, place and subject are lost:
hands of old people wave below their shoulders in captures.
"""
from collections.abc import Sequence

from motion_jax_studio.language import lexicon
from motion_jax_studio.language.actions import sides_of
from motion_jax_studio.language.plan import Plan
from motion_jax_studio.language.requirements import Requirement, requirements_of
from motion_jax_studio.language.segments import Action

# Words by the kind of a requirement: without a side, and with one.
_WORDS = {
    "kick": ("kicks", "kicks with the {} foot"), "punch": ("punches", "punches with the {} hand"),
    "jump": ("jumps", ""), "hop": ("hops", ""), "squat": ("squats", ""), "crouch": ("squats", ""), "bow": ("bows", ""),
    "bend": ("bends forward in a bow", ""), "wave": ("waves", "waves the {} hand"),
    "raise": ("raises a hand", "raises the {} hand"), "sideways": ("walks sideways", "takes steps to the {}"),
    "still": ("stands still", ""), "sit": ("sits down", ""), "rise": ("stands up", ""),
    "zigzag": ("walks in a zigzag", ""), "walk": ("walks backward", "walks {}"),
    "balance": ("stands on one leg", "stands on the {} leg")}
_TURNS = {"": "turns around", "left": "turns to the left", "right": "turns to the right"}
_BESIDE = frozenset({"usual", "seated", "stays", "slowly", "quickly", "run"})  # requirements that no other words bring


def in_plain_words(plan: Plan) -> Plan:
  """The plan with the plain words of each action that requires one thing; the same plan where none has any."""
  plans = plan.with_segments(tuple(segment._replace(
      action=_plain(segment.action, plan), simultaneous=tuple(_plain(one, plan) for one in segment.simultaneous))
      for segment in plan.segments))
  return plan if plans.segments == plan.segments else plans


def _plain(action: Action, plan: Plan) -> Action:
  """An action in plain words, where it has any. A plan that goes to the network as it is is read as its one action."""
  action = plan.single if plan.is_plain and plan.single else action
  words = "" if action.is_pose or action.prompt == plan.text and plan.single is None else _words_of(
      requirements_of((action,), action.prompt), action.verb in lexicon.TURNING)
  subject = "a person" if len(action.subject.split()) > 2 else action.subject or "a person"  # "an old man"
  said = plan.text if plan.is_plain else action.words
  if not words or words in said and subject == (action.subject or subject):
    return plan.segments[0].action if plan.is_plain else action
  return action._replace(prompt=f"{subject} {words}", words=words, sides=sides_of(words.split()), reworded=True)


def _words_of(requirements: Sequence[Requirement], turns: bool) -> str:
  """The plain words of what an action requires; "" where that is more than one thing, or nothing that has any."""
  events = [one for one in requirements if one.kind not in _BESIDE]
  aside = [one for one in events if one.kind == "aside"]
  events = [one for one in events if one.kind != "aside"] if len(events) > 1 else events
  if len(events) != 1:
    return ""
  one, = events
  if one.kind == "turn" and not (turns and any(other.kind == "stays" for other in requirements)):
    return ""  # a turn on one's way
  if one.kind == "turn":
    around = one.degrees is not None and 130 <= one.degrees[0] <= one.degrees[1] <= 230
    return f"turns around to the {one.side}" if around and one.side else _TURNS[one.side]
  if one.kind == "raise" and one.side == "both":
    return "raises both hands"
  plain, sided = _WORDS.get(one.kind, ("", ""))
  if one.kind == "jump" and aside:
    return f"jumps to the {aside[0].side}"
  return sided.format(one.side) if one.side and sided else plain
