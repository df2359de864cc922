"""Motions that meet constraints: paths, poses, targets, kept body parts, loops (`motion_jax.control`).

Constraints are compiled to arrays by which a method samples, where it can be guided; the motion is then brought to meet
them exactly (`control.project`). A motion is sampled where models begin, at x = z = 0 facing +Z, and placed where its
path begins.
"""
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from motion_jax.control import finishing, paths
from motion_jax.control import signal as signals
from motion_jax.control.compiling import clip_to_feasible, compile
from motion_jax.control.constraints import Constraint, InPlace, KeepParts, Loop, RootPath
from motion_jax.control.project import check_length, project
from motion_jax.control.signal import ControlSignal
from motion_jax.models.results import Motion, features_of
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.motion.step_records import added, record
from motion_jax.utils.errors import InputError
from motion_jax_studio.language import Plan
from motion_jax_studio.planning import durations
from motion_jax_studio.planning.job import Job
from motion_jax_studio.posing import path_ends

Constraints = list[Constraint] | ControlSignal  # of one motion
_HASTY = 0.6  # share of their usual time below which several actions get a warning
WALK = 1.2  # metres a second along a path that has neither times nor a speed


class Target(NamedTuple):
  """What one motion has to meet: constraints, number of frames, where it begins, and all that as a signal (1, count) in
  world coordinates."""
  constraints: Constraints
  count: int
  place: signals.Placement
  signal: ControlSignal

  def frames_to_sample(self, fps: float) -> int:
    """Some more than count where a loop is to be found in them."""
    return self.count + (finishing.spare(fps) if finds_its_cycle(self.constraints) else 0)


def is_constrained(constraints: Constraints) -> bool:
  return not constraints.is_empty if isinstance(constraints, ControlSignal) else bool(constraints)


def finds_its_cycle(constraints: Constraints) -> bool:
  """Whether a loop may begin and end where the motion meets itself best: no constraint has a time of its own."""
  return not isinstance(constraints, ControlSignal) and any(isinstance(one, Loop) for one in constraints) and all(
      isinstance(one, Loop | InPlace) for one in constraints)


# --- lengths -----------------------------------------------------------------------------------------------------


def implied_frames(planner: Any, constraints: Constraints, plan: Plan | None = None) -> int | None:
  """Frames of a motion that its constraints imply, None where they imply none: of a motion whose parts are kept, of a
  signal, of a path and what a plan does at its end."""
  if isinstance(constraints, ControlSignal):
    return constraints.frames
  for one in constraints:
    if isinstance(one, KeepParts):
      return round(len(one.joints) * planner.fps / one.fps)
    if isinstance(one, RootPath):
      if one.points is None or one.times is not None:
        return None if one.times is None or one.times[-1] <= 0 else int(round(one.times[-1] * planner.fps)) + 1
      length = paths.length(one.points[:, [0, -1]])
      count = max(int(round(length / (one.speed or WALK) * planner.fps)) + 1, 2 * planner.frames_per_latent)
      if plan is None or plan.is_plain or not path_ends.is_free(one):
        return count
      return count + path_ends.frames_after_path(planner, plan)
  return None


def target_frames(planner: Any, prompt: str, plan: Plan | None, constraints: Constraints) -> int:
  """Frames of a constrained motion whose length is not given. Warns where they leave little time for the plan."""
  count = implied_frames(planner, constraints, plan)
  if count is None:
    return sum(durations.segment_frames(planner, prompt, plan, None))
  if plan is not None:
    warn_if_hasty(planner, plan, count)
  return count


def warn_if_hasty(planner: Any, plan: Plan, count: int) -> None:
  """Warns where the frames that constraints imply are much fewer than the plan's actions usually take."""
  moving = path_ends.moving_segments(plan)
  usual, behind = (sum(counts) for counts in np.split(np.array(durations.usual_frames(planner, plan)), [moving]))
  count = count - int(behind)
  if moving > 1 and count < _HASTY * usual:
    warnings.warn(f"{count / planner.fps:.1f} s, the time that the constraints imply, are shared by "
                  f"{moving} actions that usually take {usual / planner.fps:.1f} s; try "
                  f"{usual / planner.fps:.0f} seconds", stacklevel=2)


# --- sampling ----------------------------------------------------------------------------------------------------


def target_of(constraints: Constraints, count: int, fps: float, exact: bool) -> Target:
  """The target of a motion of count frames. Raises InputError for more frames than can be met exactly."""
  if exact and (isinstance(constraints, ControlSignal) or any(not isinstance(one, InPlace | KeepParts | Loop)
                                                              for one in constraints)):
    check_length(count)  # before anything is sampled
  # What no body can do is reported by the projection, where there is one.
  signal = clip_to_feasible(_compiled(constraints, count, fps), fps, not exact)
  return Target(constraints, count, signals.placement(signal), signal)


def _compiled(constraints, count, fps, joints=None):
  return constraints.slice_frames(0, count) if isinstance(constraints, ControlSignal) else compile(
      constraints, count, fps, joints)


def sample_guided(targets: Sequence[Target], fps: float, sample: Callable[[list[ControlSignal]], Sequence[Any]]
                  ) -> Sequence[Any]:
  """Motions sampled towards their targets: sample(signals (1, T), one per motion, in the frame where models begin).

  Poses and targets that are relative to the body are known only once it has moved: where there are such, all motions
  are sampled a second time.
  """
  guide = lambda rows: sample([signals.to_model_frame(one, target.place) for one, target in zip(rows, targets)])
  made = guide([target.signal for target in targets])
  placed = [signals.to_world_frame(motion.joints[:target.count], target.place) for motion, target in zip(made, targets)]
  again = [clip_to_feasible(_compiled(target.constraints, target.count, fps, joints), fps, warn=False)
           for target, joints in zip(targets, placed)]
  if any((np.asarray(one.given) != np.asarray(target.signal.given)).any() for one, target in zip(again, targets)):
    made = guide(again)
  return made


def sample_job(job: Job, targets: Sequence[Target]) -> Sequence[Motion]:
  """The motions of a job, one pass each, guided towards their targets."""
  longer = [int(round(count)) for count in job.frames if count is not None]

  def sample(rows):
    stacked = signals.stack([one.slice_frames(0, max(longer)) for one in rows])
    return job.model.sample(job.prompts, longer, job.keys, job.seeds, job.cleanup, job.sampling, stacked)

  return sample_guided(targets, job.planner.fps, sample)


# --- afterwards --------------------------------------------------------------------------------------------------


def constrain(model: Any, motion: Motion, target: Target, exact: bool) -> Motion:
  """The sampled motion placed in the world, with its kept parts, brought to its constraints if exact, made a loop.

  Its record states what changed once it was placed; of a loop that was cut out of it only the lengths.
  """
  constraints = [] if isinstance(target.constraints, ControlSignal) else target.constraints
  placed, is_cycle = signals.to_world_frame(motion.joints, target.place), finds_its_cycle(target.constraints)
  joints = placed
  for one in constraints:
    if isinstance(one, KeepParts):
      joints = finishing.with_parts(joints, one, model.fps)
  joints = joints if is_cycle else joints[:target.count]
  if exact and not is_cycle:
    known = (target.constraints.slice_frames(0, len(joints)) if isinstance(target.constraints, ControlSignal) else
             target.constraints)
    joints = project(joints, known, model.fps, warn=True)
  joints, velocity = finishing.finalize(joints, constraints, model.fps, target.count if is_cycle else None)
  lost = {"velocity": velocity.tolist()} if any(isinstance(one, InPlace) for one in constraints) else {}
  kinds = [one.kind for one in constraints] if constraints else ["signal"]
  did = f"{', '.join(kinds)} {'met' if exact else 'placed, not met exactly'}"
  done = record("constrain", did) | {"num_frames": [len(placed), len(joints)]} if is_cycle else (
      record("constrain", did, placed, joints))
  return motion.replace(joints=joints, features=features_of(model, joints), meta=added(
      motion.meta | dict(control=kinds, projected=bool(exact)) | lost, done))


def check_skeleton(model: Any) -> None:
  """Raises InputError for a model that moves another skeleton than constraints know."""
  if model.stats.layout.skeleton is not HUMANML3D:
    raise InputError(f"{model.id} moves the skeleton {model.stats.layout.skeleton.name!r}; control knows the 22 joints "
                     f"of {HUMANML3D.name}")
