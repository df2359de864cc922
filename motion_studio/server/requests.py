"""Requests become motions: from words, of several prompts, edits, and what goes on from a motion that exists."""
import contextlib
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from motion_jax import export
from motion_jax.models.results import Motion
from motion_jax.utils import progress
from motion_jax.utils.errors import InputError
from motion_studio.checks.reports import note_of
from motion_studio.controlled import usual_frames
from motion_studio.server import constraint_report, serialization
from motion_studio.server.library import Library, live_sampling
from motion_studio.server.limits import Fields, Limits, told_plainly
from motion_studio.server.multi_prompt import MultiPromptCache
from motion_studio.server.security import Refused


class RequestHandler:
  """Makes what a request asks for. A request is one call; a few run at once, as many more wait, others are refused."""

  def __init__(self, library: Library, limits: Limits) -> None:
    self.library, self.limits, self.stories = library, limits, MultiPromptCache()
    self._places = threading.Semaphore(limits.jobs)
    self._waiting = threading.Semaphore(2 * limits.jobs)

  @contextlib.contextmanager
  def place(self):
    """Where a job runs. Raises Refused where too many wait already."""
    if not self._waiting.acquire(blocking=False):
      raise Refused(429, f"{2 * self.limits.jobs} requests are being made already; wait for one of them")
    try:
      with progress.part("waiting for another motion that is being made"):
        self._places.acquire()
      try:
        yield
      finally:
        self._places.release()
    finally:
      self._waiting.release()

  # --- requests: a JSON object in, a JSON object out -----------------------------------------------------------------

  def generate(self, body: Any) -> dict[str, Any]:
    """{prompt, model, seconds, seed, num, cleanup, literal, sampling, control} -> {motions, notes, asked}."""
    fields = Fields(body, self.limits)
    prompt, name = fields.prompt(), fields.text("model", None)
    seconds = fields.number("seconds", 0.2, self.limits.seconds, None)
    seed, num = fields.seed(), fields.number("num", 1, self.limits.takes, 1, whole=True)
    cleanup, literal, sampling = fields.switch("cleanup", True), fields.switch("literal", False), fields.choices()
    control = fields.control()
    fields.done()
    model = self.library.model(name, "generate")
    implied = usual_frames(model, control) if control and seconds is None else None
    if implied is not None and implied > self.limits.seconds * model.fps:
      raise InputError(f"control: got what takes {implied / model.fps:.0f} s, expected at most "
                       f"{self.limits.seconds:g} s; give seconds, times or a larger speed")
    given = sampling | (dict(literal=literal) if model.can("understand") else {})
    given |= dict(control=control, project=cleanup) if control else {}
    with self.place(), told_plainly(), progress.part("making the motion"):
      made = model.generate([prompt] * num, seconds=seconds, seeds=[(seed + i) % 2**32 for i in range(num)],
                            cleanup=cleanup, **given)
    told = {"asked": [constraint_report.told(control, motion) for motion in made]} if control else {}
    return {"motions": [serialization.to_json(motion) for motion in made]} | told | words_of(
        model, [prompt], notes_of(made), literal)

  def story(self, body: Any) -> dict[str, Any]:
    """{blocks: [{prompt, seconds}], model, seed, cleanup, sampling, past, control} -> {motion, reused_frames,
    same_frames, asked}."""
    fields = Fields(body, self.limits)
    rows, name, seed = fields.any("blocks"), fields.text("model", None), fields.seed()
    cleanup, sampling, past = fields.switch("cleanup", True), fields.choices(), fields.any("past")
    control = fields.control()
    fields.done()
    rows = segment_rows(rows, self.limits)
    past = None if past is None else serialization.from_json(past, self.limits.frames)
    model = self.library.model(name, "multi_prompt")
    with self.place(), told_plainly():
      motion, reused, same = self.make_multi_prompt(model, rows, seed, cleanup, sampling, past, control)
    told = {"asked": constraint_report.told(control, motion)} if control else {}
    return {"motion": serialization.to_json(motion), "reused_frames": reused, "same_frames": same} | told | words_of(
        model, [prompt for prompt, _ in rows])

  def make_multi_prompt(self, model, rows, seed, cleanup, sampling, past=None, control=()):
    """(motion, frames not made anew, frames as before) of rows (prompt, seconds or None), behind a past motion, or as
    constraints ask."""
    if past is not None and control:
      raise InputError("got control of a story that goes on from a motion; leave out the motion, or the control")
    if past is not None:
      return model.extend(past, rows, seed=seed, cleanup=cleanup, **sampling), 0, past.num_frames
    segments = model.segments_of(rows)
    if sum(frames for _, frames in segments) > self.limits.seconds * model.fps:
      raise InputError(f"got a story of {sum(frames for _, frames in segments) / model.fps:.0f} s, expected at most "
                       f"{self.limits.seconds:g}")
    sampling = live_sampling(model, sampling)
    if control:
      return *constraint_report.made(self.stories, model, segments, seed, cleanup, sampling, control), 0
    return self.stories.make(model, segments, seed, cleanup, sampling)

  def edit(self, body: Any) -> dict[str, Any]:
    """{motion, prompt, change or keep, model, seed, sampling} -> {motion, made, notes}."""
    fields = Fields(body, self.limits)
    clip = serialization.from_json(fields.any("motion"), self.limits.frames)
    prompt, name, seed = fields.prompt(), fields.text("model", None), fields.seed()
    change, keep, sampling = fields.spans("change"), fields.spans("keep"), fields.choices()
    fields.done()
    if (change is None) == (keep is None):
      raise InputError("got both or neither of change and keep; say which frames are made anew by one of them")
    name = name if name is not None else self._able("edit")
    model = self.library.model(name, "edit")
    with self.place(), told_plainly(), progress.part("making the span"):
      motion = make_edit(model, clip, prompt, change, keep, seed, sampling)
    return {"motion": serialization.to_json(motion), "made": motion.meta["made"]} | words_of(
        model, [prompt], notes_of([motion]))

  def _able(self, ability):
    """The first model that can do something; the first of all where none can yet."""
    for slot in self.library.slots.values():
      slot.ready.wait(600)
      if slot.model is not None and slot.model.can(ability):
        return slot.name
    return None

  def read(self, data: bytes, name: str) -> dict[str, Any]:
    """The motion in the bytes of a file that a page sent; of its name only the ending counts."""
    ending = Path(name).suffix.lower()
    if ending not in (".npz", ".npy", ".bvh"):
      raise InputError(f"got a file that ends in {ending[:12]!r}, expected .npz, .npy or .bvh")
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


def segment_rows(rows: Any, limits: Limits) -> list[tuple[str, float | None]]:
  """[(prompt, seconds or None)] of the blocks of a story, as a request or a project has them."""
  if not isinstance(rows, list) or not rows:
    raise InputError("got no blocks, expected a list such as [{\"prompt\": \"a person walks\", \"seconds\": 4}]")
  if len(rows) > limits.blocks:
    raise InputError(f"got {len(rows):,} blocks, expected at most {limits.blocks}")
  found = []
  for row in rows:
    fields = Fields(row, limits)
    found.append((fields.prompt(), fields.number("seconds", 0.2, limits.seconds, None)))
    fields.done()
  return found


def make_edit(model: Any, clip: Any, prompt: str, change: Any, keep: Any, seed: int, sampling: dict[str, Any]
              ) -> Motion:
  """The clip with new frames in the spans of `change`, or in all but those of `keep`; others stay as they are."""
  spans = change if change is not None else keep
  if spans[-1][1] > clip.num_frames:
    raise InputError(f"got spans beyond the {clip.num_frames} frames of the motion")
  rate, frames = model.fps / clip.fps, int((clip.num_frames - 1) * model.fps / clip.fps + 1e-6) + 1
  spans = [(first, min(max(round(past * rate), first + 1), frames))
           for first, past in ((min(round(first * rate), frames - 1), past) for first, past in spans)]
  which = dict(change=spans) if change is not None else dict(keep=spans)
  edited = model.edit(clip, prompt, seed=seed, **which, **sampling)
  return edited.replace(source=clip.source or edited.source, meta=edited.meta | dict(said=prompt))


def notes_of(motions: Sequence[Any]) -> list[str]:
  """Notes for the page: paths that do not fit the prompt, requirements that all attempts missed."""
  several, found = len(motions) > 1, [motion.meta["note"] for motion in motions[:1] if motion.meta.get("note")]
  for i, motion in enumerate(motions):
    if unmet := motion.meta.get("unmet"):
      found.append(f"take {i + 1}: " * several + note_of(motion.meta["attempts"], unmet, motion.meta["prompt"]))
  return found


def words_of(model: Any, prompts: list[str], notes: Sequence[str] = (), literal: bool = False) -> dict[str, Any]:
  """Words of prompts that the model does not know, and notes about the prompts and more of them, for the page."""
  unknown = sorted({word for prompt in prompts for word in model.unknown_words(prompt)})
  return {"notes": [*model.notes_of(prompts, literal), *notes]} | ({"unknown": unknown[:20]} if unknown else {})
