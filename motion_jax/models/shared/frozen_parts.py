"""Tokenizers of other runs as frozen parts of a generator: their parameters, checked against the generator's config."""
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ml_collections import ConfigDict

from motion_jax import runs
from motion_jax.data import sources
from motion_jax.motion.stats import Stats, load_stats
from motion_jax.training.setup import demand_same_network, untrained
from motion_jax.utils.config_files import module_fields


class Part(NamedTuple):
  """A frozen network: its module, its parameters and the statistics of its data. generator: the run, where the part
  comes from a generator's, whose frozen parts hold more than the parameters."""
  net: Any
  params: Any
  stats: Stats
  generator: runs.Run | None = None


def load_part(folder: str, config: ConfigDict, module: Callable[..., Any], shapes_of: Callable[[Any], Any],
              stages: Sequence[str], what: str = "the tokenizer", **unlike: Any) -> Part:
  """The network of config.tokenizer from a run folder of one of the stages: its own one first, then generators that
  hold it. "random-init" makes an untrained one for trying things out.

  shapes_of(net): shapes of its parameters; unlike: fields that may differ, see `demand_same_network`. Raises InputError
  for a run of another network.
  """
  net = module(**module_fields(config.tokenizer))
  if folder == "random-init":
    return Part(net, untrained(shapes_of(net)), sources.load_features(config.data).stats)
  run = runs.load_run(folder, tuple(stages) if len(stages) > 1 else stages[0])
  is_generator = run.stage != stages[0]
  fields = run.config.tokenizer if is_generator else run.config.model
  demand_same_network(f"{what} in {folder}", module(**module_fields(fields)), net, **unlike)
  stats = load_stats(run.folder, config.data.layout)
  return Part(net, None, stats, run) if is_generator else Part(net, run.params(shapes_of(net)), stats)
