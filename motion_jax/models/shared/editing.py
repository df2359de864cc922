"""Edits by methods that resample frames of a clip: which frames are new, what is decoded, and its motion."""
import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from motion_jax.data.clip import Caption
from motion_jax.models import arguments
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.keys import keys_of
from motion_jax.models.results import Motion, Motions, features_of, make_motions
from motion_jax.models.shared import pasting
from motion_jax.models.shared.known_motion import clip_of, on_our_body
from motion_jax.motion.filling import runs_of
from motion_jax.utils.errors import InputError


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


def decoded_edits(model: TextToMotionModel, fill: Callable[..., tuple[Any, dict[str, Any]]], clips: Sequence[Any],
                  prompts: Sequence[str], new: Callable[[int], Bool[np.ndarray, " t"]], keys: jax.Array,
                  seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any], task: str = "spans") -> Motions:
  """Clips whose frames new(num_frames) -> (T,) are sampled, all frames decoded, in one batch.

  fill(features, new, prompts, keys, sampling) -> (normalized features (B, T, F), record of the sampling). meta["made"]
  lists the new frames. The motion stands where the model begins; `shared.pasting` puts new frames into the clip itself.
  """
  layout, unit, most = model.stats.layout, model.frames_per_latent, model.config.data.max_frames
  sources = [clip_of(clip, layout) for clip in clips]
  features = [clip.features if clip is not one and clip.features is not None else
              features_of(model, on_our_body(clip, model.fps, layout.skeleton)) for one, clip in zip(clips, sources)]
  frames = [len(x) // unit * unit for x in features]
  for count, x in zip(frames, features):
    if not unit <= count <= most:
      raise InputError(f"got a motion of {len(x)} frames at {model.fps:g} frames a second, expected {unit} to {most}; "
                       "cut a part out of it")
  flags = [new(count) for count in frames]
  if not all(one.any() for one in flags):
    raise InputError("everything is kept, so there is nothing to make; choose a span to change, or a shorter one to "
                     "keep")
  made, about = fill([x[:count] for x, count in zip(features, frames)], flags, prompts, keys, sampling)
  captions = [(Caption(prompt),) for prompt in prompts]
  motions = make_motions(model, made, frames, captions, seeds, about | dict(task=task), cleanup)
  latents = edited_latents(flags, most // unit, unit)
  runs = [[list(run) for run in runs_of(np.repeat(row, unit)[:count])] for row, count in zip(latents, frames)]
  return dataclasses.replace(motions, motions=tuple(
      motion.replace(id=clip.id, license=clip.license or model.license,
                     meta=motion.meta | dict(edited=clip.source or clip.id, made=made_runs))
      for motion, clip, made_runs in zip(motions, sources, runs)))


class EditingModel(TextToMotionModel):
  """A model that samples new frames of a clip. A method implements `inpainted`."""

  def inpainted(self, features: Sequence[Float[np.ndarray, "_ f"]], new: Sequence[Bool[np.ndarray, " _"]],
                prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any]
                ) -> tuple[Float[np.ndarray, "b t f"], dict[str, Any]]:
    """(normalized features (B, T, F), record of the sampling) of clips of features (T, F), not normalized, whose frames
    of new (T,) are sampled."""
    raise NotImplementedError(f"{type(self).__name__} has no `inpainted` (docs/adding.md)")

  def inpaint(self, features: Sequence[Float[np.ndarray, "_ f"]], new: Sequence[Bool[np.ndarray, " _"]],
              prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any]
              ) -> tuple[list[Float[np.ndarray, "_ f"]], dict[str, Any]]:
    """(features (T, F) of each motion, not normalized, record of the sampling): see `inpainted`."""
    made, about = self.inpainted(features, new, prompts, keys, sampling)
    return [self.stats.denormalize(x[:len(given)]) for x, given in zip(made, features)], about

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
    """The paper's editing: clips with the chosen frames sampled from their prompts, all frames as the networks give
    them, in one batch.

    clips: of any source, joints (T, J, 3), or features (T, F), not normalized. New are a task of `spans.TASKS`,
    or spans to keep or to change, [(0, 30), ...] in frames of this model, the same in every clip. meta["made"] lists
    the new frames. The motion stands where the model begins; `shared.pasting` puts new frames into the clip itself.
    """
    prompts = self.prompts_of(prompts) if prompts else []
    if len(prompts) != len(clips) or not clips:
      raise InputError(f"got {len(prompts)} prompts for {len(clips)} clips; give one for each")
    if sum(choice is not None for choice in (task, keep, change)) != 1:
      raise InputError("say what to make by one of task, keep and change")
    keys, seeds = keys_of(rng, seeds, len(clips), seed)
    return decoded_edits(self, self.inpainted, clips, prompts,
                         lambda count: pasting.requested_frames(count, task, keep, change), keys, seeds, cleanup,
                         sampling, task or "spans")
