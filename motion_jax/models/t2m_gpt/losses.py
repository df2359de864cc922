"""The loss of T2M-GPT's transformer: the next code, from codes of which some are replaced by random ones."""
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from motion_jax.nets.masks import padding_mask
from motion_jax.shapes import Array, Bool, Float, Int, Net


class Draws(NamedTuple):
  """Random numbers of a training step: keep_u (B, n) from [0, 1), random_codes (B, n) in 0 .. K - 1, rate (): the share
  of inputs that stay, where it is drawn."""
  keep_u: Float[Array, "b n"]
  random_codes: Int[Array, "b n"]
  rate: Float[Array, ""]


def draw_step(rng: jax.Array, keys: jax.Array, length: int, num_codes: int) -> Draws:
  """keys (B,): one per item, so that draws are the same on any number of devices; rng: the same on all of them."""
  def of_item(key):
    keep, codes = jax.random.split(key)
    return jax.random.uniform(keep, (length,)), jax.random.randint(codes, (length,), 0, num_codes)

  keep_u, random_codes = jax.vmap(of_item)(keys)
  return Draws(keep_u, random_codes, jax.random.uniform(rng))


def corrupt(target: Int[Array, "b m"], draws: Draws, keep_rate: float) -> Int[Array, "b n"]:
  """The inputs (B, M - 1) for rows of targets (B, M): each stays with probability keep_rate, else it is a random code.

  keep_rate -1: with the probability that was drawn for the batch.
  """
  # Parity: end and padding are replaced, too, and a replacement may be the code itself.
  rate = draws.rate if keep_rate < 0 else keep_rate
  return jnp.where(draws.keep_u < rate, target[:, :-1], draws.random_codes)


def gpt_loss(net: Net, params: Any, target: Int[Array, "b m"], num_codes: Int[Array, " b"],
             text_emb: Float[Array, "b e"], given: Int[Array, "b n"], dropout: tuple[Array, Array] | None = None
             ) -> tuple[dict[str, Array], float]:
  """(sums, weight) of a batch: mean cross-entropy of each clip's codes and end, every clip alike.

  target (B, M): codes, the end, padding; num_codes (B,) of each clip without the end; given (B, M - 1): inputs.
  dropout: (a key, the items' places (B,) in the whole batch) to train with it.
  """
  import optax  # only training needs it
  key, items = (None, None) if dropout is None else dropout
  logits = net.apply(params, given, text_emb, items=items, rngs=None if key is None else {"dropout": key})
  counted: Bool[Array, "b m"] = padding_mask(num_codes + 1, target.shape[1])
  losses = optax.softmax_cross_entropy_with_integer_labels(logits, jnp.where(counted, target, 0))
  mean = lambda a: (jnp.where(counted, a, 0).sum(-1) / counted.sum(-1)).sum()
  right = (jnp.argmax(logits, -1) == target).astype(losses.dtype)
  return {"loss": mean(losses), "accuracy": mean(right)}, float(len(target))
