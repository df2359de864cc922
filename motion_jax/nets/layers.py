"""Small layers that several networks share: dense, dropout per item, layer norm, timestep embedding."""
import functools
from collections.abc import Callable
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax import lax

from motion_jax.nets.partitioning import Axes, partitioned
from motion_jax.shapes import Array, Float, Int, Num


@functools.partial(jax.custom_vjp, nondiff_argnums=(2, 3))
def dot_general(x: Array, kernel: Array, dimension_numbers: Any, precision: Any = None) -> Array:
  """`lax.dot_general` of x (..., D) and a kernel (D, E), with a gradient that is faster on CPU.

  It has the signature that `nn.Dense` expects and the same output. JAX's gradient of the kernel is the transpose of a
  product of the output's gradient with x, which XLA computes on CPU at half the speed of a product of x with that
  gradient. Not under `jax.vmap`, which would compute a gradient of the kernel for each item and add them up.
  """
  return lax.dot_general(x, kernel, dimension_numbers, precision)


def _forward(x: Array, kernel: Array, dimension_numbers: Any, precision: Any) -> tuple[Array, tuple[Array, Array]]:
  return lax.dot_general(x, kernel, dimension_numbers, precision), (x, kernel)


def _backward(dimension_numbers: Any, precision: Any, residuals: tuple[Array, Array], grad: Array
              ) -> tuple[Array, Array]:
  x, kernel = residuals
  # Both with two axes: with more, XLA would transpose x into a copy, for which it recomputes x.
  rows = lambda array: array.reshape(-1, array.shape[-1])
  return (lax.dot_general(grad, kernel, (((grad.ndim - 1,), (1,)), ((), ())), precision),
          lax.dot_general(rows(x), rows(grad), (((0,), (0,)), ((), ())), precision))


dot_general.defvjp(_forward, _backward)


def Dense(features: int, axes: Axes = (None, None), kernel_init: Callable[..., Any] = nn.linear.default_kernel_init,
          bias_init: Callable[..., Any] = nn.initializers.zeros, **fields: Any) -> nn.Dense:
  """`nn.Dense` with the gradient of `dot_general`; axes: names of the kernel's two axes (`nets.partitioning`)."""
  return nn.Dense(features, kernel_init=partitioned(kernel_init, axes), bias_init=partitioned(bias_init, axes[1:]),
                  dot_general=dot_general, **fields)


def promote_to_f32(dtype: Any) -> Any:
  """The dtype for norms, angles and softmax: float64 if `dtype` is float64, else float32."""
  return jnp.promote_types(dtype, jnp.float32)


def layer_norm(eps: float, dtype: Any) -> nn.LayerNorm:
  """A layer norm without learned scale and bias, its variance computed in two passes as PyTorch does."""
  return nn.LayerNorm(epsilon=eps, use_scale=False, use_bias=False, dtype=dtype, use_fast_variance=False)


def timestep_embedding(t: Num[Array, "*lead"], count: int = 256) -> Float[Array, "*lead {count}"]:
  """Sinusoidal embedding of times t in [0, 1]: (...,) -> (..., count), cosines first, at count / 2 frequencies."""
  # Parity: the code embeds raw t, not t * 1000 as most diffusion transformers do.
  half = count // 2
  angles = t[..., None] * 10_000.0 ** (-jnp.arange(half, dtype=promote_to_f32(t.dtype)) / half)
  return jnp.concatenate([jnp.cos(angles), jnp.sin(angles)], axis=-1)


@functools.partial(jax.custom_vjp, nondiff_argnums=(1,))
def broadcast_to_length(x: Float[Array, "b m *lead d"], count: int) -> Float[Array, "b l *lead d"]:
  """Repeat each row `count` times: (B, M, ...) -> (B, M * count, ...).

  Its gradient is a sum of slices, which XLA computes on CPU many times faster than the reduction that is the gradient
  of `jnp.repeat`.
  """
  return jnp.repeat(x, count, axis=1)


broadcast_to_length.defvjp(lambda x, count: (broadcast_to_length(x, count), None),
              lambda count, _, grad: (sum(grad[:, i::count] for i in range(count)),))


class Dropout(nn.Module):
  """Dropout of x (B, ...) if `items` (B,), places of the rows in the whole batch, are given; else x unchanged.

  The mask of an item depends on its place and the "dropout" rng alone, so it is the same on any number of devices.
  """
  rate: float

  @nn.compact
  def __call__(self, x: Float[Array, "b *lead d"], items: Int[Array, " b"] | None = None
               ) -> Float[Array, "b *lead d"]:
    if items is None or not self.rate:
      return x
    rng, shape = self.make_rng("dropout"), x.shape[1:]
    count = functools.reduce(lambda a, b: a * b, shape)

    def of_item(item):  # 16 random bits per number, half of what a float would take
      bits = jax.random.bits(jax.random.fold_in(rng, item), (-(-count // 2),), jnp.uint32)
      return lax.bitcast_convert_type(bits, jnp.uint16).reshape(-1)[:count].reshape(shape)

    kept = jax.vmap(of_item)(items) >= round(self.rate * 2 ** 16)
    return jnp.where(kept, x / (1 - self.rate), jnp.zeros((), x.dtype))
