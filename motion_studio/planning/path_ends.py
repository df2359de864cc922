"""Paths of prompts that end in staying: "walks forward, then sits down" goes along its path, and sits at its end."""
import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeGuard

import numpy as np

from motion_jax.analysis.signals import Body
from motion_jax.control import paths
from motion_jax.control.constraints import Constraint, RootPath
from motion_jax.models.results import Motion
from motion_studio.checks import path_shapes as ways
from motion_studio.language.actions import LOW
from motion_studio.language.sentences import Sentence, actions_of
from motion_studio.planning import sequencing as composed

if TYPE_CHECKING:
  from motion_jax.models.base import TextToMotionModel

_STAYS = {"sit", "stand", "stop", "rest", "wait", "stay", "pause", "squat", "crouch", "kneel", "lie", "kick", "bow"}
_FAR = 0.5      # metres of a path that is too long for a body that stays in place
_SLOW, _STOPS = 0.3, 1.5  # metres a second of a body that has come to a stop, and seconds in which it does so
_POINTS = 40    # way points of a path that has times


def going_segments(sentence: Sentence) -> int:
  """How many segments a sentence has before those at its end that stay where they are; all where none goes anywhere."""
  segments = list(sentence.segments)
  count = len(segments)
  while count and _stays(segments[count - 1]):
    count -= 1
  goes = any(ways.is_gait(segment.action.verb) for segment in segments[:count])
  return count if goes else len(segments)


def extra_frames(model: "TextToMotionModel", sentence: Sentence) -> int:
  """Frames that what stays takes behind a path."""
  return sum(composed.usual_frames(model, sentence)[going_segments(sentence):])


def ended(asked: Sequence[Constraint], motion: Motion, sentence: Sentence) -> list[Constraint]:
  """The constraints, a path without times done when the body comes to a stop behind the actions that go along it."""
  count = going_segments(sentence)
  if count == len(sentence.segments) or len(motion.captions) != len(sentence.segments):
    return list(asked)
  border = round(motion.captions[count - 1].end * motion.fps)
  speed = Body(np.asarray(motion.joints, np.float64), motion.fps).speed[border:border + round(_STOPS * motion.fps)]
  stop = border + int(np.argmax(speed < _SLOW)) if (speed < _SLOW).any() else border
  stop = max(min(stop, motion.num_frames - 1), 1)
  return [_with_times(one, motion, stop) if is_free(one) else one for one in asked]


def is_free(one: Constraint) -> TypeGuard[RootPath]:
  """Whether a constraint is a path without times."""
  return isinstance(one, RootPath) and one.points is not None and one.times is None and one.between and (
      not np.ndim(one.heading))


def note_of(prompt: str, sentence: Sentence | None, asked: Sequence[Constraint]) -> str:
  """A sentence about what is done on the way though it should be at a place, "" where there is none."""
  far = any(is_free(one) and paths.length(one.points[:, [0, -1]]) > _FAR for one in asked)
  if not far or sentence is not None and going_segments(sentence) < len(sentence.segments):
    return ""
  low = next((action for action in actions_of(prompt) if action.verb in LOW and not action.held), None)
  return "" if low is None else (f"the body goes along its path all the time, so {low.words!r} is done on the way; say "
                                 f"\"a person walks, then {low.words}\" to do it at the end of the path")


def _stays(segment):
  def stays(action):
    words = set(action.words.lower().split())
    return action.verb in _STAYS and not words & {"forward", "forwards", "sideways", "around"} or (
        action.part in ("arms", "head", "torso"))
  return segment.rests or all(map(stays, (segment.action, *segment.also)))


def _with_times(path, motion, stop):
  """The path with times: it is gone along up to frame `stop` at the pace of the motion, which slows down there."""
  steps = np.linalg.norm(np.diff(motion.joints[:stop + 1, 0, ::2], axis=0), axis=-1)
  gone = np.concatenate([[0.0], np.cumsum(steps + 1e-6)])
  frames = np.unique(np.linspace(0, stop, min(_POINTS, stop + 1)).round().astype(int))
  return dataclasses.replace(path, points=paths.evenly(path.points, gone[frames] / gone[-1]),
                             times=frames / motion.fps, speed=None)
