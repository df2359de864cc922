"""Models that edit: frames of a clip are sampled again, and all frames are decoded.

For a `LatentEditingModel` a new motion is an edit of everything: its network fills the masked latents of a motion.
"""
import dataclasses
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, cast

import jax
import numpy as np

from motion_jax.models import arguments
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.keys import keys_of
from motion_jax.models.results import Motion, Motions, features_of, motions_of_prompts
from motion_jax.models.shared import length, pasting
from motion_jax.models.shared.known_motion import clip_of, on_our_body
from motion_jax.motion.filling import runs_of
from motion_jax.motion.representations import get_layout
from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.shapes import Bool, Float
from motion_jax.text.captions import of_a_person
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields
from motion_jax.utils.errors import InputError

if TYPE_CHECKING:
  from motion_jax.control.signal import ControlSignal
  from motion_jax.runs import Run
  from motion_jax.text.encoder import TextEncoder


def edited_latents(new: Sequence[Bool[np.ndarray, " _"]], length: int, frames_per_latent: int
                   ) -> Bool[np.ndarray, "b {length}"]:
  """(B, L): the latents with any new frame, of new (T,) for each clip."""
  edited = np.zeros((len(new), length), bool)
  for row, flags in zip(edited, new):
    row[np.flatnonzero(flags) // frames_per_latent] = True
  return edited


def padded_features(model: TextToMotionModel, features: Sequence[Float[np.ndarray, "_ f"]], length: int
                    ) -> Float[np.ndarray, "b {length} f"]:
  """Features (T, F) of each clip normalized and padded with zeros; the last frame fills its latent."""
  unit = model.frames_per_latent
  padded = np.zeros((len(features), length, model.stats.layout.dim), np.float32)
  for row, x in zip(padded, features):
    row[:len(x) + -len(x) % unit] = model.stats.normalize(np.pad(x, ((0, -len(x) % unit), (0, 0)), mode="edge"))
  return padded


class EditingModel(TextToMotionModel):
  """A model that samples new frames of a clip. A method implements `inpainted`."""

  def inpainted(self, features: Sequence[Float[np.ndarray, "_ f"]], new: Sequence[Bool[np.ndarray, " _"]],
                prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any]
                ) -> tuple[Float[np.ndarray, "b t f"], dict[str, Any]]:
    """(normalized features (B, T, F), record of the sampling) of clips of features (T, F), not normalized, whose frames
    of new (T,) are sampled."""
    raise NotImplementedError(f"{type(self).__name__} has no `inpainted` (docs/adding.md)")

  def new_frames(self, num_frames: int, task: str | None, keep: pasting.Spans | None, change: pasting.Spans | None
                 ) -> Bool[np.ndarray, " {num_frames}"]:
    """(num_frames,): the frames of whole latents that an edit samples, see `edits`."""
    return pasting.requested_frames(num_frames, task, keep, change)

  def inpaint(self, features: Sequence[Float[np.ndarray, "_ f"]], new: Sequence[Bool[np.ndarray, " _"]],
              prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any]
              ) -> tuple[list[Float[np.ndarray, "_ f"]], dict[str, Any]]:
    """(features (T, F) of each motion, not normalized, record of the sampling): see `inpainted`. `shared.pasting` puts
    the new frames into the clip that they belong to."""
    sampled, record = self.inpainted(features, new, prompts, keys, sampling)
    return [self.stats.denormalize(x[:len(given)]) for x, given in zip(sampled, features)], record

  @arguments.checked
  def edit(self, clip: Any, prompt: str, task: str | None = None, *, keep: pasting.Spans | None = None,
           change: pasting.Spans | None = None, rng: jax.Array | None = None, seed: int | None = None,
           seeds: Iterable[int] | None = None, cleanup: bool = False, **sampling: Any) -> Motion:
    """An existing motion with parts of it sampled from a prompt; see `edits`."""
    return self.edits([clip], [prompt], task, keep=keep, change=change, rng=rng, seeds=seeds, seed=seed,
                      cleanup=cleanup, **sampling)[0]

  @arguments.checked
  def edits(self, clips: Sequence[Any], prompts: Sequence[str], task: str | None = None, *,
            keep: pasting.Spans | None = None, change: pasting.Spans | None = None, rng: jax.Array | None = None,
            seeds: Iterable[int] | None = None, seed: int | None = None, cleanup: bool = False, **sampling: Any
            ) -> Motions:
    """The paper's editing: clips with the chosen frames sampled from their prompts, all frames as the networks decode
    them, in one batch.

    clips: of any source, joints (T, J, 3), or features (T, F), not normalized. New are a task of `spans.TASKS`,
    or spans to keep or to change, [(0, 30), ...] in frames of this model (`spans.spans_of` reads "0:1.5s"), the
    same in every clip. meta["made"] lists the new frames. The motion stands where the model begins, at the origin
    facing +Z; `shared.pasting` puts new frames into the clip itself. sampling: choices of this method's `options`.
    """
    # Parity: the released codes paste nothing back, either.
    prompts = self.prompts_of(prompts) if prompts else []
    if len(prompts) != len(clips) or not clips:
      raise InputError(f"got {len(prompts)} prompts for {len(clips)} clips; give one for each")
    if sum(choice is not None for choice in (task, keep, change)) != 1:
      raise InputError("say what to make by one of task, keep and change")
    keys, seeds = keys_of(rng, seeds, len(clips), seed)
    sources, features = zip(*map(self._source, clips))
    new = [self.new_frames(len(x), task, keep, change) for x in features]
    if not all(flags.any() for flags in new):
      raise InputError("everything is kept, so there is nothing to make; choose a span to change, or a shorter one to "
                       "keep")
    sampled, record = self.inpainted(features, new, prompts, keys, sampling)
    motions = motions_of_prompts(self, sampled, prompts, [len(x) for x in features], seeds,
                                 record | dict(task=task or "spans"), cleanup)
    return dataclasses.replace(motions, motions=tuple(
        motion.replace(id=clip.id, license=clip.license or motion.license,
                       meta=motion.meta | dict(edited=clip.source or clip.id, made=self._runs(flags)))
        for motion, clip, flags in zip(motions, sources, new)))

  def _source(self, clip):
    """(the clip as a `Clip`, its features (T, F), not normalized, T cut to whole latents)."""
    layout, unit, most = self.stats.layout, self.frames_per_latent, self.config.data.max_frames
    source = clip_of(clip, layout)
    features = source.features if source is not clip and source.features is not None else (
        features_of(self, on_our_body(source, self.fps, layout.skeleton)))
    count = len(features) // unit * unit
    if not unit <= count <= most:
      raise InputError(f"got a motion of {len(features)} frames at {self.fps:g} frames a second, expected {unit} to "
                       f"{most}; cut a part out of it")
    return source, features[:count]

  def _runs(self, new):
    """[[first, past], ...] of the latents with any new frame, in frames."""
    unit = self.frames_per_latent
    return [list(run) for run in runs_of(np.repeat(edited_latents([new], len(new) // unit, unit)[0], unit))]


class LatentEditingModel(EditingModel):
  """A model that fills masked latents, all of a new motion or the new ones of an edit. Motions are padded to the
  length of training and cut to whole latents. A method implements `encoded` and `filled`."""

  def __init__(self, run: "Run", encoder: "TextEncoder", text_dim: int, frames_per_latent: int,
               frozen_shapes: dict[str, Any], shapes: Any) -> None:
    config = run.config
    self.length = LengthEstimator(**module_fields(config.length)) if config.length else None
    if self.length:
      frozen_shapes = frozen_shapes | {"length": length.length_shapes(self.length, text_dim)}
    self.max_seconds = config.data.max_frames / get_layout(config.data.layout).skeleton.fps
    self.max_latents = config.data.max_frames // frames_per_latent
    super().__init__(run, encoder, text_dim, frames_per_latent, frozen_shapes, shapes)
    self._logits = cache.Program("length", lambda params, text_emb: cast(Any, self.length).apply(params, text_emb), 0,
                                 (self.length,))

  def encoded(self, features: Float[np.ndarray, "b t f"], real_mask: Bool[np.ndarray, "b l"]) -> Any:
    """Latents (B, L, ...) of normalized, padded features."""
    raise NotImplementedError(f"{type(self).__name__} has no `encoded` (docs/adding.md)")

  def filled(self, latents: Any, editable: Bool[np.ndarray, "b l"], real_mask: Bool[np.ndarray, "b l"],
             prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any], signal: "ControlSignal | None" = None
             ) -> tuple[Any, dict[str, Any]]:
    """(normalized features (B, T, F), record of the sampling) with the editable latents sampled; latents None: of a
    new motion."""
    raise NotImplementedError(f"{type(self).__name__} has no `filled` (docs/adding.md)")

  def estimated_frames(self, prompt: str) -> int | None:
    """The median length by the length estimator, at most that of training; None for a run without one."""
    if self.length is None:
      return None
    logits = self._logits(self.frozen["length"], self.encoder([of_a_person(prompt)])[0][:, 0])
    return min(int(length.middle_frames(logits, self.frames_per_latent)[0]), self.config.data.max_frames)

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: "ControlSignal | None" = None) -> Motions:
    """One pass of the network: motions of prompts, a key each."""
    unit = self.frames_per_latent
    frames = [count // unit * unit for count in frames]
    every = np.arange(self.max_latents) < np.array(frames)[:, None] // unit
    features, record = self.filled(None, every, every, prompts, keys, sampling, signal)
    return motions_of_prompts(self, features, prompts, frames, seeds, record, cleanup)

  def inpainted(self, features: Sequence[Float[np.ndarray, "_ f"]], new: Sequence[Bool[np.ndarray, " _"]],
                prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any]
                ) -> tuple[Float[np.ndarray, "b t f"], dict[str, Any]]:
    """(normalized features (B, T, F), record of the sampling): latents with any new frame are sampled, and all are
    decoded. A motion may end within a latent."""
    unit = self.frames_per_latent
    real_mask = np.arange(self.max_latents) < np.array([[-(-len(x) // unit)] for x in features])
    latents = self.encoded(padded_features(self, features, self.max_latents * unit), real_mask)
    sampled, record = self.filled(latents, edited_latents(new, self.max_latents, unit), real_mask, prompts, keys,
                                  sampling)
    return np.asarray(sampled), record
