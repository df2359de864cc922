"""Frame-wise sampling from a loop on the host over one compiled step: motion of any length and kind by one program.

`streaming.Sampler.sample` is the same under `lax.scan`, for which every length and kind is a program of its own.
"""
import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.control.guidance import TOLERANCE
from motion_jax.control.signal import ControlSignal
from motion_jax.models.cmdm import streaming
from motion_jax.models.cmdm.guiding import Behind, Guide, variance_of
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.shared.moving_path import Path, continue_path, heading_of
from motion_jax.nets.causal_dit import Text
from motion_jax.shapes import Bool, Float, Int

_LENGTH = 50  # latents whose constraints are compiled together; longer ones by doubling


class SamplingLoop:
  """A batch of motions, one block longer with each `step`; captions and constraints are set in between.

    loop = SamplingLoop(model, plan, scale, keys)
    loop.say(text_emb, text_mask)
    while ...:
      block = loop.step(caption, since)      # (B, block, C), None while nothing is clean yet
      features = loop.decode(block)
  """

  def __init__(self, model: CmdmNetworks, plan: streaming.Plan, scale: Float[np.ndarray, " b"], keys: Any,
               lengths: Int[np.ndarray, " b"] | None = None) -> None:
    """scale (B,): of guidance; keys (B,), or their data (B, 2): one per motion. lengths (B,): latents of each motion
    (`streaming.window_at`); None: no end."""
    self.model, self.plan, self.batch = model, plan, len(keys)
    self._keys = keys if isinstance(keys, np.ndarray) else np.asarray(jax.random.key_data(keys))
    self._scale = np.asarray(scale, np.float32)
    self.lengths = lengths
    self._constants = model.constants_of(plan)
    self._state = streaming.first_state(model.dit, plan.layout, self.batch, np)
    self._decoder = self._decoder_before = _decoder_state(model, self.batch) if model.vae.causal else None
    self.paths: list[Path | None] = [None] * self.batch
    self._paths_before = self.paths
    self._text: Any = None
    self._tokens: np.ndarray | None = None  # embedded constraints (B, L, N), from block _tokens_from on
    self._tokens_from = 0
    self._signal: ControlSignal | None = None
    self._control_steps = 0

  @property
  def lengths(self) -> Int[np.ndarray, " b"]:
    """Latents of each motion. None sets motions without end."""
    return self._lengths

  @lengths.setter
  def lengths(self, lengths: Int[np.ndarray, " b"] | None) -> None:
    self._lengths = np.full(self.batch, streaming.ENDLESS) if lengths is None else np.asarray(lengths)

  @property
  def steps(self) -> int:
    return int(self._state.steps)

  @property
  def base(self) -> int:
    """The window's oldest block."""
    return int(streaming.oldest_block(self.plan, self.steps))

  def say(self, text_emb: Float[np.ndarray, "b g s e"], text_mask: Bool[np.ndarray, "b g s"]) -> None:
    """Sets the captions that blocks choose from; blocks that are begun may keep theirs."""
    k, v, null = self.model.compiled.words(self.plan.guided, self.model.stacked, text_emb, text_mask)
    self._text = Text(k, v, np.asarray(text_mask), null)

  # --- constraints -------------------------------------------------------------------------------------------------

  def hold(self, signal: ControlSignal | None, control_steps: int, start: Float[np.ndarray, "b 3"]) -> None:
    """Constrains the frames that can still change to a signal (B, T), from the first frame of the motions; None: no
    constraints.

    A network trained on constraints gets them as far ahead as it looks; latents are pulled to them by control_steps
    conjugate gradient steps in every second iteration. start: x, z and heading of the bodies.
    """
    model = self.model
    self._tokens, self._signal, self._control_steps = None, None, control_steps
    if signal is None or signal.is_empty:
      return
    if model.dit.control:
      # Of the frames that can still change; lengths doubled from ten seconds on, so that few are compiled.
      first, count = self.base * self.plan.block * model.frames_per_latent, _LENGTH * model.frames_per_latent
      while count < signal.frames - first:
        count *= 2
      self._tokens_from = self.base
      self._tokens = np.asarray(model.compiled.control(
          model.codec, model.stacked, signal.slice_frames(first, first + count), start))
    if control_steps:
      self._signal = jax.tree.map(np.asarray, signal)

  @property
  def control(self) -> Float[np.ndarray, "b w n"] | None:
    """The embedded constraints of the window; None where there are none."""
    if self._tokens is None:
      return None
    length = self.plan.width * self.plan.block
    first = (self.base - self._tokens_from) * self.plan.block
    window = self._tokens[:, first:first + length]
    return np.pad(window, ((0, 0), (0, length - window.shape[1]), (0, 0)))

  def _behind(self) -> Behind:
    """Decoder state and root transform at the window's first frame."""
    if not self.base:
      return behind_nothing(self.model, self.batch)
    rows = [(path.row, path.place[::2], heading_of(path)) for path in self._paths_before if path is not None]
    return Behind(self._decoder_before, *(np.stack(part).astype(np.float32) for part in zip(*rows)))

  def _pull(self, now: streaming.Window, iteration: int, drift: Float[np.ndarray, "b 2"]) -> None:
    """Pulls the latents of the window after an iteration, see `guiding.pull`."""
    plan, fpl, model = self.plan, self.model.frames_per_latent, self.model
    first = self.base * plan.block * fpl
    assert self._signal is not None
    window = self._signal.slice_frames(first, first + plan.width * plan.block * fpl)
    offset = np.stack([drift[:, 0], 0 * drift[:, 0], drift[:, 1]], axis=-1).astype(np.float32)[:, None, None]
    window = dataclasses.replace(window, positions=np.where(window.given, window.positions - offset, 0))
    times, level = np.asarray(self._constants.times), now.levels + iteration
    t, t_next = (np.repeat(times[np.clip(index, 0, plan.num_steps)], plan.block) for index in (level, level + 1))
    moves = t < t_next
    share = np.minimum(min(plan.lag, 2) * (t_next - t) / np.where(moves, 1 - t, 1), 1)
    base = np.int32(self.base * plan.block)
    guide = dataclasses.replace(Guide.of(model.codec, model.stats, window), first=base)
    pulled = np.asarray(model.compiled.pull(
        guide, tuple(self._behind()), base, self._state.clean, variance_of(t, moves), np.int32(self._control_steps),
        np.float32(TOLERANCE)))
    self._state = self._state._replace(latents=np.asarray(self._state.latents) + share[:, None] * pulled)

  # --- steps -------------------------------------------------------------------------------------------------------

  def _advance(self, now, given, first, last, control):
    conditions = streaming.Conditions(self.model.stacked, self._constants, self._text, self._scale, self._keys, control)
    self._state = self.model.compiled.advance(self.plan.layout, conditions, self._state, now, given, np.int32(first),
                                              np.int32(last))

  def prefill(self, past: Float[np.ndarray, "b p c"], caption: int) -> None:
    """Puts clean latents (B, P, C), made with this caption, before the first block."""
    size, count = self.plan.block, past.shape[1]
    past = np.pad(np.asarray(past), ((0, 0), (-count % size, 0), (0, 0)))
    blocks = np.split(past, past.shape[1] // size, axis=1)
    self._state = self._state._replace(steps=np.int32(-len(blocks)), past=np.int32(count))
    captions = np.full((self.batch, self.plan.width), caption)
    for block in blocks:
      now = streaming.window_at(self.plan, self.steps, count, captions, self._any(), self.lengths)
      self._advance(now, block, 0, 1, None)
      self._state = self._state._replace(steps=np.int32(now.steps + 1))

  def _any(self):
    return np.full((self.batch, self.plan.width), -2**30)

  def step(self, caption: Int[np.ndarray, "b w"], since: Int[np.ndarray, "b w"] | None = None,
           drift: Float[np.ndarray, "b 2"] | None = None, until: Int[np.ndarray, "b w"] | None = None
           ) -> Float[np.ndarray, "b n c"] | None:
    """Starts one more block and denoises those under way by one step; returns the block that became clean, if any.

    caption (B, W): which of the captions each block of the window has; since (B, W): see `streaming.window_at`. drift:
    x and z by which the cleanup has moved bodies from where they are decoded. until (B, W): the latent with which the
    caption of each block ends; by default each motion's last.
    """
    plan, age = self.plan, self.plan.age
    since = self._any() if since is None else since
    if not self.model.dit.time_left:
      until = None
    elif until is None:
      until = np.repeat(self.lengths[:, None], plan.width, axis=1)
    now = streaming.window_at(plan, self.steps, int(self._state.past), caption, since, self.lengths, until)
    given, control = np.zeros((self.batch, plan.block, self.model.dit.latent_dim), np.float32), self.control
    if self._signal is None:
      self._advance(now, given, 0, plan.lag, control)
    else:
      drift, first = np.zeros((self.batch, 2)) if drift is None else drift, 0
      for iteration in range(plan.lag):
        if plan.pulled(iteration) or iteration == plan.lag - 1:
          self._advance(now, given, first, iteration + 1, control)
          first = iteration + 1
          if plan.pulled(iteration):
            self._pull(now, iteration, drift)
    self._state = self._state._replace(steps=np.int32(now.steps + 1))
    if now.steps < age - 1:
      return None
    at = int(now.steps - age + 1 - now.blocks[0]) * plan.block
    return np.asarray(self._state.latents)[:, at:at + plan.block]

  def decode(self, block: Float[np.ndarray, "b n c"]) -> Float[np.ndarray, "b t f"]:
    """Normalized features of the next clean block."""
    self._decoder_before = self._decoder
    features, self._decoder = self.model.compiled.decode(self.model.codec, block, self._decoder)
    return np.asarray(features)

  def follow(self, features: Float[np.ndarray, "b t f"]) -> list[Float[np.ndarray, "t j 3"]]:
    """Joints of the next rows of features, not normalized; remembers where each body has arrived."""
    continued = [continue_path(rows, path, self.model.stats.layout) for rows, path in zip(features, self.paths)]
    self._paths_before, self.paths = self.paths, [path for _, path in continued]
    return [joints for joints, _ in continued]


def behind_nothing(model: CmdmNetworks, batch: int) -> Behind:
  """The state before any latent left the window: `Guide.begin` in numpy, which compiles nothing."""
  zeros = lambda *shape: np.zeros(shape, np.float32)
  return Behind(_decoder_state(model, batch), zeros(batch, 1, model.stats.layout.dim), zeros(batch, 2), zeros(batch))


def _decoder_state(model, batch):
  """The decoder's state before the first latents, in numpy."""
  shapes = jax.eval_shape(lambda: model.codec.init_decode_state(batch))
  return jax.tree.map(lambda a: np.zeros(a.shape, a.dtype), shapes)


def decode_all(model: CmdmNetworks, latents: Float[np.ndarray, "b l c"], frames: Sequence[int] | None = None
               ) -> Float[np.ndarray, "b t f"]:
  """Normalized features of latents, block after block by the program of a stream.

  A tokenizer that looks both ways decodes each motion alone and at once, the latents of its `frames` (all by default),
  by a program for each length; features after these are 0.
  """
  size, length, fpl = model.dit.block, latents.shape[1], model.frames_per_latent
  if not model.vae.causal:
    whole = np.zeros((len(latents), length * fpl, model.vae.features), np.float32)
    for row, row_latents, count in zip(whole, latents, [length * fpl] * len(latents) if frames is None else frames):
      used = -(-int(count) // fpl)
      row[:used * fpl] = model.compiled.decode_whole(model.codec, row_latents[None, :used])[0]
    return whole
  latents = np.pad(latents, ((0, 0), (0, -length % size), (0, 0)))
  state, blocks = _decoder_state(model, len(latents)), list[np.ndarray]()
  for block in np.split(latents, latents.shape[1] // size, axis=1):
    features, state = model.compiled.decode(model.codec, block, state)
    blocks.append(np.asarray(features))
  return np.concatenate(blocks, axis=1)[:, :length * fpl]
