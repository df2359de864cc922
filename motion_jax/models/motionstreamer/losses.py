"""Losses of MotionStreamer: of its causal autoencoder, and of its generator's two forward passes.

Source: docs/papers/motionstreamer.md#autoencoder, #two-forward.
"""
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from motion_jax.diffusion import ddpm
from motion_jax.models.shared.likelihoods import ALONE, Sharing, gaussian_nll, kl_to_standard_normal
from motion_jax.shapes import Array, Bool, Float, Int, Net, Whole


def autoencoder_terms(vae: Net, params: Any, x: Float[Array, "b t f"], noise: Float[Array, "b n c"],
                      weights: Mapping[str, float], root_columns: slice, shared: Sharing = ALONE) -> dict[str, Array]:
  """Terms of one micro-batch x (B, T, F): "rec" and "root", Gaussian likelihoods summed over everything, each with a
  sigma of its own, "kl", and their weighted sum "loss"."""
  y, mean, logvar = vae.apply(params, x, noise)
  terms = {"rec": gaussian_nll(y, x, shared), "root": gaussian_nll(y[..., root_columns], x[..., root_columns], shared),
           "kl": kl_to_standard_normal(mean, logvar) * shared.share}
  terms["loss"] = terms["rec"] + weights["kl"] * terms["kl"] + weights["root"] * terms["root"]
  return terms


def num_replaced(step: Any, total: int, length: Whole) -> Int[Array, "..."]:
  """How many of `length` latents are replaced by the network's own at a step: none at first, all from step total on."""
  done = jnp.minimum(jnp.asarray(step) / total, 1.0)
  return jnp.floor(length * (1 - (1 + jnp.cos(math.pi * done)) / 2)).astype(int)


class Draws(NamedTuple):
  """Random numbers of a step for B motions of L latents: the steps and the noise of both passes.

  own_t (B, L), own_noise (B, L, C): of the first pass, whose clean latents replace some of the true ones. t (M, B, L),
  noise (M, B, L, C): of the second one, M times for each latent.
  """
  own_t: Int[Array, "b l"]
  own_noise: Float[Array, "b l c"]
  t: Int[Array, "m b l"]
  noise: Float[Array, "m b l c"]


def two_forward_loss(net: Net, params: Any, schedule: ddpm.Schedule, text_emb: Float[Array, "b e"],
                     latents: Float[Array, "b l c"], trained_mask: Bool[Array, "b l"], replaced: Bool[Array, "#b l"],
                     draws: Draws) -> tuple[dict[str, Float[Array, ""]], Float[Array, ""]]:
  """(sums, weight): the squared error of the noise of every trained latent, M times over.

  replaced: which latents the second pass reads as the first one made them, without a gradient. Position i is
  conditioned on the caption and the i latents before it.
  """
  conditions = lambda params, latents: net.apply(params, text_emb, latents, method="condition")[:, :-1]
  predict = lambda params, x, t, condition: net.apply(params, x, t, condition, method="predict")
  noisy = ddpm.add_noise(schedule, latents, draws.own_noise, draws.own_t)
  # Parity: as released, the clean latents of a noise prediction are not clipped; those of the last steps are far off.
  first_pass = ddpm.x1_of_noise(schedule, noisy, predict(params, noisy, draws.own_t, conditions(params, latents)),
                                draws.own_t)
  mixed = jnp.where(replaced[..., None], jax.lax.stop_gradient(first_pass), latents)
  condition = conditions(params, mixed)
  target = jnp.broadcast_to(latents, draws.noise.shape)
  same = lambda t: jnp.broadcast_to(condition, (*t.shape, condition.shape[-1]))
  rows = ddpm.loss_rows(lambda x, t: predict(params, x, t, same(t)), schedule, target, draws.t, draws.noise)
  total = jnp.where(trained_mask, rows, 0.0).sum()
  return {"loss": total}, jnp.maximum(trained_mask.sum() * len(draws.t), 1)
