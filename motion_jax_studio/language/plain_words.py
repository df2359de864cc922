"""Actions in plain words: "kicks with the left foot" for "gives a slight kick with his left leg, not very high".

Motion captions use few phrases for each action. When the first attempts at a prompt fail its checks, later ones
(`resampling`) replace each action that can be checked by the phrase of captions. Manner, place and subject are dropped,
for they may hide the action: in captures, the hands of old people wave below their shoulders.
"""
from collections.abc import Sequence

from motion_jax_studio.language import lexicon
from motion_jax_studio.language.actions import Action
from motion_jax_studio.language.parts import sides_of
from motion_jax_studio.language.plan import Plan
from motion_jax_studio.language.requirements import Requirement, requirements_of

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
_QUALIFIERS = frozenset({"usual", "seated", "stays", "slowly", "quickly", "run"})  # kinds without plain words


def in_plain_words(plan: Plan) -> Plan:
  """The plan with each action of a single requirement in plain words; the same object if no action changes."""
  plans = plan.with_segments(tuple(segment._replace(
      action=_plain(segment.action, plan), simultaneous=tuple(_plain(action, plan) for action in segment.simultaneous))
      for segment in plan.segments))
  return plan if plans.segments == plan.segments else plans


def _plain(action: Action, plan: Plan) -> Action:
  """The action in plain words, if it has any. A plain plan is read as its parsed action (`Plan.single`)."""
  action = plan.single if plan.is_plain and plan.single else action
  words = "" if action.prompt == plan.text and plan.single is None else _words_of(
      requirements_of((action,), action.prompt), action.verb in lexicon.TURNING)
  subject = "a person" if len(action.subject.split()) > 2 else action.subject or "a person"  # "an old man"
  text = plan.text if plan.is_plain else action.words
  if not words or words in text and subject == (action.subject or subject):
    return plan.segments[0].action if plan.is_plain else action
  return action.replace(prompt=f"{subject} {words}", words=words, sides=sides_of(words.split()), reworded=True)


def _words_of(requirements: Sequence[Requirement], turns: bool) -> str:
  """Plain words for the requirements of an action; "" for several requirements, and for one without plain words."""
  events = [requirement for requirement in requirements if requirement.kind not in _QUALIFIERS]
  aside = [requirement for requirement in events if requirement.kind == "aside"]
  events = [requirement for requirement in events if requirement.kind != "aside"] if len(events) > 1 else events
  if len(events) != 1:
    return ""
  requirement, = events
  if requirement.kind == "turn" and not (turns and any(other.kind == "stays" for other in requirements)):
    return ""  # a turn during a walk
  if requirement.kind == "turn":
    around = requirement.degrees is not None and 130 <= requirement.degrees[0] <= requirement.degrees[1] <= 230
    return f"turns around to the {requirement.side}" if around and requirement.side else _TURNS[requirement.side]
  if requirement.kind == "raise" and requirement.side == "both":
    return "raises both hands"
  plain, sided = _WORDS.get(requirement.kind, ("", ""))
  if requirement.kind == "jump" and aside:
    return f"jumps to the {aside[0].side}"
  return sided.format(requirement.side) if requirement.side and sided else plain
