"""T2M-GPT ready to use: motion from prompts, of a length of its own or of one that is given."""
from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.latents import TOKENIZER, RvqCodec
from motion_jax.models.base import Frames, TextToMotionModel
from motion_jax.models.shared import round_trips
from motion_jax.models.shared.autoencoders import autoencoder_shapes
from motion_jax.models.t2m_gpt import sampling as sampler
from motion_jax.models.t2m_gpt.options import T2mGptSampling
from motion_jax.models.t2m_gpt.stages import gpt_shapes
from motion_jax.motion.representations import get_layout
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.token_gpt import CodeGPT
from motion_jax.runs import Run
from motion_jax.text.encoder import TextEncoder
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields

_OWN = 0  # in the place of a number of frames: the end code decides


class T2mGptModel(TextToMotionModel):
  """T2M-GPT ready to use. Without a length a motion ends where the model ends it; with one, the end is put off."""
  options = T2mGptSampling

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    config = run.config
    checkpoint.demand(config, run.folder, data__max_frames=(1, 100_000))
    tokenizer, self.net = Autoencoder(**module_fields(config.tokenizer)), CodeGPT(**module_fields(config.model))
    shapes = {TOKENIZER: autoencoder_shapes(tokenizer, config.quantizer)}
    super().__init__(run, encoder, self.net.text_dim, tokenizer.frames_per_latent, shapes, gpt_shapes(self.net))
    self.codec = RvqCodec(tokenizer, self.frozen[TOKENIZER])
    self.max_seconds = (self.net.max_length - 1) * self.frames_per_latent / get_layout(
        config.data.layout).skeleton.fps
    self._generate = cache.Program("t2m_gpt.generate", partial(_generate, self.net, tokenizer), 1,
                                   (self.net, tokenizer))

  def frames_of(self, prompts: Sequence[str], num_frames: Frames, seconds: Frames) -> list[int]:
    """Lengths as given; 0 for each prompt where none is: the end code decides."""
    if num_frames is None and seconds is None:
      return [_OWN] * len(prompts)
    return super().frames_of(prompts, num_frames, seconds)

  def sampled_features(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, chosen: T2mGptSampling
                       ) -> tuple[Any, Sequence[int]]:
    """(normalized features (B, T, F), frames of each motion) of prompts; lengths are cut to whole codes (4 frames)."""
    unit = self.frames_per_latent
    counts = np.array(frames) // unit
    fewest = np.where(counts > 0, counts, 1)
    most = np.where(counts > 0, counts, self.net.max_length - 1)
    rows, num_codes = self._generate(chosen.draw, self.params, self.codec.params, self.encoder(prompts)[0][:, 0], keys,
                                     jnp.asarray(fewest), jnp.asarray(most), jnp.float32(chosen.temperature))
    return rows, [int(count) * unit for count in np.asarray(num_codes)]


MODELS = {"t2m_gpt.gpt": T2mGptModel}
TOKENIZERS = dict.fromkeys(("t2m_gpt.vq", "t2m_gpt.gpt"), round_trips.rvq)


def _generate(net, tokenizer, draw, params, codec, text_emb, keys, fewest, most, temperature):
  """(normalized features (B, 4 n, F), numbers of codes (B,)) of captions; each clip is decoded as if alone."""
  choose = sampler.greedy if draw == "greedy" else sampler.categorical(keys, temperature)
  codes = sampler.sample(net, params, text_emb, choose, fewest, most)
  real = codes >= 0
  # Parity: the reference decodes a batch as one long sequence.
  features = RvqCodec(tokenizer.clone(hide_padding=True), codec).decode(codes[..., None], real_mask=real)
  return features, real.sum(-1)
