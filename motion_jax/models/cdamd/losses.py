"""The loss of CDAMD's generator: the diffusion loss of masked latents."""
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.diffusion import ddpm, paths
from motion_jax.models.cdamd.draws import Draws
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.nets.masks import latent_mask
from motion_jax.shapes import Array, Bool, Float, Int, Net


def trained_mask(kinds: str, known_mask: Bool[Array, "b l"], real_mask: Bool[Array, "b l"],
                 mask_u: Float[Array, " b"] | None = None) -> Bool[Array, "b 1 #l l"]:
  """The mask (B, 1, L, L) of a training step; of several kinds, "dccm+bcm", each item draws one, mask_u (B,).

  A model that was trained on several can be used with any of them (one for generation, one for editing).
  """
  masks = jnp.stack([latent_mask(kind, known_mask, real_mask) for kind in kinds.split("+")])
  if len(masks) == 1:
    return masks[0]
  chosen = jnp.floor(jnp.asarray(mask_u) * len(masks)).astype(int)
  return jnp.take_along_axis(masks, chosen[None, :, None, None, None], axis=0)[0]


MOST_PARTS, LEAST_ROWS = 8, 512


def sum_of_masked(error: Callable, params: Any, condition: Float[Array, "b l h"], masked: Bool[Array, "b l"],
                  z1: Float[Array, "b l c"], copied: tuple[Array, ...]) -> Float[Array, ""]:
  """Sum of error(params, condition, z1, *copied) over the masked ones of (B, L) latents, without most of the work for
  the others.

  copied: arrays (M, B, L, ...), which have no gradient, nor has z1. error is given P latents in the place of (B, L) and
  gives numbers (..., P). Shapes do not depend on what is masked: latents are sorted, masked ones first, and cut into
  equal parts of at least LEAST_ROWS rows, of which a loop takes those that have a masked latent. It adds up values and
  gradients together, so no activation outlives its part.
  """
  count = masked.size
  num_parts = min(max(count * len(copied[0]) // LEAST_ROWS, 1), MOST_PARTS)
  if num_parts == 1:
    return jnp.where(masked, error(params, condition, z1, *copied), 0.0).sum()
  size = -(-count // num_parts)
  z1 = z1.reshape(count, -1)
  copied = tuple(a.reshape(a.shape[:1] + (count,) + a.shape[3:]) for a in copied)
  order = jnp.argsort(~masked.reshape(count))
  order = jnp.pad(order, (0, num_parts * size - count), mode="edge")
  here = jnp.arange(num_parts * size) < masked.sum()
  needed = (masked.sum() + size - 1) // size

  def part(i):
    """-> (places (P,), the sum over them of a function of params and of their conditions)."""
    cut = lambda a: jax.lax.dynamic_slice_in_dim(a, i * size, size)
    places = cut(order)
    rows = z1[places], *(a[:, places] for a in copied)
    return places, lambda params, condition: jnp.where(cut(here), error(params, condition, *rows), 0.0).sum()

  @jax.custom_vjp
  def total(params, condition):
    def add(i, value):
      places, of_part = part(i)
      return value + of_part(params, condition[places])

    return jax.lax.fori_loop(0, needed, add, jnp.zeros((), jnp.promote_types(condition.dtype, jnp.float32)))

  def forward(params, condition):
    def add(i, sums):
      value, of_params, of_condition = sums
      places, of_part = part(i)
      more, (more_params, more_condition) = jax.value_and_grad(of_part, (0, 1))(params, condition[places])
      return value + more, jax.tree.map(jnp.add, of_params, more_params), of_condition.at[places].add(more_condition)

    nothing = jax.tree.map(jnp.zeros_like, (params, condition))
    value, *grads = jax.lax.fori_loop(
        0, needed, add, (jnp.zeros((), jnp.promote_types(condition.dtype, jnp.float32)), *nothing))
    return value, tuple(grads)

  total.defvjp(forward, lambda grads, seed: jax.tree.map(lambda grad: (grad * seed).astype(grad.dtype), grads))
  return total(params, condition.reshape(count, -1))


def generator_loss(net: Net, params: Any, z1: Float[Array, "b l c"], real_mask: Bool[Array, "b l"],
                   text_emb: Float[Array, "b s e"], codes: Int[Array, "b l *q"] | None, draws: Draws,
                   config: ConfigDict, dropout: tuple[Array, Array] | None = None,
                   text_mask: Bool[Array, "b s"] | None = None, false: tuple[Array, Any, Array] | None = None
                   ) -> tuple[dict[str, Array], Array]:
  """(sums, weight) of one step: the diffusion loss of every masked latent, M times over.

  Source: docs/papers/cdamd.md#training-step, #diffusion-mlp.

  z1 (B, L, C) clean latents, 0 at padding; codes (B, L) or (B, L, Q) of the prior, or None. dropout: (a key, the
  items' places (B,) in the whole batch) to train with it. false: text_emb and text_mask (or None) of captions that
  contradict the motions, and which items have one (B,): with these the error of a latent before the time
  config.contrast_until has to be larger by config.contrast_margin, else config.contrast times the difference is added.
  """
  made = masking.corruption(draws.time_u, draws.order_u, draws.noise_u, draws.keep_u, real_mask, config.noise_rate,
                            config.mask_rate, config.mask_draw)
  x = masking.corrupt(z1, made, draws.noise, net.apply(params, method="mask_token"), real_mask)
  text_emb = jnp.where((draws.text_u < config.drop_rate)[:, None, None], 0.0, text_emb)
  attn_mask = trained_mask(config.mask, real_mask & ~made.masked, real_mask, draws.mask_u)
  prior_mask = None if codes is None else draws.prior_u >= config.prior_drop_rate
  key, items = (None, None) if dropout is None else dropout
  condition_of = lambda text_emb, text_mask: net.apply(
      params, x, text_emb, attn_mask, codes, prior_mask, text_mask, items, method="condition",
      rngs=None if key is None else {"dropout": key})
  condition = condition_of(text_emb, text_mask)

  def error_of(params, condition, z1, noise, t):
    predict = lambda x, t: net.apply(params, x, t, condition, method="predict")  # one condition for all copies
    if config.diffusion == "ddpm":
      schedule = ddpm.cosine_schedule(config.ddpm_steps)
      errors = ddpm.loss_rows(predict, schedule, jnp.broadcast_to(z1, noise.shape), t, noise)
    else:
      errors = ((predict(paths.add_noise(z1, noise, t), t) - (z1 - noise)) ** 2).mean(-1)
    return errors.astype(jnp.promote_types(errors.dtype, jnp.float32))

  copied: tuple[Array, ...] = (draws.diffusion_noise, draws.t)
  error: Callable = error_of
  if false is not None:
    condition = jnp.concatenate([condition, condition_of(*false[:2])], axis=-1)
    compared = (false[2] & (draws.text_u >= config.drop_rate))[None, :, None] & (draws.t < config.contrast_until)
    copied += (compared,)

    def contrasted(params, conditions, z1, noise, t, compared):
      matched, contradicted = (error_of(params, condition, z1, noise, t)
                               for condition in jnp.split(conditions, 2, axis=-1))
      penalty = paths.margin_loss(matched, contradicted, config.contrast_margin)
      return matched + config.contrast * jnp.where(compared, penalty, 0.0)

    error = contrasted

  head = {"params": {"head": params["params"]["head"]}}
  total = sum_of_masked(error, head, condition, made.masked, z1, copied)
  # A batch of short clips may have nothing masked at all.
  return {"loss": total}, jnp.maximum(made.masked.sum() * len(draws.t), jnp.finfo(total.dtype).tiny)
