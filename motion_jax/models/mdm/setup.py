"""The training set-up of MDM and DiP."""
from typing import Any

import numpy as np
from ml_collections import ConfigDict

from motion_jax.data import sources
from motion_jax.models.mdm.goals import GOALS
from motion_jax.models.mdm.stages import denoiser_stage, reads_stats
from motion_jax.models.shared.captioned_batches import denoising_setup, text_encoder
from motion_jax.models.shared.motion_errors import STATS
from motion_jax.training.setup import TrainingSetup
from motion_jax.utils.errors import InputError

NUM_PREFIXES, PREFIXES = 32, "prefixes"  # beginnings of training motions that a run of DiP keeps, to begin from


def denoiser(config: ConfigDict) -> TrainingSetup:
  data = sources.load_features(config.data)
  context = config.diffusion.context
  if context >= config.data.max_frames:
    raise InputError(f"got diffusion.context = {context} frames of data.max_frames = {config.data.max_frames}, "
                     "expected fewer")
  missing = {*GOALS[:6]} - {*data.stats.layout.skeleton.joints}
  if config.model.num_goals not in (0, len(GOALS)) or config.model.num_goals and missing:
    raise InputError(f"got model.num_goals = {config.model.num_goals} and data of the layout {data.stats.layout.name}, "
                     f"expected 0 or {len(GOALS)} goals, and for these a body with {', '.join(GOALS[:6])}")
  encoder = text_encoder(config, config.model.text_dim)
  frozen: dict[str, Any] = {}
  if reads_stats(config):
    frozen[STATS] = {"mean": data.stats.mean, "std": data.stats.std}
  if context:
    frozen[PREFIXES] = prefixes(data.features, context)
  return denoising_setup(config, denoiser_stage, data, encoder, frozen)


def prefixes(features: list[np.ndarray], context: int) -> np.ndarray:
  """(NUM_PREFIXES, context, F): how that many motions begin, the same ones again where there are fewer."""
  long = [x for x in features if len(x) >= context]
  chosen = np.linspace(0, len(long) - 1, NUM_PREFIXES).round().astype(int)
  return np.stack([long[i][:context] for i in chosen]).astype(np.float32)


SETUPS = {"mdm.denoiser": denoiser, "mdm.dip": denoiser}
