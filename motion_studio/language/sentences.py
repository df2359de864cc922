"""Former names of `plan` and `parser`, until their callers have moved to `parse`."""
from motion_studio.language.lexicon import HOLD, PAUSE  # noqa: F401
from motion_studio.language.parser import parse
from motion_studio.language.plan import Action, Plan, Segment, pause  # noqa: F401

Sentence, understand, rest_of = Plan, parse, pause


def actions_of(text):
  return parse(text).actions


def who_is_done(text, at_ease=False):
  action = parse(text).single
  return action.subject if action and (action.leaves_at_ease if at_ease else action.is_done_once) else ""
