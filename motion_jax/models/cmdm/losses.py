"""Losses of CMDM's tokenizer: reconstruction, the KL divergence, and alignment with a motion-language teacher."""
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import flax
import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.models.shared.likelihoods import (
  ALONE,
  Sharing,
  gaussian_nll,
  kl_to_standard_normal,
  mean_square_nll,
  smooth_l1,
)
from motion_jax.nets.causal_vae import sample_latent
from motion_jax.shapes import Array, Float, Net

__all__ = ["DISTANCE_PAIRS", "LAST_LAYERS", "RECONSTRUCTIONS", "align_factor", "align_loss", "align_ratio",
           "align_terms", "gaussian_nll", "kl_to_standard_normal", "mean_square_nll", "pool_teacher", "set_distances",
           "smooth_l1", "tokenizer_terms"]

RECONSTRUCTIONS = {"gaussian": gaussian_nll, "smooth_l1": smooth_l1}


def align_terms(student: Float[Array, "b n e"], teacher: Float[Array, "b n e"], cos_margin: float = 0.5,
                distance_margin: float = 0.25) -> tuple[Float[Array, ""], Float[Array, ""]]:
  """Marginal cosine and marginal distance-matrix losses between (B, N, E) and (B, N, E) (CMDM eq. 3 to 6).

  The first pulls each latent towards its teacher's direction until their cosine is over 1 - cos_margin, the second
  makes cosines between latents of one window those between the teacher's features, to within distance_margin.
  """
  # Parity: the paper writes the second over unprojected latents and the whole set; the code's is inside a window.
  student, teacher = _unit(student), _unit(teacher)
  cosine = (student * teacher).sum(-1)
  mcos = jax.nn.relu(1 - cos_margin - cosine).mean()
  among = lambda a: jnp.einsum("bie,bje->bij", a, a)
  return mcos, _distance_term(among(student), among(teacher), distance_margin)


def _unit(a):
  return a / jnp.maximum(jnp.linalg.norm(a, axis=-1, keepdims=True), 1e-6)


def _distance_term(student, teacher, margin):
  """Mean of what the cosines of pairs differ by beyond the margin; two arrays of one shape."""
  return jax.nn.relu(jnp.abs(student - teacher) - margin).mean()


def set_distances(latents: Float[Array, "b n c"], teacher: Float[Array, "b n e"], margin: float = 0.25,
                  shared: Sharing = ALONE) -> Float[Array, ""]:
  """The marginal distance-matrix loss of the paper's equation 6: latents (B, N, C) as they are, not projected, and the
  teacher's features (B, N, E), in pairs over all windows of the micro-batch, (B N)^2 of them.

  Where devices share it, the mean over pairs of which the first lies on this one.
  """
  rows = lambda a: _unit(a.reshape(1, -1, a.shape[-1]))
  among = lambda a: jnp.einsum("bie,bje->bij", rows(a), rows(shared.gather(a)))
  return _distance_term(among(latents), among(teacher), margin)


DISTANCE_PAIRS = ("window", "set")


def align_loss(vae: Net, params: Any, z: Float[Array, "b n c"], teacher: Float[Array, "b n e"],
               distance_pairs: str = "window", shared: Sharing = ALONE) -> tuple[Float[Array, ""], Float[Array, ""]]:
  """(mcos, mdms) of latents z (B, N, C) and the teacher's features (B, N, E) at each.

  distance_pairs: whose cosines the second compares, "window" (`align_terms`) or "set" (`set_distances`).
  """
  if distance_pairs not in DISTANCE_PAIRS:
    raise ValueError(f"got loss.distance_pairs {distance_pairs!r}, expected one of {', '.join(DISTANCE_PAIRS)}")
  mcos, mdms = align_terms(*(a.astype(z.dtype) for a in vae.apply(params, z, teacher, method="aligned")))
  if distance_pairs == "set":
    mdms = set_distances(z, teacher, shared=shared)
  return mcos * shared.share, mdms * shared.share


def pool_teacher(features: Float[Array, "b t e"], num_latents: int) -> Float[Array, "b {num_latents} e"]:
  """The teacher's frame features (B, T, E) -> their mean over each latent's frames (B, N, E)."""
  batch, frames, dim = features.shape
  if frames % num_latents:
    # Parity: the code lets the term vanish without a word.
    raise ValueError(f"got windows of {frames} frames for {num_latents} latents; data.window must be a multiple of the "
                     "frames of a latent")
  return features.reshape(batch, num_latents, -1, dim).mean(2)


LAST_LAYERS = {"convolution": ("encoder", "conv_out", "conv", "kernel"), "linear": ("encoder", "head", "kernel")}


def align_ratio(vae: Net, params: Any, x: Float[Array, "b t f"], noise: Float[Array, "b n c"],
                teacher: Float[Array, "b n e"], reconstruction: str = "gaussian", distance_pairs: str = "window",
                last_layer: str = "convolution", shared: Sharing = ALONE
                ) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
  """|d rec / d W| / |d align / d W| at W, the encoder's last convolution, and both norms.

  Source: docs/papers/cmdm.md#alignment.

  last_layer "linear": at the linear layer after it.

  Constants to the gradient. Neither derivative goes deeper than W, so that rec costs one pass back through the decoder,
  without its parameters' gradients; the forward pass is the loss's own and compiled once.
  """
  # Parity: the paper says "the final layer of the encoder"; the code takes the last convolution, not the linear layer.
  params, x, teacher = jax.lax.stop_gradient((params, x, teacher))
  path = ("params", *LAST_LAYERS[last_layer])
  flat = flax.traverse_util.flatten_dict(params)

  def of_kernel(kernel):
    changed = flax.traverse_util.unflatten_dict({**flat, path: kernel})
    y, mean, logvar = vae.apply(changed, x, noise)
    z = sample_latent(mean, logvar, noise)
    align = sum(align_loss(vae, changed, z, teacher, distance_pairs, shared))
    return RECONSTRUCTIONS[reconstruction](y.astype(x.dtype), x, shared), align

  (rec, align), pull = jax.vjp(of_kernel, flat[path])
  norms = [jnp.linalg.norm(shared.total(pull(seeds)[0])) for seeds in ((jnp.ones_like(rec), jnp.zeros_like(align)),
                                                         (jnp.zeros_like(rec), jnp.ones_like(align)))]
  ratio = jnp.clip(norms[0] / jnp.maximum(norms[1], 1e-4), 0, 1e4)
  return jax.lax.stop_gradient((ratio, *norms))


def align_factor(step: Any, config: ConfigDict, num_steps: int) -> Any:
  """Factor of the alignment term: config.align, which falls linearly, after the ramp of the KL term, by the share
  config.align_fall of it: 0.9 leaves a tenth."""
  progress = jnp.clip((step - config.kl_ramp) / max(num_steps - config.kl_ramp, 1), 0, 1)
  return config.align * (1 - config.align_fall * progress)


def tokenizer_terms(vae: Net, params: Any, x: Float[Array, "b t f"], noise: Float[Array, "b n c"], kl_weight: Any,
                    root_weight: Any, *, root_columns: slice, teacher: Float[Array, "b n e"] | None = None,
                    align_weight: Any = 0.0, adaptive: bool = True, reconstruction: str = "gaussian",
                    shared: Sharing = ALONE, errors: Callable | None = None,
                    error_weights: Mapping[str, float] = MappingProxyType({}), **alignment: Any) -> dict[str, Array]:
  """Loss terms of one micro-batch x (B, T, F), or of this device's rows of one that is shared: a dict with rec, root,
  kl and their weighted sum, loss.

  root_columns: `root` of the features' representation. With teacher (B, N, E), its features at each latent, also mcos,
  mdms, their sum align, and the weight that it gets: align_weight times the ratio of gradients, or plain if not
  adaptive. alignment: distance_pairs, last_layer of `align_ratio`.

  errors(decoded, x): {name: mean squares (B,)} of `motion_errors.of_features`, unweighted; in the loss each is a
  Gaussian likelihood with a sigma of its own, as many numbers as x has: at weight 1 it weighs as much as rec.
  """
  # Parity: the root term is the code's alone, and its KL weight is 0.01 with a ramp, the paper's 1.0; both are fields.
  y, mean, logvar = (a.astype(x.dtype) for a in vae.apply(params, x, noise))  # the network may compute in bfloat16
  measure = RECONSTRUCTIONS[reconstruction]
  terms = {"rec": measure(y, x, shared), "root": measure(y[..., root_columns], x[..., root_columns], shared),
           "kl": kl_to_standard_normal(mean, logvar) * shared.share, "mse": ((y - x) ** 2).mean() * shared.share}
  terms["loss"] = terms["rec"] + kl_weight * terms["kl"] + root_weight * terms["root"]
  for name, squares in (errors(y, x) if errors else {}).items():
    terms[name] = squares.mean() * shared.share
    terms["loss"] += error_weights[name] * mean_square_nll(squares.mean(), x.size, shared)
  if teacher is not None:
    z = sample_latent(mean, logvar, noise)
    pairs = alignment.get("distance_pairs", "window")
    terms["mcos"], terms["mdms"] = align_loss(vae, params, z, teacher, pairs, shared)
    terms["align"] = terms["mcos"] + terms["mdms"]
    ratio: Any = 1.0
    reported: dict[str, Array] = {}
    if adaptive:
      ratio, reported["grad_rec"], reported["grad_align"] = align_ratio(vae, params, x, noise, teacher, reconstruction,
                                                                shared=shared, **alignment)
    reported["align_weight"] = jnp.asarray(align_weight * ratio, x.dtype)
    terms["loss"] += reported["align_weight"] * terms["align"]
    terms |= {name: value * shared.share for name, value in reported.items()}
  return terms
