"""Losses of variational autoencoders that several methods share: likelihoods with a sigma of their own, divergences.

A sigma belongs to a micro-batch, which several devices may hold together (`Sharing`).
"""
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optax

from motion_jax import shapes
from motion_jax.shapes import Array, Float, Latents


class Sharing(NamedTuple):
  """How devices hold one micro-batch together. Their terms add up to those of the whole micro-batch.

  share: of its rows that lie on this device. total: sums an array over these devices; gather: the rows of all of them.
  """
  share: float = 1.0
  total: Callable = lambda array: array
  gather: Callable = lambda array: array


ALONE = Sharing()  # one device holds all of it


def sharing(rows: int, size: int, num_devices: int, axis_name: str) -> Sharing:
  """`Sharing` for num_devices, mapped over axis_name, each with this number of rows in micro-batches of this size."""
  if rows % size == 0:
    return ALONE
  if size % rows:
    raise ValueError(f"got {rows} windows on each of {num_devices} devices, expected a multiple or a divisor of "
                     f"loss.micro_batch = {size}; change data.batch_size, loss.micro_batch or the number of devices")
  together = size // rows
  groups = [[*range(first, first + together)] for first in range(0, num_devices, together)]
  return Sharing(rows / size, lambda array: jax.lax.psum(array, axis_name, axis_index_groups=groups),
                 lambda array: jax.lax.all_gather(array, axis_name, axis_index_groups=groups, tiled=True))


def gaussian_nll(prediction: Float[Array, "b t f"], target: Float[Array, "b t f"], shared: Sharing = ALONE
                 ) -> Float[Array, ""]:
  """Negative log-likelihood of a Gaussian with one sigma, the best for this batch; summed over all elements.

  s = log sqrt(mean squared error), softly floored at -6; gradients flow through it
  (docs/papers/cmdm.md#tokenizer-loss).
  """
  # Parity: the paper says "standard reconstruction loss"; this likelihood, summed, is the released code's.
  shapes.check(prediction=(prediction, "BTF"), target=(target, "BTF"))
  square = (prediction - target) ** 2
  log_sigma = _log_sigma(shared.total(square.mean()) * shared.share)
  # The constant per element is multiplied, not added up: a long float32 sum of equal numbers drifts.
  return square.sum() / (2 * jnp.exp(2 * log_sigma)) + square.size * (log_sigma + 0.5 * jnp.log(2 * jnp.pi))


def _log_sigma(mean_square):
  log_sigma = jnp.log(jnp.maximum(jnp.sqrt(mean_square), 1e-8))
  return -6 + jax.nn.softplus(log_sigma + 6)


def mean_square_nll(mean_square: Float[Array, ""], size: int, shared: Sharing = ALONE) -> Float[Array, ""]:
  """`gaussian_nll` of `size` errors with a known mean square, without its constant."""
  log_sigma = _log_sigma(shared.total(mean_square) * shared.share)
  return size * (mean_square / (2 * jnp.exp(2 * log_sigma)) + log_sigma)


def smooth_l1(prediction: Float[Array, "b t f"], target: Float[Array, "b t f"], shared: Sharing = ALONE
              ) -> Float[Array, ""]:
  """Reconstruction by SmoothL1 (beta 1), summed over frames and features, averaged over the batch.

  So it weighs against a KL divergence that is summed and averaged alike, as in a VAE's bound.
  """
  return optax.huber_loss(prediction, target).sum() / prediction.shape[0] * shared.share


def kl_to_standard_normal(mean: Latents, logvar: Latents) -> Float[Array, ""]:
  """KL divergence to N(0, I), summed over latents and channels, averaged over the batch."""
  return -0.5 * (1 + logvar - mean ** 2 - jnp.exp(logvar)).sum((1, 2)).mean()
