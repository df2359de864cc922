"""A run folder, or the name of a model that ships, becomes a model that makes motion: `motion_jax.load`."""
from motion_jax import runs
from motion_jax.models.base import Prompted
from motion_jax.models.cdamd.model import CdamdModel
from motion_jax.models.cmdm.model import Model
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint

MODELS = {"cmdm.denoiser": Model, "cdamd.generator": CdamdModel}


def load(name="cmdm-small", text=None, raw=False) -> Prompted:
  """A run folder of a denoiser or generator, or the name of a model that ships.

  text: another folder of the encoder. raw: the last weights of a run, not the average that it kept beside them.
  """
  run = runs.open(name, tuple(MODELS), raw)
  with checkpoint.building(run.folder):
    frozen = run.config.frozen
    return MODELS[run.stage](run, load_text_encoder(text or frozen.text, level=frozen.text_level))
