"""The application's entry point: from a prompt to a motion that meets its requirements."""
import dataclasses
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import jax

from motion_jax.control.files import constraints_of
from motion_jax.data.clip import Clip
from motion_jax.data.mirror import mirror_legs
from motion_jax.loading import load
from motion_jax.models import arguments
from motion_jax.models.abilities import cannot
from motion_jax.models.base import Frames, Prompts
from motion_jax.models.keys import each, keys_of
from motion_jax.models.results import Motion, Motions, gathered
from motion_jax.models.shared.pasting import Spans, requested_frames
from motion_jax.motion.step_records import record
from motion_jax.shapes import Array
from motion_jax.utils import progress, timing
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import as_float, checked, require_numbers
from motion_jax_studio import editing, steps
from motion_jax_studio.batches import Planned, Request, batches
from motion_jax_studio.blending import blended
from motion_jax_studio.checks import MAX_ATTEMPTS, prompt_notes
from motion_jax_studio.constraining import implied_frames, is_constrained
from motion_jax_studio.language import Plan
from motion_jax_studio.planning import durations, sequencing
from motion_jax_studio.planning.independent import sample_independently
from motion_jax_studio.planning.job import Job, plan_records
from motion_jax_studio.planning.planner import Planner
from motion_jax_studio.planning.segments import prompts_in_sequence, segments_of
from motion_jax_studio.step_names import EDIT, EXTEND, GENERATE, MULTI_PROMPT, left_out
from motion_jax_studio.streaming import PlannedStream

Step = Callable[[Job], None]
Segments = Sequence[tuple[str, float | None]]  # prompts and their seconds
STEPS = (steps.PlanPrompts(), steps.Warn(), steps.CleanUp(), steps.Sample(), steps.Pose(), steps.Correct(),
         steps.Check(), steps.Constrain())


class Pipeline:
  """A model with the steps that plan its prompts, and check and finish its samples.

    pipeline = Pipeline("cmdm-small")
    motion = pipeline("a person walks while waving, then sits down", seed=0)
    motions = pipeline(["a person waves", "a person kicks"], seconds=4)

  Plan: parse the prompt into segments, simultaneous actions and durations. Warn: about words that the model has not
  learned. CleanUp: pin feet. Sample: one pass of the network for each part; the parts are joined. Pose: add the hand
  poses, leans and walking directions of the plan. Correct: repair small faults, such as left for right. Check: best of
  four attempts. Constrain: meet paths and poses exactly.
  To change the steps, leave one out of the list, or out of a call as in pipeline(prompt, without=("correct", "pose")),
  or add a function of a `Job`. motion.meta["steps"] lists what each step did, in which frames and by how much.
  `Pipeline(model, steps=[steps.Sample()])` is `model.generate`.
  """

  def __init__(self, model: Any = "cmdm-small", steps: Iterable[Step] = STEPS) -> None:
    """model: a shipped name, a run folder, or a model that was loaded."""
    self.model = load(model) if isinstance(model, str | os.PathLike) else model
    self.steps = tuple(steps)
    self.planner = Planner(self.model)
    self.warns = True  # False: no warnings, for callers that show `notes` themselves

  def __repr__(self) -> str:
    return f"Pipeline({self.model!r}, steps=[{', '.join(map(repr, self.steps))}])"

  # --- prompts -----------------------------------------------------------------------------------------------------

  def plan(self, prompt: str, postures: bool = True) -> Plan:
    """The segments, simultaneous actions and repetitions of a prompt, as `pipeline(...)` samples them.

    postures: False for a motion with constraints, which gets no postures.
    """
    plan = self.planner.plan(*self.model.prompts_of(prompt))
    return self.planner.with_postures(plan) if postures else plan

  def schedule(self, prompt: str | Plan, frames: float | None = None, control: Any = None
               ) -> tuple[Plan | None, list[int]]:
    """(the plan with its final pause, frames of each segment) as `pipeline(plan, frames, control=control)` samples it;
    (None, its frames) for a prompt that is a string."""
    plan, (constraints,) = prompt if isinstance(prompt, Plan) else None, constraints_of(control, 1)
    text = prompt.text if isinstance(prompt, Plan) else prompt
    if frames is None and is_constrained(constraints):
      frames = implied_frames(self.planner, constraints, plan)
    plan = durations.with_final_pause(self.planner, plan, frames)
    return plan, durations.segment_frames(self.planner, text, plan, frames)

  def notes(self, prompts: Iterable[str | Plan], plan: bool = True, postures: bool = True) -> list[str]:
    """Notes on words and actions of prompts, or plans, that the model has not learned, with suggestions.

    plan: judge a prompt action by action, not as a whole. postures: the pose step adds hand poses and leans, as in
    `pipeline(...)`; False for streams and lists of segments.
    """
    return prompt_notes.notes_on(self.planner, [
        self.plan(prompt, postures) if plan and isinstance(prompt, str) else prompt for prompt in prompts], postures)

  def warn(self, prompts: Iterable[str | Plan], plan: bool = True, postures: bool = False) -> None:
    """Give the `notes` of prompts as warnings, unless `warns` is False."""
    for note in self.notes(list(prompts), plan, postures) if self.warns else ():
      warnings.warn(note, stacklevel=3)

  def _sampling(self, sampling, planned=False):
    """The sampling choices, with left/right contrast guidance by default: the negative prompt names the other leg.

    planned: the prompts are single actions of plans, or several at once, and not steered by clauses.

    Raises TypeError for a choice that the model does not have.
    """
    known = [*self.model.options.described(), *self.model.more_choices]
    for name in sampling:
      if name not in known:
        raise TypeError(f"{self.model.folder.name} has no argument {name!r}"
                        f"{arguments.hint(name, known, '; it has ' + ', '.join(known))}")
    return self._with_contrast(({"clauses": False} if planned and "clauses" in known else {}) | sampling)

  def _with_contrast(self, sampling):
    if "negative_prompts" in self.model.more_choices:
      return {"negative_prompts": mirror_legs} | sampling
    return sampling

  def _require(self, ability):
    if not self.model.can(ability):
      raise InputError(cannot(self.model.folder.name, ability))

  # --- motions -----------------------------------------------------------------------------------------------------

  def __call__(self, prompts: Prompts | Plan | Sequence[Plan], num_frames: Frames = None, *,
               seconds: Frames = None, rng: jax.Array | None = None, seeds: Iterable[int] | None = None,
               seed: int | None = None, control: Any = None, exact: bool = True, plan: bool = True,
               cleanup: bool = True, max_attempts: int | None = None, without: str | Iterable[str] = (),
               **sampling: Any) -> Any:
    """A Motion of one prompt, or Motions of a list of prompts or plans.

    num_frames or seconds: length of all motions or of each; default: of the plan, or as implied by the constraints.
    rng, seed, seeds: see `model.generate`. control: constraints (`motion_jax.control`) for all motions, a list of them
    for each, a file or a signal; exact: meet them exactly, False: only guide towards them. without: names of steps to
    leave out (`step_names.GENERATE`); plan, cleanup: False leaves out the step of this name. max_attempts: overrides
    that of the Check step. sampling: sampling choices of the model.
    """
    single = isinstance(prompts, str | Plan)
    given = [prompts] if single else list(prompts) if isinstance(prompts, list | tuple) else prompts
    call_steps = list(self._steps(self._left_out(without) | _switched_off(plan, cleanup), max_attempts))
    plans = [prompt if isinstance(prompt, Plan) else None for prompt in given]
    texts = self.model.prompts_of([prompt.text if isinstance(prompt, Plan) else prompt for prompt in given])
    keys, seeds = keys_of(rng, seeds, len(texts), seed)
    sampling = self._sampling(sampling, any(isinstance(step, steps.PlanPrompts) for step in call_steps))
    job = Job(self.planner, texts, self._frames(texts, num_frames, seconds), keys, seeds, sampling,
              constraints_of(control, len(texts)), exact=exact, warns=self.warns, plans=plans, steps=call_steps)
    for step in call_steps:
      step(job)
    motions = gathered([motion.replace(id=f"motion_{i}", meta=motion.meta | (dict(note=note) if note else {}))
                        for i, (motion, note) in enumerate(zip(job.motions, job.notes))])
    return motions[0] if single else motions

  def _frames(self, prompts, num_frames, seconds):
    if num_frames is not None and seconds is not None:
      raise InputError("got both num_frames and seconds; give one of them")
    if seconds is not None:
      expected = "a number such as 6.0, or one per prompt"
      return [None if value is None else as_float(*require_numbers([value], "seconds", expected)) * self.model.fps
              for value in each(seconds, prompts)]
    return each(num_frames, prompts)

  def _left_out(self, without):
    """The steps that `without` names. Raises InputError for an unknown name."""
    return left_out(without, [name for name in dict.fromkeys((*GENERATE, *map(steps.name_of, self.steps)))
                              if name != steps.Sample.name])

  def _steps(self, out, max_attempts):
    """Yields the steps of one call, without those named in `out`."""
    for step in self.steps:
      if steps.name_of(step) in out:
        continue
      checks = isinstance(step, steps.Check) and max_attempts is not None
      yield dataclasses.replace(step, max_attempts=checked(max_attempts, 1, 100, "max_attempts")) if checks else step

  def run(self, requests: Iterable[Request], *, control: Any = None, without: str | Iterable[str] = (),
          **options: Any) -> Iterator[Planned | Motions]:
    """Yields a `Planned` with the plans of all requests, then their `Motions` in batches that fit in memory.

    control, without, options: as in a call, for all requests. Each prompt is parsed once. Notes on prompts are in
    `Planned.notes` instead of warnings.
    """
    requests, out = list(requests), self._left_out(without)
    with timing.part("text"), progress.part("reading the prompts"):
      planned = self._planned(requests, control, out)
      parts = batches(planned.frames, self.model.fps)
    yield planned
    for batch in progress.each(parts, "generating motions", unit="batch"):
      rows = requests[batch]
      prompts = [plan or request.prompt for plan, request in zip(planned.plans[batch], rows)]
      yield self(prompts, [request.frames for request in rows], seeds=[request.seed for request in rows],
                 control=control, without=out | {"warn"}, **options)

  def _planned(self, requests, control, out):
    texts = dict.fromkeys(request.prompt for request in requests)
    plans = {text: None if "plan" in out else self.plan(text, postures=not control) for text in texts}
    notes = [] if "warn" in out else self.notes([plan or text for text, plan in plans.items()], False, not control)
    rows = dict.fromkeys((request.prompt, request.frames) for request in requests)
    schedules = {row: self.schedule(plans[row[0]] or row[0], row[1], control) for row in rows}
    return Planned([plans[request.prompt] for request in requests],
                   [sum(schedules[request.prompt, request.frames][1]) for request in requests], notes)

  def multi_prompt(self, segments: Segments, **options: Any) -> Motion:
    """One motion of several prompts in sequence, [("a person walks", 4.0), ("he sits down", None), ...] in seconds; see
    `multi_prompts`."""
    return self.multi_prompts([segments], **options)[0]

  def multi_prompts(self, lists: Iterable[Segments], *, rng: jax.Array | None = None,
                    seeds: Iterable[int] | None = None, seed: int | None = None, way: str = "stream",
                    cleanup: bool = True, plan: bool = True, rest: bool = False, hold_until_done: bool = False,
                    ease: bool = False, without: str | Iterable[str] = (), **sampling: Any) -> Motions:
    """A motion of each list of segments (prompt, seconds); seconds None is the usual length of a prompt.

    plan: split a prompt of several actions into segments that share its seconds. way: "stream" or, if the model has it,
    "chain", see `CmdmModel.multi_prompts`; "joined" samples each segment independently and joins them where poses fit,
    up to 14 frames off. rest: fill the remaining time of an action that ends by itself, such as a bow, with standing
    still. hold_until_done: give such an action at least its usual time. ease: spread sudden changes of speed between
    prompts over 0.4 s. without: names of steps to leave out (`step_names.MULTI_PROMPT`).
    """
    self._require("multi_prompt")
    out = left_out(without, MULTI_PROMPT) | _switched_off(plan, cleanup)
    plan, cleanup = "plan" not in out, "cleanup" not in out
    lists = [list(segments) for segments in lists]
    for segments in lists:
      self.model.segments_of(segments)  # raises InputError for invalid ones
    if not lists:
      raise InputError("got no prompts, expected a list of (prompt, seconds or None) for each motion")
    ways = self.model.ways
    if way not in (known := (*(ways or ("stream",)), "joined")):
      raise InputError(f"got way {way!r}, {self.model.id} knows {', '.join(known)}")
    choice = {"way": way} if ways else {}
    if "warn" not in out:
      self.warn([prompt for segments in lists for prompt, _ in segments], plan)
    rows = [segments_of(self.planner, segments, plan) for segments in lists]
    keys, seeds = keys_of(rng, seeds, len(rows), seed)
    sampling = self._sampling(sampling, plan)
    if hold_until_done:
      rows = [[(prompt, max(count, durations.frames_until_done(self.planner, prompt))) for prompt, count in row]
              for row in rows]

    def sample_segments(*given):  # `ease` is not for "joined", which blends at the borders anyway
      return (sample_independently(self.model, *given) if way == "joined" else
              self.model.sample_segments(*given, **choice, ease=ease))

    planned = [[record("plan", " | ".join(prompt for prompt, _ in row))] if plan else [] for row in rows]
    if not rest:
      return gathered([_after(records, motion) for records, motion in zip(
          planned, sample_segments(rows, keys, seeds, cleanup, sampling))])
    plans, lengths = zip(*(durations.with_pauses(self.planner, row) for row in rows))
    job = Job(self.planner, [prompt_plan.text for prompt_plan in plans], [None] * len(rows), keys, seeds, sampling,
              [[] for _ in rows], cleanup=cleanup, plans=list(plans), scheduled=list(plans))
    job.motions = list(map(_after, planned, sequencing.compose(job, lengths, sample_segments)))
    if "pose" not in out:
      steps.Pose()(job)
    return gathered(job.motions)

  def stream(self, prompt: str, *, plan: bool = True, hold_until_done: bool = False, cleanup: bool = True,
             num_frames: int | None = None, without: str | Iterable[str] = (), **options: Any) -> PlannedStream:
    """A live stream of a prompt, action by action; the last one continues without end (`PlannedStream`).

    without: names of steps to leave out (`step_names.EXTEND`). options: see `model.stream`.
    """
    self._require("stream")
    out = left_out(without, EXTEND) | _switched_off(plan, cleanup)
    plan, cleanup = "plan" not in out, "cleanup" not in out
    prompt, = self.model.prompts_of(prompt)
    if "warn" not in out:
      self.warn([prompt], plan)
    segments: Any = prompt
    if plan:
      segments = [(action_prompt, None if count is None else count / self.model.fps)
                  for action_prompt, count in prompts_in_sequence(self.planner, self.planner.plan(prompt), num_frames,
                                                                  is_endless=num_frames is None)]
    live = self.model.stream(segments, cleanup=cleanup, num_frames=num_frames, **self._with_contrast(options))
    return PlannedStream(live, self, prompt, out, hold_until_done)

  def extend(self, clip: Clip | Array, prompt: str | Segments, num_frames: int | None = None, *,
             seconds: float | None = None, plan: bool = True, cleanup: bool = True,
             without: str | Iterable[str] = (), **options: Any) -> Motion:
    """Continue an existing motion with a prompt, or with segments, planned action by action.

    without: names of steps to leave out (`step_names.EXTEND`). options: see `model.extend`.
    """
    self._require("extend")
    out = left_out(without, EXTEND) | _switched_off(plan, cleanup)
    plan, cleanup = "plan" not in out, "cleanup" not in out
    if isinstance(prompt, str):
      if num_frames is not None or seconds is not None:
        seconds = self.model.frames_of([prompt], num_frames, seconds)[0] / self.model.fps
      prompt = [(prompt, seconds)]
    self.model.segments_of(prompt)  # raises InputError for invalid ones
    if "warn" not in out:
      self.warn([text for text, _ in prompt], plan)
    rows = [(text, count / self.model.fps) for text, count in segments_of(self.planner, prompt, plan)]
    planned = [record("plan", " | ".join(text for text, _ in rows))] if plan else []
    return _after(planned, self.model.extend(clip, rows, cleanup=cleanup, **self._with_contrast(options)))

  def edit(self, clip: Clip | Array, prompt: str, task: str | None = None, **options: Any) -> Motion:
    """Regenerate frames of an existing motion from a prompt; all others stay unchanged. See `edits`."""
    return self.edits([clip], [prompt], task, **options)[0]

  def edits(self, clips: Sequence[Clip | Array], prompts: Sequence[str], task: str | None = None, *,
            keep: Spans | None = None, change: Spans | None = None, rng: jax.Array | None = None,
            seeds: Iterable[int] | None = None, seed: int | None = None, cleanup: bool = True, plan: bool = True,
            max_attempts: int = MAX_ATTEMPTS, mask: str | None = None, without: str | Iterable[str] = (),
            control: Any = None, **sampling: Any) -> Motions:
    """Regenerate frames of clips, each from its prompt; the best of up to max_attempts samples is kept.

    clips, and the choice of new frames by task, keep or change: see the model's `edits`. All other frames keep their
    poses and places, at the model's frame rate; new ones continue them on the clip's own body, with feet pinned unless
    cleanup is False. Of a motion that is too long for the model only the seconds around the new frames are sampled.
    without: names of steps to leave out (`step_names.EDIT`). control: keys that the new frames meet, poses and targets
    with times in them, in the forms of `__call__`.
    """
    self._require("edit")
    if len(prompts) != len(clips) or not clips:
      raise InputError(f"got {len(prompts)} prompts for {len(clips)} clips; give one for each")
    if sum(choice is not None for choice in (task, keep, change)) != 1:
      raise InputError("say what to make by one of task, keep and change")
    out = left_out(without, EDIT) | _switched_off(plan, cleanup)
    texts = self.model.prompts_of(prompts)
    plans = [None if "plan" in out else self.planner.plan(text) for text in texts]
    if "warn" not in out:
      self.warn(texts, plan=False)
    keys, seeds = keys_of(rng, seeds, len(clips), seed)
    sampling = self._sampling(sampling | (dict(mask=mask) if mask else {}))
    if "mask" in self.model.options.described():
      sampling = {"mask": self.model.edit_mask} | sampling
    job = Job(self.planner, texts, [None] * len(texts), keys, seeds, sampling, [[] for _ in texts],
              cleanup="cleanup" not in out, warns=self.warns, plans=plans, records=list(map(plan_records, plans)))
    attempts = 1 if "check" in out else checked(max_attempts, 1, 100, "max_attempts")
    new = lambda count: requested_frames(count, task, keep, change)
    options = dict(max_attempts=attempts, task=task or "spans", corrects="correct" not in out)
    given = constraints_of(control, len(clips))
    if any(map(is_constrained, given)):
      return gathered([editing.edited_through(job.select([i]), clip, given[i], new, **options)
                       for i, clip in enumerate(clips)])
    return editing.edited(job, clips, new, **options)

  def blend(self, first: Clip, second: Clip, seconds: float = 1.0) -> Clip:
    """The first motion followed by the second, which is moved on the ground to continue it, blended over `seconds`."""
    return blended(first, second, seconds)[0]


def _switched_off(plan, cleanup):
  """Names of the steps that plan=False and cleanup=False leave out."""
  return {name for name, on in (("plan", plan), ("cleanup", cleanup)) if not on}


def _after(records, motion):
  """The motion with records of earlier steps in front of its own."""
  return motion.replace(meta=motion.meta | {"steps": [*records, *motion.meta.get("steps", ())]})
