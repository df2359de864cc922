"""Motions that meet constraints: paths, poses, targets, kept body parts, loops (`motion_jax.control`).

Constraints are compiled to arrays that guide the sampling, if the model's method supports it; then the motion is
projected to meet them exactly (`control.project`). Motions are sampled in the model frame, starting at x = z = 0 facing
+Z, and moved to the world frame, where their path begins.
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
_HASTY = 0.6  # warn if several actions have less than this share of their usual time
WALK = 1.2  # metres a second along a path that has neither times nor a speed


class Target(NamedTuple):
  """The target of one motion: constraints, number of frames, where it begins, and the constraints as a signal
  (1, count) in world coordinates."""
  constraints: Constraints
  count: int
  place: signals.Placement
  signal: ControlSignal

  def frames_to_sample(self, fps: float) -> int:
    """`count`, with spare frames if a loop is searched for in them."""
    return self.count + (finishing.spare(fps) if finds_its_cycle(self.constraints) else 0)


def is_constrained(constraints: Constraints) -> bool:
  return not constraints.is_empty if isinstance(constraints, ControlSignal) else bool(constraints)


def finds_its_cycle(constraints: Constraints) -> bool:
  """Whether a loop may be cut where its ends match best: there is a Loop, and no constraint that has times."""
  return not isinstance(constraints, ControlSignal) and (
      any(isinstance(constraint, Loop) for constraint in constraints)) and (
          all(isinstance(constraint, Loop | InPlace) for constraint in constraints))


# --- lengths -----------------------------------------------------------------------------------------------------


def implied_frames(planner: Any, constraints: Constraints, plan: Plan | None = None) -> int | None:
  """Frames that constraints imply, or None: those of a motion with kept parts, of a signal, or of a path with the
  actions of a plan after its end."""
  if isinstance(constraints, ControlSignal):
    return constraints.frames
  for constraint in constraints:
    if isinstance(constraint, KeepParts):
      return round(len(constraint.joints) * planner.fps / constraint.fps)
    if isinstance(constraint, RootPath):
      if constraint.points is None or constraint.times is not None:
        last = 0.0 if constraint.times is None else constraint.times[-1]
        return None if last <= 0 else int(round(last * planner.fps)) + 1
      length = paths.length(constraint.points[:, [0, -1]])
      count = max(int(round(length / (constraint.speed or WALK) * planner.fps)) + 1, 2 * planner.frames_per_latent)
      if plan is None or plan.is_plain or not path_ends.is_free(constraint):
        return count
      return count + path_ends.frames_after_path(planner, plan)
  return None


def target_frames(planner: Any, prompt: str, plan: Plan | None, constraints: Constraints) -> int:
  """Frames of a constrained motion without a given length; warns if they leave little time for the plan."""
  count = implied_frames(planner, constraints, plan)
  if count is None:
    return sum(durations.segment_frames(planner, prompt, plan, None))
  if plan is not None:
    warn_if_hasty(planner, plan, count)
  return count


def warn_if_hasty(planner: Any, plan: Plan, count: int) -> None:
  """Warn if the frames that constraints imply are much fewer than the usual ones of the plan's moving segments."""
  moving = path_ends.moving_segments(plan)
  usual, after = (sum(counts) for counts in np.split(np.array(durations.usual_frames(planner, plan)), [moving]))
  count = count - int(after)
  if moving > 1 and count < _HASTY * usual:
    warnings.warn(f"{count / planner.fps:.1f} s, the time that the constraints imply, are shared by "
                  f"{moving} actions that usually take {usual / planner.fps:.1f} s; try "
                  f"{usual / planner.fps:.0f} seconds", stacklevel=2)


# --- sampling ----------------------------------------------------------------------------------------------------


def target_of(constraints: Constraints, count: int, fps: float, exact: bool) -> Target:
  """The target of a motion of count frames. Raises InputError for more frames than can be met exactly."""
  if exact and (isinstance(constraints, ControlSignal) or any(not isinstance(constraint, InPlace | KeepParts | Loop)
                                                              for constraint in constraints)):
    check_length(count)  # before anything is sampled
  # If exact, the projection reports infeasible constraints, so there is no warning here.
  signal = clip_to_feasible(_compiled(constraints, count, fps), fps, not exact)
  return Target(constraints, count, signals.placement(signal), signal)


def _compiled(constraints, count, fps, joints=None):
  return constraints.slice_frames(0, count) if isinstance(constraints, ControlSignal) else compile(
      constraints, count, fps, joints)


def sample_guided(targets: Sequence[Target], fps: float, sample: Callable[[list[ControlSignal]], Sequence[Any]]
                  ) -> Sequence[Any]:
  """Sample motions guided towards their targets. sample(signals) -> motions; signals: one (1, T) each, in model frame.

  Poses and targets that are relative to the body need its path: with any of these, all motions are sampled a second
  time, with the places from the first one.
  """
  guide = lambda rows: sample([signals.to_model_frame(signal, target.place) for signal, target in zip(rows, targets)])
  motions = guide([target.signal for target in targets])
  placed = [signals.to_world_frame(motion.joints[:target.count], target.place)
            for motion, target in zip(motions, targets)]
  again = [clip_to_feasible(_compiled(target.constraints, target.count, fps, joints), fps, warn=False)
           for target, joints in zip(targets, placed)]
  if any((np.asarray(signal.given) != np.asarray(target.signal.given)).any() for signal, target in zip(again, targets)):
    motions = guide(again)
  return motions


def sample_job(job: Job, targets: Sequence[Target]) -> Sequence[Motion]:
  """Sample the motions of a job in one pass each, guided towards their targets."""
  counts = [int(round(count)) for count in job.frames if count is not None]

  def sample(rows):
    stacked = signals.stack([signal.slice_frames(0, max(counts)) for signal in rows])
    return job.model.sample(job.prompts, counts, job.keys, job.seeds, job.cleanup, job.sampling, stacked)

  return sample_guided(targets, job.planner.fps, sample)


# --- afterwards --------------------------------------------------------------------------------------------------


def constrain(model: Any, motion: Motion, target: Target, exact: bool) -> Motion:
  """Finish a sampled motion: place it in the world, put kept parts back, project it if exact, make it a loop.

  The record compares it with the placed motion; for a loop that was cut from it, the record has only the lengths.
  """
  constraints = [] if isinstance(target.constraints, ControlSignal) else target.constraints
  placed, is_cycle = signals.to_world_frame(motion.joints, target.place), finds_its_cycle(target.constraints)
  joints = placed
  for constraint in constraints:
    if isinstance(constraint, KeepParts):
      joints = finishing.with_parts(joints, constraint, model.fps)
  joints = joints if is_cycle else joints[:target.count]
  if exact and not is_cycle:
    known = (target.constraints.slice_frames(0, len(joints)) if isinstance(target.constraints, ControlSignal) else
             target.constraints)
    joints = project(joints, known, model.fps, warn=True)
  joints, velocity = finishing.finalize(joints, constraints, model.fps, target.count if is_cycle else None)
  lost = {"velocity": velocity.tolist()} if any(isinstance(constraint, InPlace) for constraint in constraints) else {}
  kinds = [constraint.kind for constraint in constraints] if constraints else ["signal"]
  did = f"{', '.join(kinds)} {'met' if exact else 'placed, not met exactly'}"
  step = record("constrain", did) | {"num_frames": [len(placed), len(joints)]} if is_cycle else (
      record("constrain", did, placed, joints))
  return motion.replace(joints=joints, features=features_of(model, joints), meta=added(
      motion.meta | dict(control=kinds, projected=bool(exact)) | lost, step))


def check_skeleton(model: Any) -> None:
  """Raises InputError for a model of another skeleton than that of constraints."""
  if model.stats.layout.skeleton is not HUMANML3D:
    raise InputError(f"{model.id} moves the skeleton {model.stats.layout.skeleton.name!r}; control knows the 22 joints "
                     f"of {HUMANML3D.name}")
