"""Fine-tuning on the model's own scored samples (`diffusion.negative_aware`), as a stage.

A round samples groups of motions with `motion-jax data compose --group`, which scores them, then trains by this stage.
"""
from typing import Any

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.diffusion import negative_aware, paths
from motion_jax.models.cmdm import stages
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.nets.masks import block_causal_mask
from motion_jax.training.stage import Stage
from motion_jax.utils.errors import InputError

SAMPLER, REFERENCE = "sampler", "reference"  # frozen parameters: of the network that sampled, and of the first one


def scored_stage(config: ConfigDict) -> Stage:
  """Trains a denoiser on its own samples: batch as `stages.denoiser_stage`, and optimality (B,).

  frozen holds the parameters of the network that sampled and of the reference. config.scored has beta and the weight
  `pull` of the distance from the reference.
  """
  vae, choices = CausalVAE(**config.tokenizer), config.scored
  dit = stages.make_denoiser(config)
  if dit.predicts != "velocity":
    raise InputError(f"got a denoiser that predicts {dit.predicts!r}, expected 'velocity': only its loss is known")
  plain = stages.denoiser_stage(config)

  def loss(params: Any, frozen: Any, batch: Any, step: Any, rng: jax.Array) -> Any:
    z1, latent_mask, t, noise, text_emb = stages.forcing_inputs(config, vae, dit, frozen, batch, rng)
    attn_mask = block_causal_mask(z1.shape[1], dit.block) & latent_mask[:, None, None, :]
    x, left = paths.add_noise(z1, noise, t), stages.time_left_of(config, batch, rng)
    run: Any = lambda params: dit.apply(params, x, t, text_emb, attn_mask, batch["text_mask"], left=left)
    counts = latent_mask & (t < 1)
    losses = negative_aware.loss(run(params), run(frozen[SAMPLER]), run(frozen[REFERENCE]), x, z1, t, counts,
                                 batch["optimality"], choices.beta, pull=choices.pull)
    return {"loss": losses.sum()}, jnp.asarray(len(losses))

  return plain._replace(loss=loss, about_loss="the negative-aware loss of samples by their optimality, per sample")
