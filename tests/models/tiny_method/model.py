"""The tiny method ready to use."""
from functools import partial

import jax

from motion_jax.models.base import TextToMotionModel
from motion_jax.models.results import Motions, motions_of_prompts
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields
from tests.models.tiny_method.options import TinySampling
from tests.models.tiny_method.setup import Regressor, shapes


class TinyModel(TextToMotionModel):
  """Prompts in, motion out, and nothing else."""
  options = TinySampling

  def __init__(self, run, encoder):
    net = Regressor(**module_fields(run.config.model))
    super().__init__(run, encoder, net.text_dim, 1, {}, shapes(net))
    self.compiled = cache.Program("tiny.generate", partial(_generate, net), 1, (net,))

  def sample(self, prompts, frames, keys, seeds, cleanup, sampling, signal=None) -> Motions:
    """One pass: motions of prompts, a key each; sampling: choices of `TinySampling`."""
    chosen = self.sampling(**sampling)
    made = self.compiled(max(frames), self.params, self.encoder(prompts)[0], chosen.guidance_scale, chosen.spread, keys)
    return motions_of_prompts(self, made, prompts, frames, seeds, chosen.about() | dict(model=self.id), cleanup)


def _generate(net, num_frames, params, words, scale, spread, keys):
  told, untold = (net.apply(params, text, num_frames) for text in (words, 0 * words))
  noise = jax.vmap(lambda key: jax.random.normal(key, told.shape[1:]))(keys)
  return untold + scale * (told - untold) + spread * noise


MODELS = {"tiny.regressor": TinyModel}
