"""What the loop needs to train a stage, made from a config: the stage, its batches, its frozen parts."""
from collections.abc import Callable
from typing import Any, NamedTuple

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


def plain(value):
  if isinstance(value, dict):  # less what may change: where the data lies, and when a prolonged run cools down
    return {k: plain(v) for k, v in value.items() if k not in ("folder", "folders", "cooldown_steps")}
  return [plain(v) for v in value] if isinstance(value, list | tuple) else value
