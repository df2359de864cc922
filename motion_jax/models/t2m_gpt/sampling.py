"""Codes of a motion from T2M-GPT, one after the other until the end code, with a cache of keys and values."""
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from motion_jax.shapes import Array, Float, Int, Net

Choose = Callable[[Any, Float[Array, "b k"]], Int[Array, " b"]]  # (place, logits) -> codes


def greedy(place: Any, logits: Float[Array, "b k"]) -> Int[Array, " b"]:
  """The likeliest code."""
  return jnp.argmax(logits, axis=-1)


def categorical(keys: jax.Array, temperature: float = 1.0) -> Choose:
  """Draws by Gumbel noise of a motion's key, keys (B,), and the place alone, so that batch-mates change nothing."""
  def choose(place, logits):
    noise = jax.vmap(lambda key: jax.random.gumbel(jax.random.fold_in(key, place), logits.shape[-1:]))(keys)
    return jnp.argmax(logits / temperature + noise, axis=-1)

  return choose


def sample(net: Net, params: Any, text_emb: Float[Array, "b e"], choose: Choose, fewest: Int[Array, " b"],
           most: Int[Array, " b"]) -> Int[Array, "b n"]:
  """Codes (B, max_length - 1) of motions, -1 after the last one of each.

  fewest, most (B,): how many codes a motion has at least, before which the end is not allowed, and at most.
  """
  # Parity: the reference stops at the end of the first motion of its batch, and raises for an end at once; here every
  # motion has an end of its own, and fewest = 1 keeps one code.
  batch, longest = len(text_emb), net.max_length - 1
  most = jnp.minimum(most, longest)

  def unfinished(state):
    place, _, _, done, _ = state
    return (place < longest) & ~done.all()

  def step(state):
    place, codes, last, done, cache = state
    logits, cache = net.apply(params, last, place, text_emb, cache, method="step")
    early = (place < fewest)[:, None] & (jnp.arange(logits.shape[-1]) == net.end_code)
    drawn = choose(place, jnp.where(early, -jnp.inf, logits))
    done = done | (drawn == net.end_code) | (place >= most)
    codes = codes.at[:, place].set(jnp.where(done, -1, drawn))
    return place + 1, codes, jnp.where(done, net.end_code, drawn), done, cache

  start = (jnp.zeros((), int), jnp.full((batch, longest), -1), jnp.zeros(batch, int), most <= 0,
           net.init_cache(batch))
  return jax.lax.while_loop(unfinished, step, start)[1]
