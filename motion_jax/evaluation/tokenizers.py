"""Tokenizers of any run, alone or inside a generator's: motion to latents and back."""
import dataclasses
import pathlib
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax import runs
from motion_jax.latents import TOKENIZER
from motion_jax.models import registry
from motion_jax.models.abilities import Able
from motion_jax.motion.stats import Stats
from motion_jax.training import checkpoint
from motion_jax.utils.config_files import module_fields
from motion_jax.utils.errors import InputError


@dataclasses.dataclass(frozen=True, eq=False)
class Tokenizer(Able):
  """A tokenizer as an evaluation uses a model, without text. Created by `load_tokenizer`."""
  folder: pathlib.Path
  config: Any
  stats: Stats
  num_params: int
  params_file: str
  _run: Any
  abilities: ClassVar = ("round_trip",)

  def round_trip(self, x, num_frames, seeds=None):
    """Encodes and decodes normalized features x (B, T, F), padded with zeros. seeds (B,): of drawn latents; None takes
    their means.
    """
    keys = None if seeds is None else jnp.stack([jax.random.key(seed) for seed in seeds])
    return np.asarray(self._run(jnp.asarray(x), jnp.asarray(num_frames), keys))


def load_tokenizer(run, raw=False) -> Tokenizer:
  """The tokenizer of a run folder or of a shipped model. raw: the last weights, if the run is a tokenizer's own.

  Raises InputError for a run without a tokenizer.
  """
  known, run = registry.tokenizers(), runs.load_run(run, raw=raw)
  config, stage = run.config, run.stage
  if stage not in known:
    raise InputError(f"{run.folder} holds a {stage!r} run, which has no tokenizer; give the run of a tokenizer, such "
                     "as cmdm.tokenizer, or of a generator that was trained on one, such as momask.masked")
  inside = stage in runs.TOKENIZERS
  round_trip = known[stage](module_fields(config.tokenizer if inside else config.model), config)
  params = run.frozen({TOKENIZER: round_trip.shapes})[TOKENIZER] if inside else run.params(round_trip.shapes)
  params = jax.tree.map(jnp.asarray, params)
  run_it = jax.jit(round_trip.run)
  return Tokenizer(run.folder, config, run.stats, sum(leaf.size for leaf in jax.tree.leaves(params)),
                   checkpoint.FROZEN if inside else run.params_file, lambda *given: run_it(params, *given))
