"""The interface of a trainable part of a paper to the training loop: pure functions, no classes."""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from motion_jax.nets.layers import promote_to_f32

DEVICES = "devices"  # the axis over which the loop maps a loss; what must agree on all devices is summed over it


class Stage(NamedTuple):
  """One trainable part of a paper.

  init(batch, rng) -> params
  loss(params, frozen, batch, step, rng) -> (sums, weight): a dict of sums with the key "loss", and what to divide them
    by, so that devices with unequal numbers of real frames add up to the same number as one device
  predict(params, frozen, batch, rng) -> arrays for the metrics
  init_extra(batch, rng) -> dict of what else training changes, without a gradient: codebooks. Then the loss is
    loss(params, frozen, batch, step, rng, extra) -> (sums, weight, extra), with the same extra on all devices, and what
    is saved, evaluated and predicted with is params and extra in one dict
  in_parts: whether sums and weights of a batch's parts add up to those of the batch, because items do not interact in
    the loss, so that a step may compute one part after the other
  about_loss: a clause for the first lines of training on what the printed loss measures and where it begins
  """
  init: Callable
  loss: Callable
  predict: Callable
  init_extra: Callable | None = None
  in_parts: bool = False
  about_loss: str = ""


def mixed_precision(net: Any, config: Any) -> Any:
  """A network that computes in config.train.dtype and returns float32, for a stage's loss; float32: the network itself.

  Parameters stay float32, and modules compute norms and softmax in float32 (style guide).
  """
  dtype = jnp.dtype(config.train.dtype)
  return net if dtype == jnp.float32 else _Mixed(net.clone(dtype=dtype))


class _Mixed:
  """A module whose `apply` returns at least float32; everything else is the module's own."""

  def __init__(self, net):
    self._net = net

  def apply(self, *args, **named):
    return jax.tree.map(lambda a: a.astype(promote_to_f32(a.dtype)), self._net.apply(*args, **named))

  def __getattr__(self, name):
    return getattr(self._net, name)
