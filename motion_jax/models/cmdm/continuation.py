"""Going on from clean latents as the released code does: past and future are noised afresh in every step.

A window holds P past latents and N new ones, blocks counted from its start. A step guesses the clean window, puts the
given past in its place, and goes to the next level with new noise (docs/papers/cmdm.md#continuation). So the sampler is
stochastic, and the network never sees the past clean before the end; our own way, a cache of the clean past, is
`streaming.Sampler.prefill`.
"""
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Float

from motion_jax.diffusion.paths import add_noise, velocity_to_x1
from motion_jax.shapes import Array


def step(velocity: Callable[..., Array], x: Float[Array, "b l c"], t: Float[Array, " l"], t_next: Float[Array, " l"],
         past: Float[Array, "b p c"], noise: Float[Array, "b l c"]) -> Float[Array, "b l c"]:
  """One step of the window x (B, P + N, C) from times t to t_next (P + N,); past (B, P, C), noise like x.

  The first step finds noise where the past belongs: it is put in place after the network has spoken.
  """
  # Parity: the paper keeps a clean past in the context (equation 12); this is what the code does.
  t, t_next = (jnp.broadcast_to(a, x.shape[:2]) for a in (t, t_next))
  x1 = jnp.asarray(velocity_to_x1(x, velocity(x, t[0]), t))
  x1 = x1.at[:, :past.shape[1]].set(past.astype(x.dtype))
  return add_noise(x1, noise, t_next)


def renoised(velocity: Callable[..., Array], x: Float[Array, "b l c"], times: Float[Array, "n l"],
             past: Float[Array, "b p c"], fresh: Callable[[Any], Array]) -> Float[Array, "b l c"]:
  """Carries noise x (B, P + N, C) to data behind a clean past (B, P, C) along times (M + 1, P + N).

  velocity(x, t (P + N,)) -> like x; fresh(m) is the new noise of step m, m a traced integer. The window comes back
  whole, its first P latents those given.
  """
  def body(x, interval):
    m, t, t_next = interval
    return step(velocity, x, t, t_next, past, fresh(m)), None

  return jax.lax.scan(body, x, (jnp.arange(len(times) - 1), times[:-1], times[1:]))[0]
