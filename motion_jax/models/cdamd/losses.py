"""Losses of CDAMD: of its autoencoder, its RVQ-VAE, and the diffusion loss of masked latents."""
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int
from ml_collections import ConfigDict

from motion_jax import shapes
from motion_jax.diffusion import ddpm, paths
from motion_jax.models.cdamd import mask_schedule as masking
from motion_jax.models.cdamd.draws import Draws
from motion_jax.nets.masks import latent_mask
from motion_jax.shapes import Array, Net


def smooth_l1(prediction: Float[Array, "b t f"], target: Float[Array, "b t f"]) -> Float[Array, ""]:
  """Mean of d^2 / 2 where the difference d is below 1, of |d| - 1/2 elsewhere."""
  shapes.check(prediction=(prediction, "BTF"), target=(target, "BTF"))
  import optax  # only training needs it
  return optax.huber_loss(prediction, target).mean()


def l1(prediction: Float[Array, "b t f"], target: Float[Array, "b t f"]) -> Float[Array, ""]:
  shapes.check(prediction=(prediction, "BTF"), target=(target, "BTF"))
  return jnp.abs(prediction - target).mean()


DISTANCES = {"smooth_l1": smooth_l1, "l1": l1}


def autoencoder_terms(y: Float[Array, "b t f"], x: Float[Array, "b t f"], distance: str = "smooth_l1",
                      position_weight: float = 1.0, columns: Sequence[int] = (4, 67)) -> dict[str, Array]:
  """Loss terms of features x (B, T, F) and their reconstruction y: rec, positions, and their weighted sum, loss."""
  # Parity: the paper says L1. The columns that count twice are the joint positions of 67 columns (22 joints; 4:64 for
  # 21); of coordinates the code takes the same columns, all but the first four numbers.
  measure, part = DISTANCES[distance], slice(*columns)
  y = y.astype(x.dtype)
  terms = {"rec": measure(y, x), "positions": measure(y[..., part], x[..., part]), "mse": ((y - x) ** 2).mean()}
  terms["loss"] = terms["rec"] + position_weight * terms["positions"]
  return terms


def rvq_terms(y: Float[Array, "b t f"], x: Float[Array, "b t f"], commitment: Any, velocity_weight: float = 0.1,
              commitment_weight: float = 0.02, position_weight: float = 0.1, **reconstruction: Any) -> dict[str, Array]:
  """The same for the RVQ-VAE, with the error of frame differences and the distance of latents to their codes."""
  # Parity: the paper's eq. (10) has a codebook loss, which `rvq.learn` gives; the code moves the codebooks by running
  # means instead.
  terms = autoencoder_terms(y, x, position_weight=position_weight, **reconstruction)
  terms["velocity"] = ((jnp.diff(y.astype(x.dtype), axis=1) - jnp.diff(x, axis=1)) ** 2).mean()
  terms["commitment"] = commitment
  terms["loss"] += velocity_weight * terms["velocity"] + commitment_weight * commitment
  return terms


def trained_mask(kinds: str, known_mask: Bool[Array, "b l"], real_mask: Bool[Array, "b l"],
                 mask_u: Float[Array, " b"] | None = None) -> Bool[Array, "b 1 #l l"]:
  """The mask (B, 1, L, L) of a training step; of several kinds, "dccm+bcm", each item draws one, mask_u (B,).

  A model that was trained on several can be asked by any of them (one for generation, one for editing).
  """
  masks = jnp.stack([latent_mask(kind, known_mask, real_mask) for kind in kinds.split("+")])
  if len(masks) == 1:
    return masks[0]
  chosen = jnp.floor(jnp.asarray(mask_u) * len(masks)).astype(int)
  return jnp.take_along_axis(masks, chosen[None, :, None, None, None], axis=0)[0]


def generator_loss(net: Net, params: Any, z1: Float[Array, "b l c"], real_mask: Bool[Array, "b l"],
                   text_emb: Float[Array, "b s e"], codes: Int[Array, "b l *q"] | None, draws: Draws,
                   config: ConfigDict, dropout_keys: jax.Array | None = None,
                   text_mask: Bool[Array, "b s"] | None = None) -> tuple[dict[str, Array], Array]:
  """(sums, weight) of one step: the diffusion loss of every masked latent, M times over.

  Source: docs/papers/cdamd.md#training-step, #diffusion-mlp.

  z1 (B, L, C) clean latents, 0 at padding; codes (B, L) or (B, L, Q) of the prior, or None. dropout_keys (B,): trains
  with dropout. All rows are computed and the masked ones summed, so that shapes do not depend on the draw.
  """
  made = masking.corruption(draws.time_u, draws.order_u, draws.noise_u, draws.keep_u, real_mask, config.noise_rate,
                            config.mask_rate, config.mask_draw)
  x = masking.corrupt(z1, made, draws.noise, net.apply(params, method="hidden"), real_mask)
  text_emb = jnp.where((draws.text_u < config.drop_rate)[:, None, None], 0.0, text_emb)
  attn_mask = trained_mask(config.mask, real_mask & ~made.masked, real_mask, draws.mask_u)
  prior_mask = None if codes is None else draws.prior_u >= config.prior_drop_rate
  inputs = (x, text_emb, attn_mask, codes, prior_mask, text_mask)
  if dropout_keys is None:
    condition = net.apply(params, *inputs, method="condition")
  else:
    of_item = lambda key, *item: net.apply(params, *jax.tree.map(lambda a: a[None], item), deterministic=False,
                                           method="condition", rngs={"dropout": key})[0]
    condition = jax.vmap(of_item)(dropout_keys, *inputs)
  predict = lambda x, t: net.apply(params, x, t, jnp.broadcast_to(condition, x.shape[:-1] + condition.shape[-1:]),
                                   method="predict")
  if config.diffusion == "ddpm":
    schedule = ddpm.cosine_schedule(config.ddpm_steps)
    error = ddpm.loss_rows(predict, schedule, jnp.broadcast_to(z1, draws.diffusion_noise.shape), draws.t,
                           draws.diffusion_noise)
  else:
    velocity = predict(paths.add_noise(z1, draws.diffusion_noise, draws.t), draws.t)
    error = ((velocity - (z1 - draws.diffusion_noise)) ** 2).mean(-1)
  total = jnp.where(made.masked, error.astype(jnp.promote_types(error.dtype, jnp.float32)), 0.0).sum()
  # A batch of short clips may have nothing masked at all.
  return {"loss": total}, jnp.maximum(made.masked.sum() * len(draws.t), jnp.finfo(total.dtype).tiny)
