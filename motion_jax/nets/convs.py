"""Convolutions over time and stacks of them that halve and double the frame rate.

Causal ones can run on a stream: a layer's whole state is its left context, zeros at the start; `step` takes a chunk of
frames and the context and returns the output and the next context. A whole clip is one step from zeros, so streaming
and offline results are the same. With causal=False the same zeros pad half before and half after the clip, which
cannot be streamed.
"""
import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
from jax import lax

from motion_jax.nets.layers import Dense, Dropout
from motion_jax.shapes import Array, Bool, Float, Int

Layer = Callable  # a module with a method `step` for streams, or a function (x, context) -> (x, context)
Contexts = tuple[Float[Array, "b _ _"] | None, ...]  # of a stack of layers; functions have none


def uniform_fan_in(fan_in: int) -> Callable[..., jax.Array]:
  """PyTorch's default for weights and biases: uniform in +-1/sqrt(fan_in)."""
  bound = 1 / math.sqrt(fan_in)
  return lambda key, shape, dtype=jnp.float32: jax.random.uniform(key, shape, dtype, -bound, bound)


@functools.partial(jax.custom_vjp, nondiff_argnums=range(2, 9))
def conv(x: Float[Array, "b t c"], kernel: Float[Array, "k c d"], strides: Sequence[int], padding: Any,
         lhs_dilation: Any, rhs_dilation: Sequence[int], dimension_numbers: Any, feature_group_count: int = 1,
         precision: Any = None) -> Float[Array, "b n d"]:
  """`lax.conv_general_dilated` of x (B, T, C) and a kernel (K, C, D) without padding, with a gradient of its own.

  It has the signature that `nn.Conv` expects and the same output. The gradient of x is a matrix product whose parts are
  shifted and added. On CPU, XLA compiles it in half the time of the convolution that is JAX's gradient, and runs it
  faster.
  """
  return lax.conv_general_dilated(jnp.asarray(x), jnp.asarray(kernel), strides, padding, lhs_dilation, rhs_dilation,
                                  dimension_numbers, feature_group_count, precision=precision)


def _conv_forward(x: Array, kernel: Array, *choices: Any) -> tuple[Array, tuple[Array, Array]]:
  return conv(x, kernel, *choices), (x, kernel)


def _conv_backward(strides: Sequence[int], padding: Any, lhs_dilation: Any, rhs_dilation: Sequence[int],
                   dimension_numbers: Any, feature_group_count: int, precision: Any, residuals: tuple[Array, Array],
                   grad: Array) -> tuple[Array, Array]:
  x, kernel = residuals
  size, length = kernel.shape[0], x.shape[1]
  reach = (grad.shape[1] - 1) * strides[0] + 1
  parts = lax.dot_general(grad, kernel, (((2,), (2,)), ((), ())), precision)  # (B, N, K, C)
  zero = jnp.zeros((), parts.dtype)
  shifted = [lax.pad(parts[:, :, k], zero, ((0, 0, 0), (k * rhs_dilation[0], length - reach - k * rhs_dilation[0],
                                                        strides[0] - 1), (0, 0, 0))) for k in range(size)]
  of_kernel = jax.vjp(lambda kernel: lax.conv_general_dilated(
      jnp.asarray(x), kernel, strides, padding, lhs_dilation, rhs_dilation, dimension_numbers, feature_group_count,
      precision=precision), kernel)[1]
  return sum(shifted[1:], shifted[0]), *of_kernel(grad)


conv.defvjp(_conv_forward, _conv_backward)


class CausalConv(nn.Module):
  """1-D convolution over time padded on the left only: x (B, T, in_features) -> (B, T // stride, features).

  causal=False pads both sides alike, which needs an even `context`: kernel 3, or kernel 4 with stride 2.
  """
  in_features: int
  features: int
  kernel: int = 3
  stride: int = 1
  dilation: int = 1
  dtype: Any = jnp.float32
  causal: bool = True

  @property
  def context(self) -> int:
    """How many earlier frames an output depends on (docs/papers/cmdm.md#tokenizer)."""
    return (self.kernel - 1) * self.dilation + 1 - self.stride

  def init_context(self, batch: int) -> Float[Array, "{batch} context c"]:
    return jnp.zeros((batch, self.context, self.in_features), self.dtype)

  @nn.compact
  def step(self, x: Float[Array, "b n c"], context: Float[Array, "b p c"]
           ) -> tuple[Float[Array, "b m d"], Float[Array, "b _ c"]]:
    """x (B, n, in), n a multiple of the stride unless the stream ends here -> (y (B, n // stride, out), context)."""
    init = uniform_fan_in(self.in_features * self.kernel)
    x = jnp.concatenate([context, x.astype(self.dtype)], axis=1)
    y = nn.Conv(self.features, (self.kernel,), strides=(self.stride,), kernel_dilation=(self.dilation,),
                padding="VALID", kernel_init=init, bias_init=init, dtype=self.dtype,
                conv_general_dilated=conv, name="conv")(x)
    return y, x[:, x.shape[1] - self.context:]

  def __call__(self, x: Float[Array, "b t c"]) -> Float[Array, "b n d"]:
    context = self.init_context(x.shape[0])
    if not self.causal:
      context, after = jnp.split(context, 2, axis=1)
      x = jnp.concatenate([x.astype(self.dtype), after], axis=1)
    return self.step(x, context)[0]


class ResBlock(nn.Module):
  """x + dropout(pointwise(relu(conv_dilated(relu(x))))): (B, T, width) -> (B, T, width)."""
  width: int
  dilation: int
  dtype: Any = jnp.float32
  causal: bool = True
  dropout: float = 0.0

  def setup(self) -> None:
    init = uniform_fan_in(self.width)
    self.conv = CausalConv(self.width, self.width, 3, dilation=self.dilation, dtype=self.dtype, causal=self.causal)
    self.pointwise = Dense(self.width, kernel_init=init, bias_init=init, dtype=self.dtype)
    self.drop = Dropout(self.dropout)

  def init_context(self, batch: int) -> Float[Array, "{batch} context c"]:
    return self.conv.init_context(batch)

  def step(self, x: Float[Array, "b n d"], context: Float[Array, "b p d"]
           ) -> tuple[Float[Array, "b n d"], Float[Array, "b p d"]]:
    y, context = self.conv.step(nn.relu(x), context)
    return x + self.pointwise(nn.relu(y)), context

  def __call__(self, x: Float[Array, "b t d"], items: Int[Array, " b"] | None = None) -> Float[Array, "b t d"]:
    y = self.pointwise(nn.relu(self.conv(nn.relu(x))))
    return x + self.drop(y, items)


def relu_step(x: Float[Array, "b n d"], context: None) -> tuple[Float[Array, "b n d"], None]:
  return nn.relu(x), context


def upsample_step(x: Float[Array, "b n d"], context: None) -> tuple[Float[Array, "b 2*n d"], None]:
  """Every frame twice."""
  return jnp.repeat(x, 2, axis=1), context


def apply_layers(layers: Sequence[Layer], x: Float[Array, "b t c"], items: Int[Array, " b"] | None = None,
                 real_mask: Bool[Array, "b t"] | None = None) -> Float[Array, "b n d"]:
  """Runs a whole clip through layers, causal or not.

  real_mask (B, T), True for the first frames of each clip: the others are set to zero before every layer, as if the
  clip ended there, so padding changes nothing.
  """
  x = zero_padding(x, real_mask)
  for layer in layers:
    if isinstance(layer, ResBlock):
      x = layer(x, items)
    else:
      x = layer(x) if isinstance(layer, nn.Module) else layer(x, None)[0]
    if real_mask is not None:
      real_mask = at_rate(real_mask, x.shape[1])
      x = zero_padding(x, real_mask)
  return x


def zero_padding(x: Float[Array, "b t c"], real_mask: Bool[Array, "b t"] | None) -> Float[Array, "b t c"]:
  return x if real_mask is None else jnp.where(real_mask[..., None], x, 0)


def at_rate(real_mask: Bool[Array, "b t"], length: int) -> Bool[Array, "b {length}"]:
  """The mask (B, T) of a layer's input, at the rate of its output: (B, length), the same, half or double."""
  if length > real_mask.shape[1]:
    return jnp.repeat(real_mask, 2, axis=1)
  return real_mask if length == real_mask.shape[1] else real_mask[:, 1::2]  # half a pair makes no frame


def run_layers(layers: Sequence[Layer], x: Float[Array, "b n c"], contexts: Contexts
               ) -> tuple[Float[Array, "b m d"], Contexts]:
  """Runs the steps of layers in sequence -> (x, contexts); plain functions have no context, so theirs is None."""
  after = []
  for layer, context in zip(layers, contexts, strict=True):
    x, context = (layer.step if hasattr(layer, "step") else layer)(x, context)
    after.append(context)
  return x, tuple(after)


def init_contexts(layers: Sequence[Layer], batch: int) -> Contexts:
  return tuple(layer.init_context(batch) if hasattr(layer, "init_context") else None for layer in layers)


def res_stack(width: int, dilations: Sequence[int], name: str, dtype: Any = jnp.float32, causal: bool = True,
              dropout: float = 0.0) -> list[Layer]:
  return [ResBlock(width, dilation, dtype, causal, dropout, name=f"{name}_block{b}")
          for b, dilation in enumerate(dilations)]


def halving_layers(features: int, width: int, out: int, num_halvings: int, dilations: Sequence[int],
                   dtype: Any = jnp.float32, causal: bool = True, dropout: float = 0.0) -> list[Layer]:
  """Layers of an encoder, created in a module's setup: (B, T, features) -> (B, T // 2**num_halvings, out)."""
  conv: dict[str, Any] = dict(dtype=dtype, causal=causal)
  layers: list[Layer] = [CausalConv(features, width, 3, **conv, name="conv_in"), relu_step]
  for i in range(num_halvings):
    layers += [CausalConv(width, width, 4, stride=2, **conv, name=f"down{i}")]
    layers += res_stack(width, dilations, f"stack{i}", **conv, dropout=dropout)
  return layers + [CausalConv(width, out, 3, **conv, name="conv_out")]


def doubling_layers(features: int, width: int, out: int, num_halvings: int, dilations: Sequence[int],
                    dtype: Any = jnp.float32, causal: bool = True, dropout: float = 0.0) -> list[Layer]:
  """Layers of a decoder, created in a module's setup: (B, N, features) -> (B, 2**num_halvings N, out)."""
  conv: dict[str, Any] = dict(dtype=dtype, causal=causal)
  layers: list[Layer] = [CausalConv(features, width, 3, **conv, name="conv_in"), relu_step]
  for i in range(num_halvings):
    layers += res_stack(width, dilations, f"stack{i}", **conv, dropout=dropout)
    layers += [upsample_step, CausalConv(width, width, 3, **conv, name=f"up{i}")]
  return layers + [CausalConv(width, width, 3, **conv, name="conv_mid"), relu_step,
                   CausalConv(width, out, 3, **conv, name="conv_out")]
