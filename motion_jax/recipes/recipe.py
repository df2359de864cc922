"""What the loop needs to train a stage, made from a config: the stage, its batches, its frozen parts."""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np

from motion_jax.motion.stats import Stats
from motion_jax.stage import Stage


class Recipe(NamedTuple):
  """A stage with all that it is trained on.

  next_batch(step) -> dict of arrays; frozen: arrays that the loss reads and nobody changes; evaluate(params) -> dict of
  numbers, or None; stats of the features; files: {name: text or bytes} that the run folder keeps.
  """
  stage: Stage
  next_batch: Callable
  frozen: Any
  evaluate: Callable | None
  stats: Stats
  files: dict[str, str | bytes]


def untrained(shapes, seed=0):
  """Random parameters of these shapes, for trying things out: products keep their size, nothing is compiled."""
  draw = np.random.default_rng(seed)

  def fill(path, leaf):
    name = path[-1].key
    if len(leaf.shape) < 2:
      return np.full(leaf.shape, float(name == "scale"), np.float32)
    fan_in = max(int(np.prod(leaf.shape[:-1])), 1)
    return draw.standard_normal(leaf.shape, np.float32) / np.sqrt(np.float32(fan_in))

  return jax.tree_util.tree_map_with_path(fill, shapes)


def plain(value):
  if isinstance(value, dict):  # less what may change: where the data lies, and when a prolonged run cools down
    return {k: plain(v) for k, v in value.items() if k not in ("folder", "folders", "cooldown_steps")}
  return [plain(v) for v in value] if isinstance(value, list | tuple) else value
