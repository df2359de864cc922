"""Losses that bring a motion and its caption close together (docs/papers/cmdm.md#tmr, #part-tmr).

info_nce    contrast: a caption has to find its motion among those of the batch, and the motion its caption
tmr_terms   TMR: the same contrast, and Gaussians of both sides that are alike, close to the unit one, and decode to the
            motion
"""
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import optax

from motion_jax import shapes
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.tmr import mean_rows
from motion_jax.shapes import Array, Bool, Float, Net


def unit(x: Float[Array, "*lead e"]) -> Float[Array, "*lead e"]:
  """x / |x| over the last axis."""
  return x / jnp.maximum(jnp.linalg.norm(x, axis=-1, keepdims=True), 1e-12)


def symmetric_cross_entropy(logits: Float[Array, "b b"]) -> Float[Array, ""]:
  """Mean of the two cross-entropies by which rows find their columns and columns their rows; pairs on the diagonal."""
  right = lambda rows: -jnp.diagonal(jax.nn.log_softmax(rows, axis=-1)).mean()
  return (right(logits) + right(logits.T)) / 2


def info_nce(text: Float[Array, "b e"], motion: Float[Array, "b e"], scale: Any, same: Bool[Array, "b b"] | None = None
             ) -> tuple[Float[Array, ""], Float[Array, "b b"]]:
  """Symmetric contrast: the mean of two cross-entropies over text (B, E) and motion (B, E), both of unit length.

  same (B, B): pairs of the same meaning, which are not counter-examples; the code has no such filter (Parity). Returns
  (loss, logits (B, B), rows are texts).
  """
  shapes.check(text=(text, "BE"), motion=(motion, "BE"))
  logits = scale * text @ motion.T
  seen = logits
  if same is not None:
    seen = jnp.where(same & ~jnp.eye(len(logits), dtype=bool), jnp.finfo(logits.dtype).min, logits)
  return symmetric_cross_entropy(seen), logits


Gaussian = Sequence[Float[Array, "b d"]]  # mean and logarithm of the variance


def divergence(a: Gaussian, b: Gaussian) -> Float[Array, ""]:
  """Mean over (B, D) of KL(a || b) of Gaussians given as (mean, logvar)."""
  (mean_a, log_a), (mean_b, log_b) = a, b
  return 0.5 * (log_b - log_a + (jnp.exp(log_a) + jnp.square(mean_a - mean_b)) / jnp.exp(log_b) - 1).mean()


def near_texts(sentence: Float[Array, "b e"], threshold: float) -> Bool[Array, "b b"]:
  """Pairs that the contrast leaves out, (B, B): different rows whose sentence vectors (B, E), of unit length, have a
  cosine over 2 * threshold - 1.
  """
  # Parity: a threshold of 0.8 is a cosine of 0.6, for TMR counts similarity in 0..1.
  return (sentence @ sentence.T > 2 * threshold - 1) & ~jnp.eye(len(sentence), dtype=bool)


def sample(gaussian: Gaussian, noise: Float[Array, "b d"], scale: float = 1.0) -> Float[Array, "b d"]:
  """mean + scale * noise * sigma of (mean, logvar)."""
  mean, logvar = gaussian
  return mean + scale * noise * jnp.exp(logvar / 2)


def tmr_terms(net: Net, params: Any, batch: Mapping[str, Array], noise: tuple[Array, Array],
              weights: Mapping[str, float], temperature: float = 0.1, threshold: float = 0.8,
              deterministic: bool = True, rngs: Callable[[int], Any] | None = None,
              whole: Callable[[Array], Array] = lambda a: a) -> dict[str, Array]:
  """Loss terms of a batch: recons, kl, latent, contrastive and, as loss, their sum by `weights`.

  batch: features (B, T, F), num_frames (B,), text_emb (B, S, W), text_mask (B, S), and sentence (B, E), vectors of unit
  length that identify similar captions, or None: no pair is left out. noise: of the text's and of the motion's latent,
  each (B, D). rngs(i): dropout keys of the i-th of three networks. whole: gathers an array from all devices, since the
  contrast and the padding are those of the whole batch.
  """
  x, text_mask = batch["features"], batch["text_mask"]
  frame_mask = padding_mask(batch["num_frames"], x.shape[1])
  run = lambda i, method, *inputs: net.apply({"params": params}, *inputs, deterministic, method=method,
                                             rngs=None if rngs is None else rngs(i))
  *text, _ = run(0, "text_gaussian", batch["text_emb"], text_mask)
  *motion, rows = run(1, "motion_gaussian", x, frame_mask)
  text_z, motion_z = sample(text, noise[0]), sample(motion, noise[1])
  # Parity: a mean over everything, padding included, where both sides are 0, so short clips count less; the padding
  # is that to the longest of the batch, however long the array is.
  count = len(x) * whole(batch["num_frames"]).max() * x.shape[-1]
  target = jnp.where(frame_mask[..., None], x, 0.0)
  decoded = run(2, "decode", jnp.concatenate([text_z, motion_z]), jnp.tile(frame_mask, (2, 1)))
  prior = [jnp.zeros_like(text_z)] * 2
  pooled = motion_z if net.pool == "token" else mean_rows(rows, frame_mask)
  same = None if batch.get("sentence") is None else near_texts(whole(batch["sentence"]), threshold)
  contrastive, logits = info_nce(whole(unit(text_z)), whole(unit(pooled)), 1 / temperature, same)
  terms = {"recons": optax.huber_loss(decoded, jnp.tile(target, (2, 1, 1))).sum() / count,
           "kl": (divergence(text, motion) + divergence(motion, text) + divergence(motion, prior)
                  + divergence(text, prior)),
           "latent": optax.huber_loss(text_z, motion_z).mean(), "contrastive": contrastive}
  total = sum(weights[name] * value for name, value in terms.items())
  hit = (logits.argmax(0) == jnp.arange(len(logits))).mean()
  left_out = jnp.zeros(()) if same is None else same.mean()
  return terms | {"loss": total, "batch_recall": hit, "left_out": left_out}
