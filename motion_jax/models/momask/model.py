"""MoMask ready to use: motion from prompts, and edits of existing motions."""
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.latents import TOKENIZER, RvqCodec
from motion_jax.models.momask import sampling as sampler
from motion_jax.models.momask.options import MomaskSampling
from motion_jax.models.momask.stages import masked_shapes, residual_shapes
from motion_jax.models.results import Motions, motions_of_prompts
from motion_jax.models.shared import length as lengths
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.models.shared import round_trips
from motion_jax.models.shared.autoencoders import autoencoder_shapes
from motion_jax.models.shared.editing import EditingModel, edited_latents, padded_features
from motion_jax.motion.representations import get_layout
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
from motion_jax.runs import Run
from motion_jax.text.captions import of_a_person
from motion_jax.text.encoder import TextEncoder
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields


class Nets(NamedTuple):
  """The modules that make motion; residual None: the codes of level 0 are all."""
  tokenizer: Autoencoder
  masked: MaskedCodeTransformer
  residual: ResidualCodeTransformer | None


class Plan(NamedTuple):
  """The choices that a program depends on; hashable."""
  guided: bool = True
  temperature: float = 1.0
  threshold: float = 0.9
  residual_guided: bool = True
  residual_temperature: float = 1.0


class MomaskModel(EditingModel):
  """MoMask ready to use: prompts in, motion out; a motion in, the same one with new frames out."""
  abilities = ("generate", "edit")
  options = MomaskSampling

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    config = run.config
    checkpoint.demand(config, run.folder, data__max_frames=(1, 100_000), sampler__guidance_scale=(-1e3, 1e3))
    tokenizer = Autoencoder(**module_fields(config.tokenizer))
    masked = MaskedCodeTransformer(**module_fields(config.model))
    residual = ResidualCodeTransformer(**module_fields(config.residual)) if config.residual else None
    self.nets = Nets(tokenizer, masked, residual)
    self.length = LengthEstimator(**module_fields(config.length)) if config.length else None
    self.max_seconds = config.data.max_frames / get_layout(config.data.layout).skeleton.fps
    shapes = {TOKENIZER: autoencoder_shapes(tokenizer, config.quantizer)}
    if residual:
      shapes["residual"] = residual_shapes(residual)
    if self.length:
      shapes["length"] = lengths.length_shapes(self.length, masked.text_dim)
    super().__init__(run, encoder, masked.text_dim, tokenizer.frames_per_latent, shapes, masked_shapes(masked))
    self.codec = RvqCodec(tokenizer, self.frozen[TOKENIZER])
    # All motions are padded to the training length and compiled once.
    self.max_latents = config.data.max_frames // self.frames_per_latent
    self._fill = cache.Program("momask.fill", partial(_fill, self.nets), 1, (self.nets,))
    self._encode = cache.Program("momask.encode", partial(_encode, tokenizer), 0, (tokenizer,))

  def estimated_frames(self, prompt: str) -> int | None:
    """The median length by the length estimator, at most that of training; None for a run without one."""
    if self.length is None:
      return None
    logits: Any = self.length.apply(self.frozen["length"], self.encoder([of_a_person(prompt)])[0][:, 0])
    return min(int(lengths.middle_frames(logits, self.frames_per_latent)[0]), self.config.data.max_frames)

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: ControlSignal | None = None) -> Motions:
    """One pass of the networks: motions of prompts, a key each. Lengths are cut to whole codes (4 frames)."""
    unit = self.frames_per_latent
    frames = [count // unit * unit for count in frames]
    every = np.arange(self.max_latents) < np.array(frames)[:, None] // unit
    nothing = np.zeros((len(prompts), self.max_latents, self.config.quantizer.num_levels), np.int32)
    generated, about = self._sampled(nothing, every, every, prompts, keys, sampling)
    return motions_of_prompts(self, generated, prompts, frames, seeds, about, cleanup)

  def inpainted(self, features: Sequence[np.ndarray], new: Sequence[np.ndarray], prompts: Sequence[str],
                keys: jax.Array, sampling: dict[str, Any]) -> tuple[np.ndarray, dict[str, Any]]:
    """The paper's temporal inpainting: codes with any new frame are sampled on all levels, and all are decoded. Returns
    (normalized features (B, T, F), record of the sampling)."""
    unit = self.frames_per_latent
    edited = edited_latents(new, self.max_latents, unit)
    real = np.asarray(padding_mask(jnp.array([-(-len(x) // unit) for x in features]), self.max_latents))
    codes = self._encode(self.codec.params, padded_features(self, features, self.max_latents * unit), real)
    sampled, about = self._sampled(codes, edited, real, prompts, keys, sampling)
    return np.asarray(sampled), about

  def _sampled(self, codes, editable, real, prompts, keys, sampling):
    """(normalized features (B, T, F), record of the sampling)."""
    chosen = self.sampling(**sampling)
    counts = masking.masked_counts(chosen.num_iterations, editable.sum(-1))
    plan = Plan(chosen.guidance_scale != 1, chosen.temperature, chosen.threshold, chosen.residual_scale != 1,
                chosen.residual_temperature)
    filled = self._fill(plan, self.params, self.frozen.get("residual", {}), self.codec.params, jnp.asarray(codes),
                        jnp.asarray(editable), jnp.asarray(real), jnp.asarray(counts), self.encoder(prompts)[0][:, 0],
                        keys, jnp.float32(chosen.guidance_scale), jnp.float32(chosen.residual_scale))
    return filled, chosen.about() | dict(model=self.id)


MODELS = {"momask.masked": MomaskModel}
TOKENIZERS = dict.fromkeys(("momask.rvq", "momask.masked"), round_trips.rvq)


def _encode(net, params, features, real):
  """Codes (B, L, Q) of clips that end where their padding begins."""
  return RvqCodec(net.clone(hide_padding=True), params).encode(features, jnp.repeat(real, net.frames_per_latent, 1))[0]


def _fill(nets, plan, params, residual, codec, codes, editable, real, counts, text_emb, keys, scale, residual_scale):
  """Normalized features (B, 4 L, F) of codes (B, L, Q) of which the editable ones are sampled."""
  length = real.shape[1]
  choose = sampler.chooser(sampler.noise_of(keys, length, nets.masked.num_codes, 0), plan.temperature, plan.threshold)
  base = sampler.decode_masked(nets.masked, params, codes[..., 0], editable, real, counts, text_emb,
                               scale if plan.guided else None, choose).codes[-1]
  every: Any = jnp.where(real, base, -1)[..., None]
  if nets.residual is not None:
    choose = sampler.chooser(sampler.noise_of(keys, length, nets.residual.num_codes + 1, 1), plan.residual_temperature,
                             plan.threshold)
    every, _ = sampler.add_levels(nets.residual, residual, base, real, text_emb,
                                  residual_scale if plan.residual_guided else None, choose)
    # Parity: the reference draws the residual levels of kept codes again, too.
    kept = (real & ~editable)[..., None] & (jnp.arange(every.shape[-1]) > 0)
    every = jnp.where(kept, codes[..., :every.shape[-1]], every)
  # Parity: the reference decodes padding as zero vectors; here a clip ends where its padding begins.
  return RvqCodec(nets.tokenizer.clone(hide_padding=True), codec).decode(every, every.shape[-1], real)
