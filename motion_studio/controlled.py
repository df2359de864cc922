"""Motion from words that does what it is asked to: paths, poses, targets, kept parts, loops (`motion_jax.control`).

What is asked is compiled to arrays, which a method that can be led samples by (`sample_controlled`); the motion is then
brought to do it exactly (`control.project`). A motion is made where models begin, at x = z = 0 and faced +Z, and laid
where its path begins.
"""
import os
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from motion_jax.control import files, finishing, paths
from motion_jax.control import signal as signals
from motion_jax.control.compiling import clip_to_feasible, compile
from motion_jax.control.constraints import Constraint, InPlace, KeepParts, Loop, RootPath
from motion_jax.control.project import check_length, project
from motion_jax.control.signal import ControlSignal
from motion_jax.models.base import each
from motion_jax.models.results import Motion, Motions, features_of, gathered
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils import timing
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import as_float
from motion_studio.language.sentences import Sentence
from motion_studio.planning import path_ends
from motion_studio.planning import sequencing as composed

if TYPE_CHECKING:
  from motion_jax.models.base import Frames, TextToMotionModel

Control = Any  # a ControlSignal, a Constraint, a list of these or one for each motion, a path, None: `constraints_of`
_HASTY = 0.6  # of their usual time that several actions have at the least without a warning
WALK = 1.2  # metres a second at which a path is gone along whose times and length nobody says


def constraints_of(control: Control, count: int) -> list[list[Constraint] | ControlSignal]:
  """What is asked of each of count motions: of a file, a list of constraints for all of them, a list with an entry for
  each (None asks nothing), or a signal (count, T)."""
  if control is None:
    return [[] for _ in range(count)]
  if isinstance(control, ControlSignal):
    if control.batch != count:
      raise InputError(f"got a control signal of {control.batch} motions for {count} prompts; give one row for each")
    return [jax.tree.map(lambda x, i=i: np.asarray(x)[i:i + 1], control) for i in range(count)]
  if isinstance(control, str | os.PathLike):
    control = files.load(control)
  if isinstance(control, Constraint):
    control = [control]
  if all(isinstance(one, Constraint) for one in control):
    return [list(control) for _ in range(count)]
  if len(control) != count:
    raise InputError(f"got control for {len(control)} motions and {count} prompts; give constraints for all of them, "
                     "or a list of them for each")
  return [constraints_of(one, 1)[0] for one in control]


def usual_frames(model: "TextToMotionModel", asked: Sequence[Constraint] | ControlSignal,
                 sentence: Sentence | None = None) -> int | None:
  """The length of a motion in frames, by its constraints: a motion whose parts are kept, a signal, or a path and what
  a sentence does at its end."""
  if isinstance(asked, ControlSignal):
    return asked.frames
  for one in asked:
    if isinstance(one, KeepParts):
      return round(len(one.joints) * model.fps / one.fps)
    if isinstance(one, RootPath):
      if one.points is None or one.times is not None:
        return None if one.times is None or one.times[-1] <= 0 else int(round(one.times[-1] * model.fps)) + 1
      way = paths.length(one.points[:, [0, -1]])
      count = max(int(round(way / (one.speed or WALK) * model.fps)) + 1, 2 * model.frames_per_latent)
      if sentence is None or sentence.is_plain or not path_ends.is_free(one):
        return count
      return count + path_ends.extra_frames(model, sentence)
  return None


def generate(model: "TextToMotionModel", prompts: Sequence[str], num_frames: "Frames", seconds: "Frames",
             keys: jax.Array, seeds: Sequence[int | None], cleanup: bool, literal: bool, sampling: dict[str, Any],
             control: Control, projected: bool, tries: int = 1) -> Motions:
  """As `composed.generate`, each motion as its control asks; projected: exactly so, where a body can."""
  asked = constraints_of(control, len(prompts))
  if not any(map(_asks, asked)):
    return composed.generate(model, prompts, num_frames, seconds, keys, seeds, cleanup, literal, sampling, tries)
  if model.stats.layout.skeleton is not HUMANML3D:
    raise InputError(f"{model.id} moves the skeleton {model.stats.layout.skeleton.name!r}; control knows the 22 joints "
                     f"of {HUMANML3D.name}")
  frames = _frames(model, prompts, asked, num_frames, seconds, literal)
  notes = [_note(model, prompt, one, literal) for prompt, one in zip(prompts, asked)]
  for note in dict.fromkeys(filter(None, notes)) if model.reports_to_terminal else ():
    warnings.warn(note, stacklevel=3)
  found: dict[int, Any] = {}
  led = [_asks(one) and _leads(model) and (literal or not model.can("understand") or model.understand(prompt).is_plain)
         for prompt, one in zip(prompts, asked)]
  # Motions that nothing is asked of are made as ever, those that are led together, the others of words alone.
  idle, free = ([i for i, one in enumerate(asked) if _asks(one) == wish and not led[i]] for wish in (False, True))
  for rows in (idle, free, [i for i, one in enumerate(led) if one]):
    if not rows:
      continue
    some = lambda values, rows=rows: [values[i] for i in rows]
    given = some(prompts), some(frames), keys[np.array(rows)], some(seeds)
    if rows is idle:
      lengths = None if given[1][0] is None else given[1]
      made = composed.generate(model, given[0], lengths, None, *given[2:], cleanup, literal, sampling, tries)
      found |= zip(rows, made)
    else:
      made = _controlled(model, *given, cleanup, literal, sampling, some(asked), projected, led[rows[0]], tries)
      found |= zip(rows, made)
  return gathered([found[i].replace(id=f"motion_{i}", meta=found[i].meta | (dict(note=notes[i]) if notes[i] else {}))
                   for i in range(len(prompts))])


def _note(model, prompt, asked, literal):
  understood = not literal and model.can("understand")
  return "" if isinstance(asked, ControlSignal) else path_ends.note_of(
      prompt, model.understand(prompt) if understood else None, asked)


def _controlled(model, prompts, frames, keys, seeds, cleanup, literal, sampling, asked, projected, led, tries):
  """A motion for each prompt, all of which are asked for something."""
  counts = [int(round(count)) for count in frames]
  for one, count in zip(asked, counts):
    if projected and (isinstance(one, ControlSignal) or any(not isinstance(each, InPlace | KeepParts | Loop)
                                                            for each in one)):
      check_length(count)  # before anything is made
  # What no body can do is told by the projection, where there is one.
  compiled = [clip_to_feasible(_compiled(one, count, model.fps), model.fps, not projected)
              for one, count in zip(asked, counts)]
  places = [signals.placement(one) for one in compiled]
  longer = [count + (finishing.spare(model.fps) if finds_its_cycle(one) else 0) for one, count in zip(asked, counts)]
  if not led:
    made = composed.generate(model, prompts, longer, None, keys, seeds, cleanup, literal, sampling, tries)
  else:
    made = _led(model, prompts, longer, keys, seeds, cleanup, sampling, compiled, places)
    # Poses and targets that are laid where the body is: now that is known.
    placed = [signals.to_world_frame(motion.joints[:count], place)
              for count, motion, place in zip(counts, made, places)]
    again = [clip_to_feasible(_compiled(one, count, model.fps, joints), model.fps, warn=False)
             for one, count, joints in zip(asked, counts, placed)]
    if any((np.asarray(a.given) != np.asarray(b.given)).any() for a, b in zip(compiled, again)):
      made = _led(model, prompts, longer, keys, seeds, cleanup, sampling, again, places)
  with timing.part("control"):
    if not led and not literal:  # words alone made them, and say when the body has gone along its path
      asked = [one if isinstance(one, ControlSignal) else path_ends.ended(one, motion, model.understand(prompt))
               for prompt, motion, one in zip(prompts, made, asked)]
    return [done(model, motion, one, place, count, projected)
            for motion, one, place, count in zip(made, asked, places, counts)]


def _led(model, prompts, frames, keys, seeds, cleanup, sampling, compiled, places):
  rows = [signals.to_model_frame(one, place).slice_frames(0, max(frames)) for one, place in zip(compiled, places)]
  return model.sample_controlled(prompts, frames, keys, seeds, cleanup, sampling, signals.stack(rows))


def _asks(asked: list[Constraint] | ControlSignal) -> bool:
  return not asked.is_empty if isinstance(asked, ControlSignal) else bool(asked)


def _compiled(asked, count, fps, joints=None):
  return asked.slice_frames(0, count) if isinstance(asked, ControlSignal) else compile(asked, count, fps, joints)


def _leads(model):
  """Whether a method samples by what is asked, and not by words alone."""
  from motion_jax.models.base import TextToMotionModel
  return type(model).sample_controlled is not TextToMotionModel.sample_controlled


def finds_its_cycle(asked: Sequence[Constraint] | ControlSignal) -> bool:
  """Whether a loop may begin and end where the motion meets itself best: nothing has a time of its own."""
  return not isinstance(asked, ControlSignal) and any(isinstance(one, Loop) for one in asked) and all(
      isinstance(one, Loop | InPlace) for one in asked)


def tell_if_hasty(model: "TextToMotionModel", sentence: Sentence, count: int) -> None:
  """A warning where several actions have much less time, count frames by what is asked, than they usually take."""
  going = path_ends.going_segments(sentence)
  usual, behind = (sum(counts) for counts in np.split(np.array(composed.usual_frames(model, sentence)), [going]))
  count = count - int(behind)
  if going > 1 and count < _HASTY * usual:
    warnings.warn(f"{count / model.fps:.1f} s, which what is asked of the body takes, are shared by "
                  f"{going} actions that usually take {usual / model.fps:.1f} s; try "
                  f"{usual / model.fps:.0f} seconds", stacklevel=2)


def _frames(model, prompts, asked, num_frames, seconds, literal):
  """Lengths in frames or None, one for each prompt."""
  if num_frames is not None and seconds is not None:
    model.frames_of(prompts, num_frames, seconds)  # says what is wrong
  if num_frames is None and seconds is None:
    sentences = [None if literal or not model.can("understand") else model.understand(prompt) for prompt in prompts]
    found = [usual_frames(model, one, sentence) if _asks(one) else None for one, sentence in zip(asked, sentences)]
    for prompt, count in zip(prompts, found):
      if count is not None and not literal and model.can("understand"):
        tell_if_hasty(model, model.understand(prompt), count)
    return [model.natural_frames(prompt) if count is None and _asks(one) else count
            for prompt, one, count in zip(prompts, asked, found)]
  if callable(num_frames):
    return [num_frames(prompt) for prompt in prompts]
  if num_frames is not None:
    return each(num_frames, prompts)
  return [None if value is None else as_float(value) * model.fps for value in each(seconds, prompts)]


def done(model: "TextToMotionModel", motion: Motion, asked: list[Constraint] | ControlSignal,
         place: signals.Placement, count: int, projected: bool) -> Motion:
  """A motion of count frames as it was asked to be: laid in the world, its parts kept, brought to what is asked, made
  a loop (of a motion that is `finishing.spare` frames longer, where `finds_its_cycle`)."""
  joints = signals.to_world_frame(motion.joints, place)
  constraints = [] if isinstance(asked, ControlSignal) else asked
  kept = [one for one in constraints if isinstance(one, KeepParts)]
  for one in kept:
    joints = finishing.with_parts(joints, one, model.fps)
  joints = joints if finds_its_cycle(asked) else joints[:count]
  if projected and not finds_its_cycle(asked):
    known = asked.slice_frames(0, len(joints)) if isinstance(asked, ControlSignal) else asked
    joints = project(joints, known, model.fps, warn=True)
  joints = finishing.finalize(joints, constraints, model.fps, count if finds_its_cycle(asked) else None)
  kinds = ["signal"] if isinstance(asked, ControlSignal) else [one.kind for one in asked]
  return motion.replace(joints=joints, features=features_of(model, joints),
                        meta=motion.meta | dict(control=kinds, projected=bool(projected)))
