"""Causal convolutions over time, with the state that lets them run on a stream.

A layer's whole memory is its left context, zeros at the start; `step` takes a chunk of frames and the context and
returns the output and the next context. A whole clip is one step from zeros, so streaming and offline cannot differ.
"""
import math
from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp


def uniform_fan_in(fan_in):
  """PyTorch's default for weights and biases: uniform in +-1/sqrt(fan_in)."""
  bound = 1 / math.sqrt(fan_in)
  return lambda key, shape, dtype=jnp.float32: jax.random.uniform(key, shape, dtype, -bound, bound)


class CausalConv(nn.Module):
  """1-D convolution over time padded on the left only: x (B, T, in_features) -> (B, T // stride, features)."""
  in_features: int
  features: int
  kernel: int = 3
  stride: int = 1
  dilation: int = 1
  dtype: Any = jnp.float32

  @property
  def context(self) -> int:
    """Frames of the past that an output needs (facts: cmdm 2.1)."""
    return (self.kernel - 1) * self.dilation + 1 - self.stride

  def init_context(self, batch):
    return jnp.zeros((batch, self.context, self.in_features), self.dtype)

  @nn.compact
  def step(self, x, context):
    """x (B, n, in), n a multiple of the stride unless the stream ends here -> (y (B, n // stride, out), context)."""
    init = uniform_fan_in(self.in_features * self.kernel)
    x = jnp.concatenate([context, x.astype(self.dtype)], axis=1)
    y = nn.Conv(self.features, (self.kernel,), strides=(self.stride,), kernel_dilation=(self.dilation,),
                padding="VALID", kernel_init=init, bias_init=init, dtype=self.dtype, name="conv")(x)
    return y, x[:, x.shape[1] - self.context:]

  def __call__(self, x):
    return self.step(x, self.init_context(x.shape[0]))[0]


class ResBlock(nn.Module):
  """x + pointwise(relu(causal_conv_dilated(relu(x)))): (B, T, width) -> (B, T, width)."""
  width: int
  dilation: int
  dtype: Any = jnp.float32

  def setup(self):
    init = uniform_fan_in(self.width)
    self.conv = CausalConv(self.width, self.width, 3, dilation=self.dilation, dtype=self.dtype)
    self.pointwise = nn.Dense(self.width, kernel_init=init, bias_init=init, dtype=self.dtype)

  def init_context(self, batch):
    return self.conv.init_context(batch)

  def step(self, x, context):
    y, context = self.conv.step(nn.relu(x), context)
    return x + self.pointwise(nn.relu(y)), context

  def __call__(self, x):
    return self.step(x, self.init_context(x.shape[0]))[0]


def relu_step(x, context):
  return nn.relu(x), context


def upsample_step(x, context):
  """Every frame twice."""
  return jnp.repeat(x, 2, axis=1), context


def run_layers(layers, x, contexts):
  """Runs (x, context) steps one after the other; plain functions carry no context, so theirs is None."""
  after = []
  for layer, context in zip(layers, contexts, strict=True):
    x, context = (layer.step if hasattr(layer, "step") else layer)(x, context)
    after.append(context)
  return x, tuple(after)


def init_contexts(layers, batch):
  return tuple(layer.init_context(batch) if hasattr(layer, "init_context") else None for layer in layers)
