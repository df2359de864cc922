"""MLD ready to use: motion from prompts, and motions through its VAE and back."""
from collections.abc import Sequence
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.models.base import TextToMotionModel
from motion_jax.models.mld import sampling
from motion_jax.models.mld.options import MldSampling
from motion_jax.models.mld.stages import VAE, denoiser_shapes, frozen_shapes, reconstruct, vae_shapes
from motion_jax.models.shared.captioned_batches import NO_CAPTION
from motion_jax.models.shared.round_trips import RoundTrip
from motion_jax.nets.causal_vae import sample_latent
from motion_jax.nets.latent_diffusion import TokenDenoiser, TokenVAE
from motion_jax.nets.masks import padding_mask
from motion_jax.runs import Run
from motion_jax.shapes import Array, Float, Num
from motion_jax.text.encoder import TextEncoder
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields
from motion_jax.utils.errors import InputError


class MldModel(TextToMotionModel):
  """MLD ready to use. One latent is a whole motion, so nothing of a motion is edited or streamed."""
  abilities: tuple[str, ...] = ("generate", "reconstruct")
  options = MldSampling
  has_vae = True

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    config = run.config
    checkpoint.demand(config, run.folder, data__max_frames=(1, 100_000), diffusion__num_steps=(1, 100_000),
                      sampler__guidance_scale=(-1e3, 1e3))
    self.vae: Any = TokenVAE(**module_fields(config.tokenizer)) if self.has_vae else None
    self.net = TokenDenoiser(**module_fields(config.model))
    sizes, num_tokens = (self.vae, self.net.text_dim), self.vae.num_tokens if self.vae else 1
    super().__init__(run, encoder, self.net.text_dim, 1,
                     cache.kept_shapes("mld.frozen", sizes, lambda: frozen_shapes(*sizes)),
                     cache.kept_shapes("mld.denoiser", (self.net, num_tokens),
                                       lambda: denoiser_shapes(self.net, num_tokens)))
    self.max_seconds = config.data.max_frames / self.stats.layout.fps
    self._generate = cache.Program("mld.generate", partial(_generate, self.net, self.vae), 1, (self.net, self.vae))

  def plan_of(self, chosen: MldSampling) -> sampling.Plan:
    return sampling.Plan(self.config.diffusion.num_steps, cast(int, chosen.num_steps), cast(str, chosen.solver),
                         self.config.diffusion.predicts, chosen.guidance_scale != 1.0)

  def sampled_features(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, chosen: MldSampling
                       ) -> tuple[Any, Sequence[int]]:
    """(normalized features (B, max_frames, F), frames as given) of prompts."""
    real = padding_mask(jnp.asarray(frames), self.config.data.max_frames)  # one length for all, compiled once
    return self._generate(self.plan_of(chosen), self.params, self.frozen.get(VAE), self.encoder(prompts)[0],
                          self.frozen[NO_CAPTION], real, chosen.guidance_scale, keys), frames

  def reconstruct(self, features: Num[Array, "t f"]) -> Float[np.ndarray, "t f"]:
    """Features (T, F) through the VAE and back, by the mean of their latent."""
    if len(features) > self.vae.max_length - 2 * self.vae.num_tokens:
      raise InputError(f"got a motion of {len(features)} frames, MLD's VAE has positions for "
                       f"{self.vae.max_length - 2 * self.vae.num_tokens}; cut a part out of it")
    x = jnp.asarray(self.stats.normalize(np.asarray(features))[None])
    rebuilt = reconstruct(self.vae, self.frozen[VAE], x, jnp.ones(x.shape[:2], bool))
    return self.stats.denormalize(np.asarray(rebuilt))[0]


class MldFramesModel(MldModel):
  """The variant without a VAE: the denoiser's frames are the motion."""
  abilities = ("generate",)
  has_vae = False


def round_trip(fields: dict[str, Any], config: Any) -> RoundTrip:
  """Of the VAE with these fields."""
  vae = TokenVAE(**fields)

  def run(params, x, num_frames, keys):
    real = padding_mask(num_frames, x.shape[1])
    z, logvar = cast(Any, vae.apply)(params, x, real, method="encode")
    if keys is not None:  # Parity: the released evaluation draws latents.
      z = sample_latent(z, logvar, jax.vmap(lambda key: jax.random.normal(key, z.shape[1:]))(keys))
    return vae.apply(params, z, real, method="decode")
  return RoundTrip(vae_shapes(vae), run)


def _generate(net, vae, plan, params, vae_params, text_emb, no_text_emb, real, scale, keys):
  shape = (vae.num_tokens, vae.latent_dim) if vae else (real.shape[1], net.features)
  draw = lambda m: jax.vmap(lambda key: jax.random.normal(jax.random.fold_in(key, m), shape))(keys)
  text_emb = jnp.asarray(text_emb)
  without = jnp.broadcast_to(no_text_emb[None], text_emb.shape)
  if vae is None:  # padding is hidden: the reference samples motions one by one, without any
    return sampling.denoise(sampling.FrameDenoiser(net, real), plan, params, text_emb, without, scale, draw)
  z = sampling.denoise(net, plan, params, text_emb, without, scale, draw)
  return vae.apply(vae_params, z, real, method="decode")


MODELS = {"mld.denoiser": MldModel, "mld.frames": MldFramesModel}
TOKENIZERS = dict.fromkeys(("mld.vae", "mld.denoiser"), round_trip)
