"""Latents one after the other with MotionStreamer, each by diffusion, from a caption and the latents before it.

A segment begins with its caption and the newest latents so far; keys and values of these rows are cached, and each
latent adds one row. A segment has a fixed number of places, a motion has not: when they are full, the next segment
(`model`) begins with the newest half of the latents.
"""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from motion_jax.diffusion import ddpm, guidance
from motion_jax.nets.latent_llama import LlamaCache
from motion_jax.shapes import Array, Float, Int, Net


class Plan(NamedTuple):
  """Static choices of sampling; hashable. train_steps: steps of the head's training. clip_latents: bound of the clean
  latents that the head predicts in each step, 0 for none."""
  train_steps: int = 50
  num_steps: int = 50
  guided: bool = True
  clip_latents: float = 0.0


class Segment(NamedTuple):
  """A segment that runs: its cache, of 2 B rows with guidance, and the condition (2 B, D) of the next latent."""
  cache: LlamaCache
  condition: Float[Array, "b d"]


def begin(net: Net, plan: Plan, params: Any, text_emb: Float[Array, "b e"], no_text_emb: Float[Array, "b e"],
          past: Float[Array, "b p c"], num_past: Any) -> Segment:
  """The segment of a caption after the first num_past of the latents past (B, P, C)."""
  # Parity: a new segment reads its own caption and the latents before it, not the caption of those (as it is trained).
  text = jnp.concatenate([text_emb, no_text_emb]) if plan.guided else text_emb
  past = jnp.concatenate([past, past]) if plan.guided else past
  cache = net.apply(params, len(text), method="init_cache")
  rows, cache = net.apply(params, text, cache, method="begin")
  if past.shape[1]:
    more, cache = net.apply(params, past, cache, method="extend")
    rows = jnp.concatenate([rows, more], axis=1)
  return Segment(cache._replace(length=jnp.asarray(num_past + 1, jnp.int32)), rows[:, num_past])


def draw_latent(net: Net, plan: Plan, params: Any, segment: Segment, scale: Any, draw: Callable,
                temperature: Any = 1.0) -> Float[Array, "b c"]:
  """The next latent (B, C); draw(0) is the noise to begin with, draw(m) that of the m-th step of the head, which the
  temperature scales."""
  schedule = ddpm.respace(ddpm.cosine_schedule(plan.train_steps), plan.num_steps)
  predict = guidance.two_branches(
      lambda x, step: net.apply(params, x, step, segment.condition, method="predict"), plan.guided, scale)
  # Parity: no bound, as released. In the first step back an error of the noise counts 31 times in the latent
  # (docs/papers/motionstreamer.md#head).
  bounded = (lambda x1: jnp.clip(x1, -plan.clip_latents, plan.clip_latents)) if plan.clip_latents else (lambda x1: x1)
  return ddpm.ancestral(predict, schedule, draw(0), lambda m: draw(m + 1), temperature, replace=bounded)


def follow(net: Net, plan: Plan, params: Any, segment: Segment, latent: Float[Array, "b c"]) -> Segment:
  """The segment with one more latent."""
  rows = jnp.concatenate([latent, latent]) if plan.guided else latent
  condition, cache = net.apply(params, rows[:, None], segment.cache, method="extend")
  return Segment(cache, condition[:, 0])


class Stop(NamedTuple):
  """When a segment ends: at the first latent from number `earliest` on that lies within `distance` of `latent` (C,)."""
  latent: Any
  distance: Any
  earliest: int = 1


def sample_segment(net: Net, plan: Plan, params: Any, segment: Segment, scale: Any, draw: Callable, num_latents: int,
                   stop: Stop | None = None) -> tuple[Float[Array, "b l c"], Int[Array, " b"], Segment]:
  """(latents (B, num_latents, C), how many of each count (B,), the segment after them); draw(k, m) is the noise of
  latent k.

  With a stop a motion counts the latents before the one that ends it, at least one, and the loop ends with the last
  motion; latents after an end are no part of the motion.
  """
  def latent(k, state):
    segment, latents, counts = state
    new_latent = draw_latent(net, plan, params, segment, scale, lambda m: draw(k, m))
    going = counts == k
    if stop is not None:
      near = jnp.linalg.norm(new_latent - stop.latent, axis=-1) < stop.distance
      # Parity: the released code fails where the very first latent ends the motion.
      going = going & ~(near & (k >= max(stop.earliest, 1)))
    return follow(net, plan, params, segment, new_latent), latents.at[:, k].set(new_latent), counts + going

  channels = draw(0, 0).shape
  latents = jnp.zeros((channels[0], num_latents, channels[-1]), draw(0, 0).dtype)
  state = segment, latents, jnp.zeros(channels[0], jnp.int32)
  if stop is None:
    segment, latents, counts = jax.lax.fori_loop(0, num_latents, latent, state)
  else:
    unfinished = lambda carry: (carry[0] < num_latents) & (carry[1][2] == carry[0]).any()
    step = lambda carry: (carry[0] + 1, latent(*carry))
    segment, latents, counts = jax.lax.while_loop(unfinished, step, (jnp.zeros((), jnp.int32), state))[1]
  return latents, counts, segment
