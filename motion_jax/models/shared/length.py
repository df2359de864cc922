"""How long a motion should be: MARDM's length estimator (docs/papers/cdamd.md#length), its stage and use.

MoMask's is the same one. A generator that has one keeps its sizes as config.length, its parameters as a frozen part.
"""
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from ml_collections import ConfigDict

from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.shapes import Array, Float, Int
from motion_jax.training.stage import Stage, mixed_precision


def length_stage(config: ConfigDict) -> Stage:
  """Trains the estimator: batch["text_emb"] (B, 1, E) sentence vectors, num_frames (B,), index (B,)."""
  net = mixed_precision(LengthEstimator(**config.model), config)

  def init(batch, rng):
    return net.init(rng, batch["text_emb"][:1, 0])

  def loss(params, frozen, batch, step, rng):
    keys = jax.vmap(lambda i: jax.random.fold_in(rng, i))(batch["index"])
    logits = jax.vmap(lambda x, key: net.apply(params, x[None], False, rngs={"dropout": key})[0])(
        batch["text_emb"][:, 0], keys)
    return _sums(logits, batch["num_frames"] // config.data.frames_per_latent), float(len(logits))

  def predict(params, frozen, batch, rng):
    logits = net.apply(params, batch["text_emb"][:, 0])
    return {"logits": logits, **_sums(logits, batch["num_frames"] // config.data.frames_per_latent)}

  return Stage(init, loss, predict, in_parts=True)


def _sums(logits, num_latents):
  import optax  # only training needs it
  losses = optax.softmax_cross_entropy_with_integer_labels(logits, jnp.minimum(num_latents, logits.shape[-1] - 1))
  off = jnp.abs(jnp.argmax(logits, -1) - num_latents)
  return {"loss": losses.sum(), "latents_off": off.sum().astype(losses.dtype)}


def length_shapes(net: LengthEstimator, text_dim: int) -> Any:
  """Shapes of the estimator's parameters, to check a file against."""
  return jax.eval_shape(lambda: net.init(jax.random.key(0), jnp.zeros((1, text_dim))))


def middle_frames(logits: Float[Array, "b k"], frames_per_latent: int = 4) -> Int[np.ndarray, " b"]:
  """Median length in frames (B,) of the estimated distribution, at least one latent."""
  # Parity: the reference draws a length; here repeated calls give the same length.
  share = np.cumsum(np.asarray(jax.nn.softmax(logits)), axis=-1)
  return frames_per_latent * np.maximum(np.argmax(share >= 0.5 * share[..., -1:], axis=-1), 1)
