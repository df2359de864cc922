"""CDAMD ready to use: motion from prompts, and edits of existing motions."""
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.latents import AutoencoderCodec
from motion_jax.models import cdamd
from motion_jax.models.cdamd import draws, unmasking
from motion_jax.models.cdamd.guiding import Settling
from motion_jax.models.cdamd.options import CdamdSampling
from motion_jax.models.keys import keys_of
from motion_jax.models.results import (
  Motions,
  captions_in_a_row,
  cleanup_record,
  features_of,
  gathered,
)
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.models.shared import round_trips
from motion_jax.models.shared.batches import in_batches
from motion_jax.models.shared.editing import LatentEditingModel
from motion_jax.models.shared.pasting import Spans
from motion_jax.motion import step_records
from motion_jax.motion.blending import join, laid_over
from motion_jax.motion.cleanup import clean_up
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.diffusion_mlp import Generator
from motion_jax.runs import Run
from motion_jax.shapes import Array, Bool, Float
from motion_jax.text.encoder import TextEncoder
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields
from motion_jax.utils.numerals import checked

WINDOW = 4  # positions of a latent-by-latent decoding iteration that the transformer computes; others are cached
CONTROL_STEPS = 4  # Gauss-Newton steps of guidance by constraints
_PAST = 8  # frames of the past that a further segment is conditioned on; with more, a second squat may be left out


class CdamdModel(LatentEditingModel):
  """CDAMD or MARDM ready to use: prompts in, motion out; a motion in, the same one with new frames out.

  In addition to the choices of `CdamdSampling`, motions guided by constraints take control_steps and refinements, which
  together are the Gauss-Newton steps on the finished latents.
  """
  abilities = ("generate", "sample_segments", "edit")
  options = CdamdSampling
  more_choices = ("control_steps", "refinements")
  takes_control = True

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    config = run.config
    checkpoint.demand(config, run.folder, data__max_frames=(1, 100_000), sampler__guidance_scale=(-1e3, 1e3))
    self.autoencoder = Autoencoder(**module_fields(config.tokenizer))
    self.net = cdamd.make_generator(config.model)
    super().__init__(run, encoder, self.net.transformer.text_dim, self.autoencoder.frames_per_latent,
                     cache.kept_shapes("cdamd.frozen", self.autoencoder, lambda: cdamd.frozen_shapes(self.autoencoder)),
                     cache.kept_shapes("cdamd.generator", self.net, lambda: cdamd.generator_shapes(self.net)))
    self.codec = AutoencoderCodec.of(self.autoencoder, self.frozen)
    self.programs = Programs(self.net)

  @property
  def edit_mask(self) -> str:
    """The mask of edits: what the run was trained with, of several ("dccm+bcm") the last."""
    return self.config.loss.mask.split("+")[-1]

  def encoded(self, features: Float[np.ndarray, "b t f"], real_mask: Bool[np.ndarray, "b l"]) -> np.ndarray:
    """Latents (B, L, C) of padded features."""
    return in_batches(self.programs.encode, features, real_mask, shared=(self.codec,))

  def filled(self, latents: Any, editable: Bool[np.ndarray, "b l"], real_mask: Bool[np.ndarray, "b l"],
             prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any], signal: ControlSignal | None = None
             ) -> tuple[np.ndarray, dict[str, Any]]:
    """(normalized features (B, T, F), record of the sampling), with the editable latents sampled.

    signal (B, longest): finished latents of a new motion are pulled towards it through the decoder
    (`models.cdamd.guiding`). With a solver of fixed steps a motion does not depend on others in its batch.
    """
    sampling, steps = dict(sampling), 0
    if latents is None:
      steps = sum(checked(sampling.pop(name, usual), 0, 100, name) for name, usual in (
          ("control_steps", CONTROL_STEPS), ("refinements", 0)))
      latents = np.zeros(real_mask.shape + (self.net.transformer.latent_dim,), np.float32)
    rows, record = self._latents(latents, editable, real_mask, prompts, keys, sampling)
    if signal is not None and steps:
      signal = signal.slice_frames(0, self.max_latents * self.frames_per_latent)
      record = record | dict(control_steps=steps)
      rows = in_batches(self.programs.settle, rows, real_mask, signal,
                        shared=(self.codec, Settling.of(self.stats, steps)))
    return in_batches(self.programs.decode, rows, real_mask, shared=(self.codec,)), record

  def sample_segments(self, lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array, seeds: Sequence[int | None],
                      cleanup: bool, sampling: dict[str, Any]) -> Motions:
    """A motion of each list of (prompt, frames), a key each: the first segment is sampled from its prompt alone, each
    further one by inpainting after the last 0.4 s of the motion so far."""
    first = self.sample([row[0][0] for row in lists], [row[0][1] for row in lists], keys, seeds, False, sampling)
    return gathered([self._continued(motion, row[1:], key, cleanup, sampling)
                     for motion, row, key in zip(first, lists, keys)])

  def _continued(self, motion, segments, key, cleanup, sampling):
    """The motion followed by each of segments [(prompt, frames)]."""
    joints, layout = motion.joints, self.stats.layout
    prompts, ends = [motion.captions[0].text], [motion.num_frames]
    for i, (prompt, frames) in enumerate(segments):
      end = ends[-1] + max(frames // self.frames_per_latent, 1) * self.frames_per_latent
      while len(joints) < end:
        past = joints[-_PAST:]
        past = past[len(past) % self.frames_per_latent:]
        count = min(end - len(joints), self.max_latents * self.frames_per_latent - len(past))
        given = features_of(self, np.concatenate([past, np.repeat(past[-1:], count, axis=0)]))
        new = np.arange(len(given)) >= len(past)
        rng = jax.random.fold_in(jax.random.fold_in(key, i + 1), len(joints))
        sampled, _ = self.inpaint([given], [new], [prompt], keys_of(rng, None, 1)[0], sampling)
        known, shown = (np.array(layout.to_joints(x)) for x in (given, sampled[0]))
        new_joints = join(shown, known, ~new)
        joints = np.concatenate([joints, laid_over(new_joints.astype(np.float64), past, len(past))]).astype(np.float32)
      prompts.append(prompt)
      ends.append(len(joints))
    steps = [step_records.record("sample", f"{len(prompts)} prompts in sequence")]
    if cleanup and layout.has_fixed_bones:
      before, joints = joints, clean_up(joints, skeleton=layout.skeleton, smoothing=self.smoothing)
      steps.append(cleanup_record(before, joints, layout.skeleton))
    return motion.replace(joints=joints, features=features_of(self, joints), meta=motion.meta | dict(
        cleanup=bool(cleanup), steps=steps), captions=captions_in_a_row(prompts, ends, self.fps))

  def new_frames(self, num_frames: int, task: str | None, keep: Spans | None, change: Spans | None
                 ) -> Bool[np.ndarray, " {num_frames}"]:
    """(num_frames,): the frames that an edit samples; tasks are divided by latents, as in the reference."""
    if task is None:
      return super().new_frames(num_frames, task, keep, change)
    unit = self.frames_per_latent
    return np.repeat(masking.task_mask(task, [num_frames], num_frames // unit, unit)[0], unit)

  def inpainted(self, features: Sequence[Float[np.ndarray, "_ f"]], new: Sequence[Bool[np.ndarray, " _"]],
                prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any]
                ) -> tuple[Float[np.ndarray, "b t f"], dict[str, Any]]:
    """As of any such model. Choice mask: by default the one that the run was trained with."""
    return super().inpainted(features, new, prompts, keys, sampling | dict(mask=sampling.get("mask") or self.edit_mask))

  def encode_words(self, prompts: Sequence[str]) -> tuple[Array, Array | None]:
    """(text_emb, text_mask or None) as the model was trained: sentence vectors, or these and their words."""
    if self.encoder.level == "sentence":
      return self.encoder(prompts)[0], None
    return self.encoder.sentence_and_words(prompts, at_least=min(self.config.data.max_words, self.encoder.max_words))

  def _latents(self, latents, editable, real, prompts, keys, sampling):
    """(latents (B, L, C) with those sampled that are editable (B, L), record of the sampling)."""
    chosen = self.sampling(**sampling)
    text_emb, text_mask = self.encode_words(prompts)
    order = draws.draw_order(keys, np.full(len(keys), self.max_latents), self.max_latents, chosen.order)
    masked = masking.masked_table(np.where(editable, order, np.inf),
                                  masking.masked_counts(chosen.num_iterations, editable.sum(-1)))
    schedule = unmasking.schedule(masked, chosen.unmasked_only)
    most = unmasking.most_unmasked(masking.masked_counts(chosen.num_iterations, np.array([self.max_latents])))
    # Few values, as each compiles a program: one row at a time where an iteration seldom unmasks two, else as many as
    # it unmasks of the longest motion; a window of 4 positions where that is enough.
    num_rows = (1 if most <= 2 else min(2 * -(-most // 2), self.max_latents)) if chosen.unmasked_only else None
    window = min(WINDOW, self.max_latents)
    small = num_rows == 1 and chosen.mask == "causal" and unmasking.span(np.asarray(schedule.made_at)) <= window
    plan, steps = cdamd.make_plan(
        solver=chosen.solver, num_steps=chosen.num_steps, mask=chosen.mask, guided=chosen.guidance_scale != 1.0,
        num_rows=num_rows, ddpm_steps=self.config.loss.ddpm_steps, temperature=chosen.temperature,
        shared_noise=chosen.shared_noise, window=window if small else None).split()

    def run(latents, real, text_emb, text_mask, made_at, drawn_at, keys, params, *shared):
      return self.programs.latents(plan, params, latents, real, text_emb, text_mask,
                                   unmasking.Schedule(made_at, drawn_at, schedule.num_iterations), keys, *shared)

    filled = in_batches(run, latents, real, text_emb, text_mask, schedule.made_at, schedule.drawn_at, keys,
                        shared=(self.params, np.float32(chosen.guidance_scale), steps))
    return filled, self.record_of(chosen)


MODELS = {"cdamd.generator": CdamdModel}
TOKENIZERS = dict.fromkeys(("cdamd.autoencoder", "cdamd.generator"), round_trips.autoencoder) | {
    "cdamd.rvq": round_trips.rvq}


class Programs:
  """The compiled functions of a model, each compiled once for motions of any length, number and kind."""

  def __init__(self, net: Generator) -> None:
    def latents(plan, params, latents, real_mask, text_emb, text_mask, schedule, keys, scale, steps):
      draw = draws.make_draw(keys, net.transformer.latent_dim, plan.shared_noise)
      return cdamd.make_latents(net, plan, params, latents, text_emb=text_emb, text_mask=text_mask, schedule=schedule,
                                real_mask=real_mask, scale=scale, draw=draw, steps=steps)

    self.latents = cache.Program("cdamd.latents", latents, 1, (net,))
    self.encode = cache.Program("cdamd.encode", lambda features, real_mask, codec: codec.encode(features, real_mask))
    self.decode = cache.Program("cdamd.decode", lambda latents, real_mask, codec: codec.decode(latents, real_mask))
    self.settle = cache.Program("cdamd.settle", lambda latents, real_mask, signal, codec, settling: settling.settle(
        codec, latents, real_mask, signal))
