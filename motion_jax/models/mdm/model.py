"""MDM and DiP ready to use."""
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.mdm import editing, sampling
from motion_jax.models.mdm.goals import Stand, goals_of_block
from motion_jax.models.mdm.options import MdmSampling
from motion_jax.models.mdm.setup import NUM_PREFIXES, PREFIXES
from motion_jax.models.mdm.stages import denoiser_shapes, no_goals, reads_stats
from motion_jax.models.shared.blocks import BlockModel, BlockState
from motion_jax.models.shared.editing import EditingModel
from motion_jax.models.shared.motion_errors import STATS
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.motion_denoiser import MotionDenoiser
from motion_jax.runs import Run
from motion_jax.shapes import Bool, Float
from motion_jax.text.encoder import TextEncoder
from motion_jax.text.padding import narrowest
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields


class MdmNetwork(TextToMotionModel):
  """A trained denoiser with its text encoder."""
  options = MdmSampling

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    config = run.config
    checkpoint.demand(config, run.folder, data__max_frames=(1, 100_000), data__max_words=(1, 10_000),
                      diffusion__num_steps=(1, 100_000), sampler__guidance_scale=(-1e3, 1e3))
    self.net = MotionDenoiser(**module_fields(config.model))
    numbers = jax.ShapeDtypeStruct((self.net.features,), jnp.float32)
    frozen: dict[str, Any] = {}
    if reads_stats(config):
      frozen[STATS] = {"mean": numbers, "std": numbers}
    if config.diffusion.context:
      frozen[PREFIXES] = jax.ShapeDtypeStruct((NUM_PREFIXES, config.diffusion.context, self.net.features), jnp.float32)
    super().__init__(run, encoder, self.net.text_dim, 1, frozen,
                     cache.kept_shapes("mdm.denoiser", self.net, lambda: denoiser_shapes(self.net)))

  def encode_words(self, prompts: Sequence[str]) -> tuple[Float[np.ndarray, "b s e"], Bool[np.ndarray, "b s"]]:
    """(text_emb, text_mask) of prompts, padded to one of a few widths."""
    return self.encoder(prompts, at_least=narrowest(self.config.data.max_words))

  def plan_of(self, chosen: MdmSampling) -> sampling.Plan:
    return sampling.Plan(self.config.diffusion.num_steps, cast(int, chosen.num_steps), cast(str, chosen.solver),
                         chosen.guidance_scale != 1.0, self.config.diffusion.schedule)


class MdmModel(EditingModel, MdmNetwork):
  """MDM ready to use: prompts in, motion out; a motion in, the same one with new frames, or new arms in them, out.

  All motions are sampled at the length of training, and cut.
  """
  abilities = ("generate", "edit")

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    super().__init__(run, encoder)
    self.max_seconds = run.config.data.max_frames / self.stats.layout.fps
    self._generate = cache.Program("mdm.generate", partial(_generate, self.net), 2, (self.net,))

  def sampled_features(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, chosen: MdmSampling
                       ) -> tuple[Any, Sequence[int]]:
    """(normalized features (B, max_frames, F), frames as given) of prompts."""
    return self._sampled(prompts, frames, keys, chosen), frames

  def _sampled(self, prompts, frames, keys, chosen, known=None, known_mask=None):
    """Normalized features (B, max_frames, F)."""
    length = self.config.data.max_frames
    real = padding_mask(jnp.asarray(frames), length) if self.config.loss.mask_frames else None
    text_emb, text_mask = self.encode_words(prompts)
    return self._generate(self.plan_of(chosen), length, self.params, text_emb, text_mask, real, chosen.guidance_scale,
                          keys, known, known_mask)

  def inpainted(self, features: Sequence[Float[np.ndarray, "_ f"]], new: Sequence[Bool[np.ndarray, " _"]],
                prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any]
                ) -> tuple[Float[np.ndarray, "b t f"], dict[str, Any]]:
    """The paper's editing: given frames are painted over what the network predicts. Option part "upper_body" or
    "lower_body": the other joints are given in the new frames, too. Returns (normalized features (B, T, F), record of
    the sampling)."""
    chosen = self.sampling(**sampling)
    known = np.zeros((len(features), self.config.data.max_frames, self.net.features), np.float32)
    mask = np.ones(known.shape, bool)  # Parity: what lies after the end of a motion counts as given, as zeros.
    for row, kept, x, flags in zip(known, mask, features, new):
      row[:len(x)] = self.stats.normalize(np.asarray(x))
      kept[:len(x)] = ~flags[:, None]
      if chosen.part != "body":
        kept[:len(x)] |= editing.kept_columns(self.stats.layout, chosen.part)
    frames = [len(x) for x in features]
    sampled = np.asarray(self._sampled(prompts, frames, keys, chosen, known, mask))
    return sampled, self.record_of(chosen)


class Memory(NamedTuple):
  """State of DiP between blocks: the last normalized frames, where motions stand, and the constraints that set their
  goals."""
  prefix: Float[Any, "b p f"]
  stand: Stand
  signal: ControlSignal | None = None


class DipModel(BlockModel, MdmNetwork):
  """DiP ready to use: motion block after block, each from the frames before it, with prompts that may change.

  A network with goals follows constraints: those of a block become its goals (`goals.goals_of_block`).
  """
  abilities = ("generate", "sample_segments", "stream", "multi_prompt", "extend")

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    super().__init__(run, encoder)
    self.context = run.config.diffusion.context
    self.block_frames = run.config.data.max_frames - self.context
    self.takes_control = bool(self.net.num_goals)
    self._block = cache.Program("mdm.block", partial(_block, self.net), 2, (self.net,))

  def begin_blocks(self, keys: jax.Array, past: Float[np.ndarray, "b t f"] | None = None) -> BlockState:
    """The state before the first block; past: normalized features that it continues, else the beginning of a training
    motion, drawn by the key."""
    if past is None:
      chosen = jax.vmap(lambda key: jax.random.randint(jax.random.fold_in(key, 2**31 - 1), (), 0, NUM_PREFIXES))(keys)
      prefix = self.frozen[PREFIXES][chosen]
    else:  # a shorter past stands still before it begins
      missing = max(self.context - past.shape[1], 0)
      prefix = jnp.asarray(np.concatenate([np.repeat(past[:, :1], missing, axis=1), past], axis=1)[:, -self.context:])
    return BlockState(keys, 0, Memory(prefix, Stand.beginning(len(prefix))))

  def constrained(self, state: BlockState, signal: ControlSignal | None) -> BlockState:
    """The state with these constraints from now on. Raises InputError for a network without goals."""
    if not self.takes_control:
      return super().constrained(state, signal)
    return state._replace(memory=state.memory._replace(signal=signal))

  def make_block(self, state: BlockState, prompts: Sequence[str], chosen: MdmSampling
                 ) -> tuple[Float[np.ndarray, "b n f"], BlockState]:
    """(normalized features of the next block, the state after it)."""
    text_emb, text_mask = self.encode_words(prompts)
    prefix, stand, signal = state.memory
    goals, layout = no_goals(self.net, len(prefix)), self.stats.layout
    if signal is not None:
      goals = goals_of_block(signal, state.blocks * self.block_frames, self.block_frames, stand, layout)
    block, prefix = self._block(self.plan_of(chosen), self.block_frames, self.params, prefix, text_emb, text_mask,
                                chosen.guidance_scale, state.keys, state.blocks, goals)
    block = np.asarray(block)
    if self.takes_control:
      stand = stand.after(self.stats.denormalize(block), layout)
    return block, BlockState(state.keys, state.blocks + 1, Memory(prefix, stand, signal))


def _noise(keys, shape):
  """draw(m) (B, *shape): it depends on a motion's key and the step alone."""
  return lambda m: jax.vmap(lambda key: jax.random.normal(jax.random.fold_in(key, m), shape))(keys)


def _generate(net, plan, length, params, text_emb, text_mask, frame_mask, scale, keys, known, known_mask):
  condition = sampling.Condition(jnp.asarray(text_emb), jnp.asarray(text_mask), frame_mask)
  return sampling.denoise(net, plan, params, condition, scale, _noise(keys, (length, net.features)), known, known_mask)


def _block(net, plan, length, params, prefix, text_emb, text_mask, scale, keys, count, goals):
  keys = jax.vmap(lambda key: jax.random.fold_in(key, count))(keys)
  real = jnp.ones((len(prefix), length), bool)
  condition = sampling.Condition(jnp.asarray(text_emb), jnp.asarray(text_mask), real, prefix, goals)
  return sampling.next_block(net, plan, params, condition, scale, _noise(keys, (length, net.features)))


MODELS = {"mdm.denoiser": MdmModel, "mdm.dip": DipModel}
