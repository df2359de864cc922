"""MDM and DiP ready to use."""
from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from motion_jax.control.signal import ControlSignal
from motion_jax.data.clip import Clip
from motion_jax.models import arguments, pasting
from motion_jax.models.base import TextToMotionModel, keys_of
from motion_jax.models.block_stream import BlockModel, BlockState
from motion_jax.models.known_motion import at_rate, clip_of
from motion_jax.models.mdm import editing, sampling
from motion_jax.models.mdm.options import MdmSampling
from motion_jax.models.mdm.setup import NUM_PREFIXES, PREFIXES
from motion_jax.models.mdm.stages import denoiser_shapes
from motion_jax.models.motion_errors import STATS
from motion_jax.models.results import Motion, Motions, captions_in_a_row, gathered, make_motions
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.motion_denoiser import MotionDenoiser
from motion_jax.runs import Run
from motion_jax.shapes import Array
from motion_jax.text.encoder import TextEncoder, narrowest
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields

Editable = Clip | Array  # a clip of any source, joints (T, J, 3), or features (T, F), not normalized


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
    if config.loss.positions or config.loss.contacts:
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
                         chosen.guidance_scale != 1.0)


class MdmModel(MdmNetwork):
  """MDM ready to use: prompts in, motion out; a motion in, the same one with new frames, or new arms in them, out.

  All motions are sampled at the length of training, and cut.
  """
  abilities = ("generate", "edit")

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    super().__init__(run, encoder)
    self.max_seconds = run.config.data.max_frames / self.stats.layout.fps
    self._generate = cache.Program("mdm.generate", partial(_generate, self.net), 2, (self.net,))

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: ControlSignal | None = None) -> Motions:
    """One pass: motions of prompts, a key each; sampling: choices of `MdmSampling`."""
    chosen = self.sampling(**sampling)
    made = self._sampled(prompts, frames, keys, chosen)
    captions = [captions_in_a_row([prompt], [count], self.fps) for prompt, count in zip(prompts, frames)]
    return make_motions(self, made, frames, captions, seeds, chosen.about() | dict(model=self.id), cleanup)

  def _sampled(self, prompts, frames, keys, chosen, known=None, known_mask=None):
    """Normalized features (B, max_frames, F)."""
    length = self.config.data.max_frames
    real = padding_mask(jnp.asarray(frames), length) if self.config.loss.mask_frames else None
    text_emb, text_mask = self.encode_words(prompts)
    return self._generate(self.plan_of(chosen), length, self.params, text_emb, text_mask, real, chosen.guidance_scale,
                          keys, known, known_mask)

  @arguments.checked
  def edit(self, clip: Editable, prompt: str, task: str | None = None, *, keep: pasting.Spans | None = None,
           change: pasting.Spans | None = None, rng: jax.Array | None = None, seed: int | None = None,
           seeds: Iterable[int] | None = None, cleanup: bool = False, **sampling: Any) -> Motion:
    """An existing motion with parts of it sampled from a prompt; see `edits`."""
    return self.edits([clip], [prompt], task, keep=keep, change=change, rng=rng, seeds=seeds, seed=seed,
                      cleanup=cleanup, **sampling)[0]

  @arguments.checked
  def edits(self, clips: Sequence[Editable], prompts: Sequence[str], task: str | None = None, *,
            keep: pasting.Spans | None = None, change: pasting.Spans | None = None, rng: jax.Array | None = None,
            seeds: Iterable[int] | None = None, seed: int | None = None, cleanup: bool = False, **sampling: Any
            ) -> Motions:
    """The paper's editing: frames are sampled while the others are painted over what the network predicts, and put back
    into their clips, all in one batch.

    clips: of any source, or arrays: joints (T, J, 3), or features (T, F) as this model knows them, not normalized.
    Which frames are new: a task of `utils.spans.TASKS`, or spans to keep or to change, [(0, 30), ...] in frames of this
    model, the same in every clip. part "upper_body" or "lower_body" generates these joints alone in the new frames.
    """
    prompts = self.prompts_of(prompts) if prompts else []
    if len(prompts) != len(clips) or not clips:
      raise ValueError(f"got {len(prompts)} prompts for {len(clips)} clips; give one for each")
    if sum(choice is not None for choice in (task, keep, change)) != 1:
      raise ValueError("say what to make by one of task, keep and change")
    keys, seeds = keys_of(rng, seeds, len(clips), seed)
    new = lambda count: pasting.requested_frames(count, task, keep, change)
    made = pasting.edited(self, clips, prompts, new, keys, seeds, cleanup, sampling, task or "spans")
    part = self.sampling(**sampling).part
    return made if part == "body" else gathered([self._with_kept_joints(*one, part) for one in zip(made, clips)])

  def _with_kept_joints(self, motion, clip, part):
    """The motion with the joints of the other part as the clip has them; borders were blended for whole bodies."""
    skeleton = self.stats.layout.skeleton
    own = at_rate(clip_of(clip, self.stats.layout), self.fps, skeleton)
    legs = sorted({0, *skeleton.chains[0], *skeleton.chains[1]})
    kept = legs if part == "upper_body" else [0, *(j for j in range(skeleton.num_joints) if j not in legs)]
    joints = np.array(motion.joints)
    joints[:, kept] = own[:, kept]
    return motion.replace(joints=joints)

  def inpaint(self, features: Sequence[Float[np.ndarray, "_ f"]], new: Sequence[Bool[np.ndarray, " _"]],
              prompts: Sequence[str], keys: jax.Array, sampling: dict[str, Any]
              ) -> tuple[list[Float[np.ndarray, "_ f"]], dict[str, Any]]:
    """(features (T, F) of each motion, not normalized, with the frames of new (T,) sampled, record of the sampling)."""
    chosen = self.sampling(**sampling)
    known = np.zeros((len(features), self.config.data.max_frames, self.net.features), np.float32)
    mask = np.ones(known.shape, bool)  # Parity: what lies behind the end of a motion counts as given, as zeros.
    for row, kept, x, flags in zip(known, mask, features, new):
      row[:len(x)] = self.stats.normalize(np.asarray(x))
      kept[:len(x)] = ~flags[:, None]
      if chosen.part != "body":
        kept[:len(x)] |= editing.kept_columns(self.stats.layout, chosen.part)
    frames = [len(x) for x in features]
    made = self.stats.denormalize(np.asarray(self._sampled(prompts, frames, keys, chosen, known, mask)))
    return [made[i, :count] for i, count in enumerate(frames)], chosen.about() | dict(model=self.id)


class DipModel(BlockModel, MdmNetwork):
  """DiP ready to use: motion block after block, each from the frames before it, with prompts that may change."""
  abilities = ("generate", "sample_segments", "stream", "multi_prompt", "extend")

  def __init__(self, run: Run, encoder: TextEncoder) -> None:
    super().__init__(run, encoder)
    self.context = run.config.diffusion.context
    self.block_frames = run.config.data.max_frames - self.context
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
    return BlockState(keys, 0, prefix)

  def make_block(self, state: BlockState, prompts: Sequence[str], chosen: MdmSampling
                 ) -> tuple[Float[np.ndarray, "b n f"], BlockState]:
    """(normalized features of the next block, the state behind it)."""
    text_emb, text_mask = self.encode_words(prompts)
    made, prefix = self._block(self.plan_of(chosen), self.block_frames, self.params, state.memory, text_emb, text_mask,
                               chosen.guidance_scale, state.keys, state.blocks)
    return np.asarray(made), BlockState(state.keys, state.blocks + 1, prefix)


def _noise(keys, shape):
  """draw(m) (B, *shape): it depends on a motion's key and the step alone."""
  return lambda m: jax.vmap(lambda key: jax.random.normal(jax.random.fold_in(key, m), shape))(keys)


def _generate(net, plan, length, params, text_emb, text_mask, frame_mask, scale, keys, known, known_mask):
  condition = sampling.Condition(jnp.asarray(text_emb), jnp.asarray(text_mask), frame_mask)
  return sampling.denoise(net, plan, params, condition, scale, _noise(keys, (length, net.features)), known, known_mask)


def _block(net, plan, length, params, prefix, text_emb, text_mask, scale, keys, count):
  keys = jax.vmap(lambda key: jax.random.fold_in(key, count))(keys)
  real = jnp.ones((len(prefix), length), bool)
  condition = sampling.Condition(jnp.asarray(text_emb), jnp.asarray(text_mask), real, prefix)
  made = sampling.denoise(net, plan, params, condition, scale, _noise(keys, (length, net.features)))
  return made, jnp.concatenate([prefix, made], axis=1)[:, -prefix.shape[1]:]


MODELS = {"mdm.denoiser": MdmModel, "mdm.dip": DipModel}
