"""Losses of MLD: those of its VAE, and the error of the denoiser's prediction (docs/papers/mld.md#losses)."""
from collections.abc import Mapping

import jax.numpy as jnp
import optax

from motion_jax.shapes import Array, Float


def kl_terms(mean: Float[Array, "b n d"], logvar: Float[Array, "b n d"]) -> Float[Array, " b"]:
  """KL divergence to the unit Gaussian of each motion, averaged over the latent's numbers."""
  return 0.5 * (mean ** 2 + jnp.exp(logvar) - 1 - logvar).mean((1, 2))


def vae_terms(decoded: Float[Array, "b t f"], real: Float[Array, "b t f"], joints: tuple[Array, Array],
              mean: Float[Array, "b n d"], logvar: Float[Array, "b n d"], weights: Mapping[str, float]
              ) -> dict[str, Float[Array, " b"]]:
  """{name: (B,)}: "features" and "joints", smooth L1 with beta 1, "kl", and their weighted sum "loss".

  joints: of both motions, (B, T, J, 3). Means are over all entries, of padding too: features are 0 there on both sides,
  and the joints stay where the motion ends.
  """
  distance = lambda a, b: optax.huber_loss(a, b).reshape(len(a), -1).mean(1)
  terms = {"features": distance(decoded, real), "joints": distance(*joints), "kl": kl_terms(mean, logvar)}
  terms["loss"] = sum(weights[name] * value for name, value in terms.items())
  return terms


def prediction_error(predicted: Float[Array, "b n d"], target: Float[Array, "b n d"]) -> Float[Array, " b"]:
  """Squared error of each motion's latents."""
  return ((predicted - target) ** 2).mean((1, 2))
