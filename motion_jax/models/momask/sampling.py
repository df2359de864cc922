"""Codes of a motion from MoMask's transformers: masked decoding of level 0, then one pass for each residual level."""
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from motion_jax.shapes import Array, Bool, Float, Int, Net

Choose = Callable[[Any, Float[Array, "b l k"]], Int[Array, "b l"]]  # (round or level, logits) -> codes

_KEPT = 1e5  # confidence of a code that is never masked again


class Round(NamedTuple):
  """One round, or all of them with a leading axis N: which codes were masked, what the network read, its guided logits,
  a code drawn for every place, and the codes afterwards."""
  masked: Bool[Array, "*n b l"]
  given: Int[Array, "*n b l"]
  logits: Float[Array, "*n b l k"]
  drawn: Int[Array, "*n b l"]
  codes: Int[Array, "*n b l"]


def num_kept(threshold: float, num_classes: int) -> int:
  """How many of num_classes logits a threshold keeps: the likeliest 10 % of 512, 52, for 0.9."""
  return max(math.ceil((1 - threshold) * num_classes), 1)


def keep_likeliest(logits: Float[Array, "*b k"], threshold: float) -> Float[Array, "*b k"]:
  """Logits with all but the largest at -infinity; see `num_kept`."""
  least = jax.lax.top_k(logits, num_kept(threshold, logits.shape[-1]))[0][..., -1:]
  return jnp.where(logits >= least, logits, -jnp.inf)


def chooser(noise: Callable[[Any], Float[Array, "b l k"]], temperature: float, threshold: float) -> Choose:
  """Draws codes among the likeliest by Gumbel noise(i) of round or level i."""
  def choose(i, logits):
    return jnp.argmax(keep_likeliest(logits, threshold) / max(temperature, 1e-10) + noise(i), axis=-1)

  return choose


def noise_of(keys: jax.Array, length: int, num_classes: int, stream: int) -> Callable[[Any], Array]:
  """noise(i) (B, L, K) that depends on a motion's key, the stream, i and the place, nothing else, so neither padding
  nor batch-mates change it. keys (B,)."""
  fold = jax.random.fold_in

  def noise(i):
    of_place = lambda key, place: jax.random.gumbel(fold(fold(fold(key, stream), i), place), (num_classes,))
    return jax.vmap(lambda key: jax.vmap(lambda place: of_place(key, place))(jnp.arange(length)))(keys)

  return noise


def guided(predict: Callable[[Array], Array], text_emb: Float[Array, "b e"], scale: float | None) -> Array:
  """Guided logits u + scale (c - u) of predict(text_emb); scale None: of the caption alone."""
  if scale is None:
    return predict(text_emb)
  # Parity: the paper writes (1 + s) c - s u, whose s is the code's less one.
  both = predict(jnp.concatenate([text_emb, 0 * text_emb]))
  with_text, without = jnp.split(both, 2)
  return without + scale * (with_text - without)


def decode_masked(net: Net, params: Any, codes: Int[Array, "b l"], editable: Bool[Array, "b l"],
                  real_mask: Bool[Array, "b l"], counts: Int[Array, "n b"], text_emb: Float[Array, "b e"],
                  scale: float | None, choose: Choose, rescore: bool = False) -> Round:
  """All rounds of filling the editable codes of level 0, (B, L); the last one's codes are those of the motion.

  counts (N, B): how many codes each round finds masked (`mask_schedule.masked_counts` of how many are editable), the
  least certain ones. What is not editable stays as it is. rescore: in each round the certainty of all editable
  codes is that of codes drawn in their places, as the reference does for an edit without a mask.
  """
  rows = 1 if scale is None else 2
  start = jnp.where(editable, 0.0, _KEPT).astype(text_emb.dtype)

  def one_round(carry, given):
    codes, score = carry
    i, count = given
    rank = jnp.argsort(jnp.argsort(score, axis=-1, stable=True), axis=-1, stable=True)
    # Parity: the reference masks at least one code a round, so an edit of nothing changes a code; here none.
    masked = (rank < count[:, None]) & editable
    shown = jnp.where(masked, net.mask_code, codes)
    shown = jnp.where(real_mask, shown, net.padding_code)
    predict = lambda text: net.apply(params, jnp.tile(shown, (rows, 1)), text, jnp.tile(real_mask, (rows, 1)))
    logits = guided(predict, text_emb, scale)
    drawn = choose(i, logits)
    codes = jnp.where(masked, drawn, codes)
    certainty = jnp.take_along_axis(jax.nn.softmax(logits, -1), drawn[..., None], axis=-1)[..., 0]
    score = jnp.where(masked | (rescore & editable), certainty, _KEPT).astype(score.dtype)
    return (codes, score), Round(masked, shown, logits, drawn, codes)

  return jax.lax.scan(one_round, (codes, start), (jnp.arange(len(counts)), jnp.asarray(counts)))[1]


def add_levels(net: Net, params: Any, codes: Int[Array, "b l"], real_mask: Bool[Array, "b l"],
               text_emb: Float[Array, "b e"], scale: float | None, choose: Choose, num_levels: int | None = None,
               padding_class: bool = False) -> tuple[Int[Array, "b l q"], Float[Array, "q1 b l k"]]:
  """(codes (B, L, Q) with the levels above level 0, -1 at padding, guided logits of each (Q - 1, B, L, K + 1)).

  num_levels: how many levels are added, all by default. padding_class: whether the padding class may be drawn for a
  real code, which is then a zero vector to the decoder, as in the reference.
  """
  # Parity: the reference leaves the padding class in, which training only ever lowers.
  rows = 1 if scale is None else 2
  codes = jnp.where(real_mask, codes, net.padding_code)
  steps = net.num_levels - 1 if num_levels is None else num_levels

  def one_level(carry, level):
    history, codes = carry
    history = history + net.apply(params, codes, level - 1, method="embed")
    predict = lambda text: net.apply(params, jnp.tile(history, (rows, 1, 1)), jnp.full(len(text), level), text,
                                     jnp.tile(real_mask, (rows, 1)))
    logits = guided(predict, text_emb, scale)
    is_padding = jnp.arange(logits.shape[-1]) == net.padding_code
    allowed = logits if padding_class else jnp.where(is_padding, -jnp.inf, logits)
    drawn = jnp.where(real_mask, choose(level, allowed), net.padding_code)
    return (history, drawn), (drawn, logits)

  history = jnp.zeros((*codes.shape, net.code_dim), text_emb.dtype)
  residuals, logits = jax.lax.scan(one_level, (history, codes), jnp.arange(1, steps + 1))[1]
  every = jnp.concatenate([codes[None], residuals])
  return jnp.moveaxis(jnp.where(every == net.padding_code, -1, every), 0, -1), logits
