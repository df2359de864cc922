"""Losses of MoMask's two transformers: cross-entropy of hidden codes, and of the codes of one residual level."""
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.models.shared import mask_schedule as masking
from motion_jax.shapes import Array, Bool, Float, Int, Net


class Draws(NamedTuple):
  """Random numbers of a training step for B motions of L codes.

  From [0, 1): time_u, text_u (B,); order_u, noise_u, keep_u (B, L). random_codes (B, L) in 0 .. K - 1. The residual
  transformer uses time_u, by which it draws a level, and text_u.
  """
  time_u: Float[Array, " b"]
  text_u: Float[Array, " b"]
  order_u: Float[Array, "b l"]
  noise_u: Float[Array, "b l"]
  keep_u: Float[Array, "b l"]
  random_codes: Int[Array, "b l"]


def draw_step(keys: jax.Array, length: int, num_codes: int) -> Draws:
  """keys (B,): one per item, so that draws are the same on any number of devices."""
  def of_item(key):
    scalar_key, places, codes = jax.random.split(key, 3)
    time, text = jax.random.uniform(scalar_key, (2,))
    random_codes = jax.random.randint(codes, (length,), 0, num_codes)
    order, noise, keep = jax.random.uniform(places, (3, length))
    return Draws(time, text, order, noise, keep, random_codes)

  return jax.vmap(of_item)(keys)


def hide(codes: Int[Array, "b l"], real_mask: Bool[Array, "b l"], draws: Draws, num_codes: int, noise_rate: float = 0.1,
         mask_rate: float = 0.88) -> tuple[Int[Array, "b l"], Bool[Array, "b l"]]:
  """(what the masked transformer reads, which codes carry loss), both (B, L); K is the mask, K + 1 padding."""
  # Parity: of the hidden codes 10 % are random, 79.2 % masked and 10.8 % kept; the paper says 10, 80 and 10.
  hidden = masking.corruption(draws.time_u, draws.order_u, draws.noise_u, draws.keep_u, real_mask, noise_rate,
                              mask_rate)
  given = jnp.where(hidden.noised, draws.random_codes, codes)
  given = jnp.where(hidden.replaced, num_codes, given)
  return jnp.where(real_mask, given, num_codes + 1), hidden.masked


def level_of(u: Float[Array, " b"], num_levels: int) -> Int[Array, " b"]:
  """The residual level 1 .. Q - 1 that a draw u in [0, 1) stands for."""
  # Parity: by a cosine, so low levels come more often; the paper draws them alike.
  return jnp.round((1 - jnp.cos(u * math.pi * 0.5)) * (num_levels - 2)).astype(int) + 1


def masked_loss(net: Net, params: Any, codes: Int[Array, "b l"], real_mask: Bool[Array, "b l"],
                text_emb: Float[Array, "b e"], draws: Draws, config: ConfigDict,
                dropout: tuple[Array, Array] | None = None) -> tuple[dict[str, Array], Array]:
  """(sums, weight): cross-entropy and accuracy of the hidden codes of level 0, (B, L), all of a batch alike.

  dropout: (a key, the items' places (B,) in the whole batch) to train with it.
  """
  given, hidden = hide(codes, real_mask, draws, net.num_codes, config.noise_rate, config.mask_rate)
  logits = _apply(net, params, dropout, given, _with_text(text_emb, draws, config), real_mask)
  return _sums(logits, codes, hidden)


def residual_loss(net: Net, params: Any, codes: Int[Array, "b l q"], real_mask: Bool[Array, "b l"],
                  text_emb: Float[Array, "b e"], draws: Draws, config: ConfigDict,
                  dropout: tuple[Array, Array] | None = None) -> tuple[dict[str, Array], Array]:
  """(sums, weight): the same of the codes of one level of each motion, drawn by time_u, given all levels below."""
  level = level_of(draws.time_u, net.num_levels)
  codes = jnp.where(real_mask[..., None], codes, net.padding_code)
  history = net.apply(params, codes, level, method="history")
  logits = _apply(net, params, dropout, history, level, _with_text(text_emb, draws, config), real_mask)
  target = jnp.take_along_axis(codes, level[:, None, None], axis=-1)[..., 0]
  return _sums(logits, target, real_mask)


def _with_text(text_emb, draws, config):
  return jnp.where((draws.text_u < config.drop_rate)[:, None], 0.0, text_emb)


def _apply(net, params, dropout, *inputs):
  key, items = (None, None) if dropout is None else dropout
  return net.apply(params, *inputs, items=items, rngs=None if key is None else {"dropout": key})


def _sums(logits, target, counted):
  import optax  # only training needs it
  losses = optax.softmax_cross_entropy_with_integer_labels(logits, jnp.where(counted, target, 0))
  right = jnp.where(counted, jnp.argmax(logits, -1) == target, False).sum()
  sums = {"loss": jnp.where(counted, losses, 0.0).sum(), "accuracy": right.astype(losses.dtype)}
  # A batch of short clips may have nothing hidden at all.
  return sums, jnp.maximum(counted.sum().astype(losses.dtype), jnp.finfo(losses.dtype).tiny)
