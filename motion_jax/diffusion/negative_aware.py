"""Negative-aware fine-tuning on the forward process (DiffusionNFT, arXiv 2509.16117): learn from scored samples.

Samples of one prompt form a group. Better ones than their group pull the network towards themselves, worse ones push
it away: no likelihoods and no trajectories of the sampler are needed, only clean samples and their rewards.
"""
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.diffusion.paths import velocity_to_x1
from motion_jax.shapes import Array, Bool, Float, Num
from motion_jax.utils.errors import InputError

LARGEST_ADVANTAGE = 5.0  # a_max of the authors' base configuration
_LEAST_ERROR = 1e-5


def optimality(rewards: Num[np.ndarray, " n"], groups: Num[np.ndarray, " n"], largest: float = LARGEST_ADVANTAGE
               ) -> Float[np.ndarray, " n"]:
  """The optimality r (N,) in [0, 1] of samples by their rewards; NaN for groups whose rewards are all equal.

  a = (reward - mean of its group) / (std of all rewards + 1e-4), r = clip(a / largest / 2 + 1/2, 0, 1). Raises
  InputError if no group has different rewards.
  """
  rewards, groups = np.asarray(rewards, np.float64), np.asarray(groups)
  _, inverse, counts = np.unique(groups, return_inverse=True, return_counts=True)
  mean = np.bincount(inverse, rewards) / counts
  advantage = (rewards - mean[inverse]) / (rewards.std() + 1e-4)
  spread = np.bincount(inverse, (rewards - mean[inverse]) ** 2)[inverse] > 1e-12
  if not spread.any():
    raise InputError(f"got {len(rewards)} rewards that do not differ within any of {len(counts)} groups, so nothing is "
                     "to be learned; sample more per prompt, or other prompts")
  return np.where(spread, np.clip(advantage / largest / 2 + 0.5, 0, 1), np.nan)


def loss(velocity: Float[Array, "b l c"], old: Float[Array, "b l c"], reference: Float[Array, "b l c"],
         x: Float[Array, "b l c"], clean: Float[Array, "b l c"], t: Float[Array, "b l"], mask: Bool[Array, "b l"],
         optimality: Float[Array, " b"], beta: float = 1.0, largest: float = LARGEST_ADVANTAGE, pull: float = 1e-4
         ) -> Float[Array, " b"]:
  """The loss (B,) of samples `clean`, noised to x at times t: equations of the source, in velocities.

  velocity: of the network in training; old: of the one that sampled; reference: of the one at the start. With
  v+ = beta v + (1 - beta) v_old and v- = (1 + beta) v_old - beta v, and the errors E of the clean samples that these
  imply, each divided by its own mean absolute error (without a gradient),
  loss = largest (r E+ / beta + (1 - r) E- / beta) + pull |v - v_ref|^2. Means are over the latents of mask (B, L).
  """
  old, reference = jax.lax.stop_gradient(old), jax.lax.stop_gradient(reference)
  mean = lambda a: jnp.where(mask, a.mean(-1), 0.0).sum(1) / jnp.maximum(mask.sum(1), 1)

  def error_of(velocity):
    off = velocity_to_x1(x, velocity, t) - clean
    size = jnp.maximum(jax.lax.stop_gradient(mean(jnp.abs(off))), _LEAST_ERROR)
    return mean(off ** 2) / size

  positive, negative = beta * velocity + (1 - beta) * old, (1 + beta) * old - beta * velocity
  errors = optimality * error_of(positive) + (1 - optimality) * error_of(negative)
  return largest * errors / beta + pull * mean((velocity - reference) ** 2)
