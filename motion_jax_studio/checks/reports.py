"""Violated requirements as sentences: "no kick with the right leg seen"."""
import functools
import warnings
from collections.abc import Sequence

import numpy as np

from motion_jax.analysis.events import find_events
from motion_jax.analysis.signals import Body
from motion_jax.shapes import Num
from motion_jax_studio.checks.violations import events_of, number_of, violation
from motion_jax_studio.language.path_shapes import KINDS
from motion_jax_studio.language.requirements import Requirement

_LIMB = {"kick": "leg", "punch": "hand", "wave": "hand"}
_HANDS = {"": "no hand goes", "both": "the hands do not go", "left": "not the left hand goes",
          "right": "not the right hand goes"}
_NOUNS = {"wave": "waving", "walk": "walk backward", "step": "step backward"}
_PLURALS = {"punch": "punches"}
_STATES = {
    "sit": "the body does not sit down", "seated": "the body is not seated at the end",
    "lie": "the body does not lie down", "rise": "the body is not standing at the end",
    "still": "the body does not stand still",
    "ascend": "the body does not climb up", "descend": "the body does not go down",
    "dance": "the dance leaves its place", "run": "the run is faster than people run",
    "straight": "the path is not straight", "zigzag": "no zigzag seen",
    "figure-eight": "no figure of eight seen",
    "bend": "the body does not bend", "crouch": "the body does not crouch", "stays": "the body leaves its place",
    "treads": "no steps in place seen", "return": "the body does not come back", "slowly": "the {} is not slow",
    "quickly": "the {} is not quick", "usual": "the {} is faster than usual"}
_SIDED_STATES = {"foot": "{} foot is not lifted far", "balance": "the body does not stand on {} leg",
                 "aside": "the body does not go to {}", "acts": "{} hand moves less than the other"}
_NAMED = 5  # most warnings of a call


def unmet_requirements(joints: Num[np.ndarray, "t 22 3"], requirements: Sequence[Requirement], fps: float = 20.0
                       ) -> list[str]:
  """The requirements that joints (T, 22, 3) of a motion, or of a span of one, violate, as sentences."""
  if not requirements:
    return []
  body = Body(np.asarray(joints, np.float64), fps)
  events = functools.cache(lambda: find_events(joints, fps))
  missing = [requirement for requirement in requirements if violation(body, events, requirement)]
  never_sat = any(requirement.kind == "sit" for requirement in missing)
  return [_sentence_of(requirement, events) for requirement in missing
          if not (never_sat and requirement.kind == "seated")]


def report(prompts: Sequence[str], unmet: Sequence[Sequence[str]], attempts: int) -> None:
  """Warn about motions that still violate requirements after all attempts."""
  failed = [(prompt, missing) for prompt, missing in zip(prompts, unmet) if missing]
  for prompt, missing in failed[:_NAMED]:
    warnings.warn(attempts_note(attempts, missing, prompt), stacklevel=2)
  if len(failed) > _NAMED:
    warnings.warn(f"{len(failed) - _NAMED} more motions do not show all of their prompts after {attempts} attempts",
                  stacklevel=2)


def attempts_note(attempts: int, missing: Sequence[str], prompt: str) -> str:
  """The warning about one motion: "4 attempts, no kick with the right leg seen ..."."""
  shown = prompt if len(prompt) <= 80 else prompt[:79] + "…"
  return f"{attempts} attempts, {', '.join(missing)} (prompt: {shown!r}); another seed may show it"


def _sentence_of(requirement, events):
  kind, side, times, counted, degrees = requirement
  if kind in _STATES:
    return _STATES[kind].format(side)
  if kind == "raise":
    return f"{_HANDS[side]} up over the shoulder"
  if kind in _SIDED_STATES:
    return _SIDED_STATES[kind].format(f"the {side}" if side else "one")
  if kind == "sideways":
    return f"no walk sideways{f' to the {side}' if side else ''} seen"
  if kind in KINDS:
    return f"no {'full ' if kind == 'circle' else ''}{kind}{f' to the {side}' if side else ''} seen"
  noun = _NOUNS.get(kind, kind)
  where = {"": "", "backward": ""}.get(side, f" with the {side} {_LIMB[kind]}" if kind in _LIMB else f" to the {side}")
  matching = events_of(events(), requirement)
  seen = number_of(matching, kind)
  if not seen:
    return f"no {noun}{where} seen"
  if seen < times or counted and seen > times:
    return f"{_number(seen, noun)}{where} seen instead of {times}"
  if degrees is not None:
    turned = abs(sum(event.amount for event in matching))
    return f"a turn{where} by {turned:.0f} degrees seen instead of {max(degrees[0], 0):.0f} to {degrees[1]:.0f}"
  return f"feet go up more often than {_number(times, noun)}{where} would"


def _number(count, noun):
  return f"{count} {noun if count == 1 else _PLURALS.get(noun, noun + 's')}"
