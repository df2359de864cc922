"""What a trainable part of a paper offers to the training loop: pure functions, no classes."""
from collections.abc import Callable
from typing import NamedTuple


class Stage(NamedTuple):
  """One trainable part of a paper.

  init(batch, rng) -> params
  loss(params, frozen, batch, step, rng) -> (sums, weight): a dict of sums with the key "loss", and what to divide them
    by, so that devices with unequal numbers of real frames add up to the same number as one device
  predict(params, frozen, batch, rng) -> arrays for the metrics
  """
  init: Callable
  loss: Callable
  predict: Callable
