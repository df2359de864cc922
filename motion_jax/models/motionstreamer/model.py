"""MotionStreamer ready to use: whole motions, prompts in sequence, continued motions, streams."""
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.latents import VaeCodec
from motion_jax.models.motionstreamer import sampling
from motion_jax.models.motionstreamer.options import MotionStreamerSampling
from motion_jax.models.motionstreamer.stages import END, frozen_shapes, generator_shapes, make_generator
from motion_jax.models.shared import round_trips
from motion_jax.models.shared.blocks import BlockModel, BlockState
from motion_jax.models.shared.captioned_batches import NO_CAPTION
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.runs import Run
from motion_jax.shapes import Array, Float, Num
from motion_jax.text.encoder import TextEncoder
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields


class Memory(NamedTuple):
  """The state between two latents: the running segment, None before its first latent; its prompts; the newest latents
  (B, n, C), at most as many as a segment has places for; the number of rows in the segment; the decoder's state."""
  segment: sampling.Segment | None
  prompts: tuple[str, ...]
  latents: Any
  rows: int
  decoder: Any


class MotionStreamerModel(BlockModel):
  """MotionStreamer ready to use. Each latent is a block: four frames.

  When the prompt changes, or when the places of a segment are full, a new segment begins after the newest half of the
  latents that a segment has places for.
  """
  abilities: tuple[str, ...] = (*BlockModel.abilities, "reconstruct")
  options = MotionStreamerSampling

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    config = run.config
    checkpoint.demand(config, run.folder, data__max_frames=(1, 100_000), data__max_words=(1, 10_000),
                      diffusion__num_steps=(1, 10_000), sampler__guidance_scale=(-1e3, 1e3))
    self.vae, self.net = CausalVAE(**module_fields(config.tokenizer)), make_generator(config.model)
    text_dim = self.net.transformer.text_dim
    super().__init__(run, encoder, text_dim, self.vae.frames_per_latent,
                     cache.kept_shapes("motionstreamer.frozen", (self.vae, text_dim),
                                       lambda: frozen_shapes(self.vae, text_dim)),
                     cache.kept_shapes("motionstreamer.generator", self.net, lambda: generator_shapes(self.net)))
    self.codec = VaeCodec.of(self.vae, self.frozen)
    self.block_frames = self.vae.frames_per_latent
    self.most_latents = self.net.transformer.max_length - 1  # that a segment has places for
    program = lambda name, fn, num_static: cache.Program(f"motionstreamer.{name}", fn, num_static, (self.net,))
    self._begin = program("begin", partial(_begin, self.net), 1)
    self._next = program("next", partial(_next, self.net), 1)
    self._encode, self._start = program("encode", VaeCodec.encode, 0), program("start", _decoder_of, 1)

  def plan_of(self, chosen: MotionStreamerSampling) -> sampling.Plan:
    return sampling.Plan(self.config.diffusion.num_steps, cast(int, chosen.num_steps), chosen.guidance_scale != 1.0,
                         cast(float, chosen.clip_latents))

  def begin_blocks(self, keys: jax.Array, past: Float[np.ndarray, "b t f"] | None = None) -> BlockState:
    """The state before the first latent; past: normalized features that it continues."""
    latents = np.zeros((len(keys), 0, self.vae.latent_dim), np.float32)
    decoder = self._start(len(keys), self.codec, jnp.zeros((len(keys), 1, self.vae.latent_dim)))[0]
    if past is not None:
      whole = past.shape[1] // self.block_frames * self.block_frames
      latents = np.asarray(self._encode(self.codec, jnp.asarray(past[:, past.shape[1] - whole:])))
      decoder = self._start(len(keys), self.codec, jnp.asarray(latents))[1]
    return BlockState(keys, 0, Memory(None, (), latents, 0, decoder))

  def make_block(self, state: BlockState, prompts: Sequence[str], chosen: MotionStreamerSampling
                 ) -> tuple[Float[np.ndarray, "b n f"], BlockState]:
    """(normalized features of the frames of the next latent, the state after it)."""
    memory, plan = state.memory, self.plan_of(chosen)
    if memory.segment is None or memory.prompts != tuple(prompts) or memory.rows > self.most_latents:
      memory = self._begun(memory, plan, tuple(prompts))
    segment, latent, features, decoder = self._next(
        plan, self.params, self.codec, memory.segment, chosen.guidance_scale, chosen.temperature, state.keys,
        state.blocks, memory.decoder)
    latents = np.concatenate([memory.latents, np.asarray(latent)[:, None]], axis=1)[:, -self.most_latents:]
    memory = Memory(segment, memory.prompts, latents, memory.rows + 1, decoder)
    return np.asarray(features), BlockState(state.keys, state.blocks + 1, memory)

  def _begun(self, memory, plan, prompts):
    """A segment of these prompts after the newest latents."""
    keep = min(memory.latents.shape[1], self.most_latents // 2)
    past = np.zeros((len(prompts), self.most_latents // 2, self.vae.latent_dim), np.float32)
    past[:, :keep] = memory.latents[:, memory.latents.shape[1] - keep:]
    text = self.encoder(prompts)[0][:, 0]
    segment = self._begin(plan, self.params, text, self.frozen[NO_CAPTION], past, keep)
    return memory._replace(segment=segment, prompts=prompts, rows=1 + keep)

  def cut(self, made: Float[np.ndarray, "b t f"], frames: Sequence[int], state: BlockState,
          chosen: MotionStreamerSampling) -> list[int]:
    """With ends "itself", the frames before the latent that ends a motion, at least one latent's."""
    if chosen.ends == "length":
      return list(frames)
    # The newest latents, as many as a segment has places for: an end before these has no meaning any more.
    latents = state.memory.latents
    first = state.blocks - latents.shape[1]
    near = np.linalg.norm(latents - np.asarray(self.frozen[END]), axis=-1) < chosen.stop_distance
    ends = [first + (int(np.flatnonzero(row)[0]) if row.any() else len(row)) for row in near]
    return [min(count, max(end, 1) * self.block_frames) for count, end in zip(frames, ends)]

  def reconstruct(self, features: Num[Array, "t f"]) -> Float[np.ndarray, "_ f"]:
    """Features (T, F) through the autoencoder and back, T cut to whole latents."""
    whole = len(features) // self.block_frames * self.block_frames
    x = self.stats.normalize(np.asarray(features))[None, :whole]
    return self.stats.denormalize(np.asarray(self.codec.reconstruct(jnp.asarray(x))))[0]


def _begin(net, plan, params, text_emb, no_text_emb, past, num_past):
  text_emb = jnp.asarray(text_emb)
  return sampling.begin(net, plan, params, text_emb, jnp.broadcast_to(no_text_emb, text_emb.shape), jnp.asarray(past),
                        num_past)


def _next(net, plan, params, codec, segment, scale, temperature, keys, count, decoder):
  """One latent, noise by a motion's key, the latent's number and the step alone, and its frames."""
  channels, fold = net.transformer.latent_dim, jax.random.fold_in
  draw = lambda m: jax.vmap(lambda key: jax.random.normal(fold(fold(key, count), m), (channels,)))(keys)
  latent = sampling.draw_latent(net, plan, params, segment, scale, draw, temperature)
  features, decoder = codec.decode_step(latent[:, None], decoder)
  return sampling.follow(net, plan, params, segment, latent), latent, features, decoder


def _decoder_of(batch, codec, latents):
  """The decoder's memory before any latent, or after these."""
  start = codec.init_decode_state(batch)
  return start, codec.decode_step(latents, start)[1]


MODELS = {"motionstreamer.generator": MotionStreamerModel}
TOKENIZERS = dict.fromkeys(("motionstreamer.tokenizer", "motionstreamer.generator"), round_trips.causal_vae)
