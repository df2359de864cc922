"""Handlers of requests that generate, edit or read motions: a parsed request in, a JSON object out."""
import contextlib
import tempfile
import threading
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_jax import export
from motion_jax.control.compiling import compile
from motion_jax.control.constraints import Constraint
from motion_jax.control.keys import without_slack
from motion_jax.data.clip import Clip
from motion_jax.export import scene
from motion_jax.export.files import READERS
from motion_jax.models.results import Motion
from motion_jax.motion.step_records import record
from motion_jax.utils import progress
from motion_jax.utils.errors import InputError
from motion_jax_studio.checks.reports import attempts_note
from motion_jax_studio.constraining import implied_frames
from motion_jax_studio.planning.segments import segments_of
from motion_jax_studio.server import serialization
from motion_jax_studio.server.library import Library, live_sampling
from motion_jax_studio.server.limits import Limits, check_sampling
from motion_jax_studio.server.multi_prompt import MultiPromptCache
from motion_jax_studio.server.security import Refused

_CHECKED = 0.5  # seconds between two checks of whether a waiting request was cancelled
_IN_TWO_FILES = (".amc", ".gltf")  # formats whose motion needs another file


class RequestHandler:
  """Runs requests: `jobs` of them at the same time, twice as many wait, further ones are refused."""

  def __init__(self, library: Library, limits: Limits) -> None:
    self.library, self.limits, self.multi_prompts = library, limits, MultiPromptCache()
    self._places = threading.Semaphore(limits.jobs)
    self._admitted = threading.Semaphore(3 * limits.jobs)

  @contextlib.contextmanager
  def place(self):
    """Waits for a free place to run a job. Raises Refused if too many wait already."""
    if not self._admitted.acquire(blocking=False):
      raise Refused(429, f"{3 * self.limits.jobs} requests run or wait already; wait for one of them")
    try:
      with progress.part("waiting for another motion that is being generated"):
        while not self._places.acquire(timeout=_CHECKED):
          progress.check()
      try:
        yield
      finally:
        self._places.release()
    finally:
      self._admitted.release()

  def generate(self, request: Any) -> dict[str, Any]:
    """`Generate` -> {motions, notes, constraints}."""
    pipeline, control = self.library.pipeline(request.model, "generate"), list(request.control)
    model = pipeline.model
    check_sampling(model, request.sampling)
    implied = implied_frames(pipeline.planner, control) if control and request.seconds is None else None
    if implied is not None and implied > self.limits.seconds * model.fps:
      raise InputError(f"control: got what takes {implied / model.fps:.0f} s, expected at most "
                       f"{self.limits.seconds:g} s; give seconds, times or a larger speed")
    seeds = [(request.seed + i) % 2**32 for i in range(request.num_samples)]
    with self.place(), progress.part("generating the motion"):
      motions = pipeline([request.prompt] * len(seeds), seconds=request.seconds, seeds=seeds, plan=request.plan,
                         cleanup=request.cleanup, exact=request.cleanup, control=control or None,
                         without=request.without, **request.sampling)
    report = {"constraints": [constraints_of(control, motion) for motion in motions]} if control else {}
    return {"motions": [serialization.to_json(motion) for motion in motions]} | report | notes_and_unknown_words(
        pipeline, [request.prompt], notes_of(motions), request.plan and "plan" not in request.without, request.without)

  def multi_prompt(self, request: Any) -> dict[str, Any]:
    """`MultiPrompt` -> {motion, reused_frames, same_frames, notes, unknown, segments, constraints}."""
    rows, control = [(segment.prompt, segment.seconds) for segment in request.segments], list(request.control)
    pipeline = self.library.pipeline(request.model, "multi_prompt")
    with self.place():
      motion, reused, same = self.make_multi_prompt(pipeline, rows, request.seed, request.cleanup,
                                                    request.sampling, request.past, control, request.without)
    report = {"constraints": constraints_of(control, motion)} if control else {}
    return {"motion": serialization.to_json(motion), "reused_frames": reused, "same_frames": same} | report | (
        segment_notes(pipeline, [prompt for prompt, _ in rows], request.without))

  def make_multi_prompt(self, pipeline, rows, seed, cleanup, sampling, past=None, control=(), without=()):
    """(motion, frames that were reused, frames equal to the previous motion) from rows (prompt, seconds or None).

    past: a motion to continue. control: constraints of the motion. without: steps that are left out.
    """
    check_sampling(pipeline.model, sampling)
    cleanup = cleanup and "cleanup" not in without
    if past is not None and control:
      raise InputError("got control together with past, a motion to continue; give only one of them")
    if past is not None:
      motion = pipeline.extend(past, rows, seed=seed, cleanup=cleanup, without=without, **sampling)
      return motion, 0, past.num_frames
    model, segments = pipeline.model, segments_of(pipeline.planner, rows, "plan" not in without)
    if sum(frames for _, frames in segments) > self.limits.seconds * model.fps:
      raise InputError(f"got a motion of {sum(frames for _, frames in segments) / model.fps:.0f} s, expected at most "
                       f"{self.limits.seconds:g}")
    sampling = live_sampling(model, sampling)
    motion, reused, same = self.multi_prompts.make(pipeline, segments, seed, cleanup, sampling, control)
    planned = [] if "plan" in without else [record("plan", " | ".join(prompt for prompt, _ in segments))]
    return motion.replace(meta=motion.meta | {"steps": [*planned, *motion.meta["steps"]]}), reused, same

  def edit(self, request: Any) -> dict[str, Any]:
    """`Edit` -> {motion, made, notes, constraints}."""
    if (request.change is None) == (request.keep is None):
      raise InputError("got both or neither of change and keep; give one of them, the frames to regenerate or to keep")
    pipeline = self.library.pipeline(request.model, "edit")
    with self.place(), progress.part("generating the span"):
      motion = make_edit(pipeline, request.motion, request.prompt, request.change, request.keep, request.seed,
                         request.sampling, request.without, request.control)
    report = {"constraints": constraints_of(request.control, motion)} if request.control else {}
    return {"motion": serialization.to_json(motion), "made": motion.meta["made"]} | report | notes_and_unknown_words(
        pipeline, [request.prompt], notes_of([motion]), without=request.without)

  def read(self, data: bytes, name: str) -> dict[str, Any]:
    """{motion} from the bytes of an uploaded file; only the ending of its name is used."""
    ending = Path(name).suffix.lower()
    if ending not in READERS or ending in _IN_TWO_FILES:
      readable = ", ".join(known for known in READERS if known not in _IN_TWO_FILES)
      raise InputError(f"got a file that ends in {ending[:12]!r}, expected one of {readable}")
    with tempfile.TemporaryDirectory() as folder:
      path = Path(folder) / f"upload{ending}"
      path.write_bytes(data)
      try:
        with self.place():
          clip = export.load(path)
      except (ValueError, OSError) as error:
        raise InputError(str(error).replace(str(path), "the file")) from None
    if clip.num_frames > self.limits.frames:
      raise InputError(f"got a motion of {clip.num_frames:,} frames, expected at most {self.limits.frames:,}")
    return {"motion": serialization.to_json(clip)}


def constraints_of(control: Sequence[Constraint], motion: Clip) -> dict[str, Any]:
  """Constraints as they apply to a motion: {targets: [[frame, x, y, z]], poses: [{frame, joints}], off: {mean, worst,
  frame, joint}}. `off` is the distance in millimetres, of keys at full strength; it is missing if no constraint
  has a place."""
  known = without_slack([key for key in control if getattr(key, "strength", 1) == 1], motion.joints, motion.fps)
  signal = compile(known, motion.num_frames, motion.fps, motion.joints)
  parts, off = scene.parts_of(signal), scene.distance(signal, motion)
  return {"targets": [[frame, *np.round(place, 4).tolist()] for frame, _, place in parts.targets],
          "poses": [{"frame": frame, "joints": np.round(joints, 4).tolist()} for frame, joints in parts.poses]
          } | ({"off": off} if off else {})


def make_edit(pipeline: Any, clip: Any, prompt: str, change: Any, keep: Any, seed: int, sampling: dict[str, Any],
              without: Collection[str] = (), control: Sequence[Constraint] = ()) -> Motion:
  """Regenerate the frames of a clip in the spans `change`, or outside the spans `keep`; the others are unchanged.

  control: keys in the new frames; with keys one attempt is made, for an animator waits for it.
  """
  check_sampling(pipeline.model, sampling)
  spans = change if change is not None else keep
  if spans[-1][1] > clip.num_frames:
    raise InputError(f"got spans beyond the {clip.num_frames} frames of the motion")
  fps = pipeline.model.fps
  rate, frames = fps / clip.fps, int((clip.num_frames - 1) * fps / clip.fps + 1e-6) + 1
  spans = [(first, min(max(round(past * rate), first + 1), frames))
           for first, past in ((min(round(first * rate), frames - 1), past) for first, past in spans)]
  which = dict(change=spans) if change is not None else dict(keep=spans)
  keyed = dict(control=list(control), max_attempts=1) if control else {}
  edited = pipeline.edit(clip, prompt, seed=seed, without=without, **which, **keyed, **sampling)
  return edited.replace(source=clip.source or edited.source, meta=edited.meta | dict(said=prompt))


def notes_of(motions: Sequence[Any]) -> list[str]:
  """Notes for the page: paths that do not fit the prompt, requirements that all attempts missed."""
  several, notes = len(motions) > 1, [motion.meta["note"] for motion in motions[:1] if motion.meta.get("note")]
  for i, motion in enumerate(motions):
    if unmet := motion.meta.get("unmet"):
      note = attempts_note(len(motion.meta["attempts"]), unmet, motion.meta["prompt"])
      notes.append(f"take {i + 1}: " * several + note)
  return notes


def notes_and_unknown_words(pipeline: Any, prompts: list[str], notes: Sequence[str] = (), plan: bool = True,
                            without: Collection[str] = ()) -> dict[str, Any]:
  """{notes, unknown}: notes about the prompts and the motions, and words that the model does not know; without the step
  "warn" only those about the motions."""
  if "warn" in without:
    return {"notes": [*notes]}
  captions = pipeline.model.captions  # for a prompt in another language one note replaces the list of words
  unknown = sorted({word for prompt in filter(captions.is_english, prompts) for word in captions.unknown_words(prompt)})
  return {"notes": [*pipeline.notes(prompts, plan), *notes]} | ({"unknown": unknown[:20]} if unknown else {})


def segment_notes(pipeline: Any, prompts: Sequence[str], without: Collection[str] = ()) -> dict[str, Any]:
  """{notes, unknown, segments}: segments has {notes, unknown, nearest} of each prompt, nearest the training caption
  that is closest in meaning, "" for a prompt without notes."""
  of_prompt = {prompt: notes_and_unknown_words(pipeline, [prompt], without=without)
               for prompt in dict.fromkeys(prompts)}
  segments = [{"notes": of_prompt[prompt]["notes"], "unknown": of_prompt[prompt].get("unknown", []),
               "nearest": nearest_caption(pipeline, prompt) if any(of_prompt[prompt].values()) else ""}
              for prompt in prompts]
  return notes_and_unknown_words(pipeline, list(prompts), without=without) | {"segments": segments}


def nearest_caption(pipeline: Any, prompt: str) -> str:
  """The training caption that is closest in meaning to a prompt, "" where a model has no captions or cannot read it."""
  if not pipeline.model.captions.is_english(prompt):
    return ""
  return next((text for text, _ in pipeline.planner.nearest_captions(prompt)), "")
