"""A run folder, or the name of a model that ships, becomes a model that makes motion: `motion_jax.load`."""
import os

from motion_jax import runs
from motion_jax.models import registry
from motion_jax.models.base import TextToMotionModel
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import shortened


def load(name: str | os.PathLike = "cmdm-small", text: str | os.PathLike | None = None, raw: bool = False
         ) -> TextToMotionModel:
  """A run folder of a denoiser or generator, or the name of a model that ships.

  text: another folder of the encoder. raw: the last weights of a run, not the average that it kept beside them.
  """
  stage = runs.stage_of(name)
  is_model = stage is not None and registry.model_of(stage) is not None  # imports no other method
  if hint := registry.missing(stage):
    raise InputError(f"{name} holds a run of the stage {shortened(repr(stage))}, expected one of a known method{hint}")
  run = runs.load_run(name, None if is_model else tuple(registry.model_stages()), raw)
  with checkpoint.building(run.folder):
    encoder = load_text_encoder(text or run.text, max_words=run.config.frozen.get("text_pieces") or None,
                                level=run.config.frozen.text_level)
    return registry.model_of(run.stage)(run, encoder)
