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
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.models.shared import round_trips
from motion_jax.models.shared.autoencoders import autoencoder_shapes
from motion_jax.models.shared.editing import LatentEditingModel
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
from motion_jax.runs import Run
from motion_jax.shapes import Bool, Float
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


class MomaskModel(LatentEditingModel):
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
    shapes = {TOKENIZER: autoencoder_shapes(tokenizer, config.quantizer)}
    if residual:
      shapes["residual"] = residual_shapes(residual)
    super().__init__(run, encoder, masked.text_dim, tokenizer.frames_per_latent, shapes, masked_shapes(masked))
    self.codec = RvqCodec(tokenizer, self.frozen[TOKENIZER])
    self._fill = cache.Program("momask.fill", partial(_fill, self.nets), 1, (self.nets,))
    self._encode = cache.Program("momask.encode", partial(_encode, tokenizer), 0, (tokenizer,))

  def encoded(self, features: Float[np.ndarray, "b t f"], real_mask: Bool[np.ndarray, "b l"]) -> Any:
    """Codes (B, L, Q) of padded features."""
    return self._encode(self.codec.params, features, real_mask)

  def filled(self, latents: Any, editable: Bool[np.ndarray, "b l"], real_mask: Bool[np.ndarray, "b l"],
             prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any], signal: ControlSignal | None = None
             ) -> tuple[Any, dict[str, Any]]:
    """(normalized features (B, T, F), record of the sampling); editable codes are sampled on all levels."""
    chosen = self.sampling(**sampling)
    if latents is None:
      latents = np.zeros((*editable.shape, self.config.quantizer.num_levels), np.int32)
    counts = masking.masked_counts(chosen.num_iterations, editable.sum(-1))
    plan = Plan(chosen.guidance_scale != 1, chosen.temperature, chosen.threshold, chosen.residual_scale != 1,
                chosen.residual_temperature)
    arrays = map(jnp.asarray, (latents, editable, real_mask, counts))
    features = self._fill(plan, self.params, self.frozen.get("residual", {}), self.codec.params, *arrays,
                          self.encoder(prompts)[0][:, 0], keys, jnp.float32(chosen.guidance_scale),
                          jnp.float32(chosen.residual_scale))
    return features, self.record_of(chosen)


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
