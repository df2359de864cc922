"""What a trainable part of a paper offers to the training loop: pure functions, no classes."""
from collections.abc import Callable
from typing import NamedTuple

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
  in_parts: the sums and weights of a batch's parts add up to those of the batch, as they do where items do not meet in
    the loss, so that a step may take one part after the other
  about_loss: what the printed loss measures and where it begins, one clause for the first lines of training
  """
  init: Callable
  loss: Callable
  predict: Callable
  init_extra: Callable | None = None
  in_parts: bool = False
  about_loss: str = ""
