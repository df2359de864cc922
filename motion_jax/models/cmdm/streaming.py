"""Frame-wise sampling at constant cost: a window of latents in denoising, a cache of those that are done.

One pure step carries the window through `lag` Euler iterations, after which one more block of latents is clean. Offline
sampling is `lax.scan` over it (`Sampler.sample`), applications and streams call it once a block from a loop on the host
(`loop`): they cannot differ. What makes it cheap changes no number (docs/papers/cmdm.md#cache):

- A block at age A = ceil(num_steps / lag) such steps is clean. It stays in the window for one step more, at t = 1, so
  that its final keys and values are known; then they go to a ring cache and the block is never computed again.
- What depends on the time alone is a table over the num_steps + 1 times; what depends on the caption alone is computed
  once; the branch without caption attends to a constant.
- Every block has a caption of its own. A new one begins with a new block; keys and values of older blocks depend on
  their own captions, which do not change, so the cache stays exact and nothing is computed again. With `Plan.memory`
  blocks of a new caption see only the last few before it: frames of the old prompt suppress the new action.

All steps have the same shapes, so that one program serves motions of any length and kind: blocks that have not begun
are computed, but seen by none that has, and an empty cache is a masked one. A given past enters by the same step, block
by block at t = 1 (`Sampler.prefill`).

A latent attends to `context` latents, its own block included (`nets.masks.sliding_mask`). Cached keys are kept unturned
and positions count from the window, so they never grow and an hour of motion is as exact as a second.

step     0 1 2 3 4 5        blocks in the window, lag = num_steps / 2 (A = 2), width 3:
block 0  o o * .            o in denoising, * done, computed once more for its keys and values, . cached
block 1    o o * .
"""
import dataclasses
from typing import Any, NamedTuple

import flax
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.diffusion.guidance import combine
from motion_jax.diffusion.schedules import time_of_level
from motion_jax.models.cmdm import ddpm_forcing
from motion_jax.models.cmdm.guiding import pull
from motion_jax.models.cmdm.plan import ENDLESS as ENDLESS
from motion_jax.models.cmdm.plan import Layout as Layout
from motion_jax.models.cmdm.plan import Plan as Plan
from motion_jax.models.cmdm.plan import Window as Window
from motion_jax.models.cmdm.plan import caption_ends as caption_ends
from motion_jax.models.cmdm.plan import make_plan as make_plan
from motion_jax.models.cmdm.plan import oldest_block as oldest_block
from motion_jax.models.cmdm.plan import seen_since as seen_since
from motion_jax.nets.frame_wise import FrameWiseNetwork
from motion_jax.shapes import Array, Bool, Float, Int, Net


class Stream(NamedTuple):
  """State between two steps; B motions side by side, 2 B rows in the cache when guided."""
  steps: Any    # () how many steps are done; negative while a past is filled in
  latents: Any  # (B, width * block, C), the window
  cache: Any    # (k, v), (depth, rows, ring * block, H, K), keys unturned
  oldest: Any   # (k, v), (depth, rows, block, H, K), of the window's oldest block in its last iteration
  clean: Any    # like latents: the clean latents predicted in the last iteration; flows only
  past: Any     # () how many latents were given before the first block, see `Sampler.prefill`
  behind: Any = None  # the state after the latents that left the window, for guided samplers


class Constants(NamedTuple):
  """Tables that depend on the time alone: times (num_steps + 1,) and modulation (depth, num_steps + 1, 6, D); of a DDPM
  also the steps from each time to the next."""
  times: jax.Array
  modulation: jax.Array
  steps: ddpm_forcing.Steps | None = None


class Conditions(NamedTuple):
  """All inputs of a step but its state: params of the network, stacked; `Constants`; the captions' `encode_text`;
  scale () or (B,) of guidance; keys of the noise that a DDPM's steps add, None for a flow; control (B, W * block, N) of
  `CausalDiT.control_tokens`, None for a network without."""
  params: Any
  constants: Constants
  text: Any
  scale: Any
  keys: Any
  control: Any = None


def make_constants(dit: Net, params: Any, plan: Plan, rows: int = 0) -> Constants:
  """The tables of a plan. rows: their length, that several numbers of steps share a program; by default
  num_steps + 1."""
  padded = lambda a: jnp.pad(a, (0, max(rows - len(a), 0)), mode="edge")
  if plan.solver in ddpm_forcing.SOLVERS:
    steps = jax.tree.map(padded, ddpm_forcing.make_steps(plan.num_steps, plan.solver))
    return Constants(steps.times, dit.apply(params, steps.times, method="modulation"), steps)
  times = padded(jnp.asarray(time_of_level(range(plan.num_steps + 1), plan.num_steps)))
  return Constants(times, dit.apply(params, times, method="modulation"))


def encode_text(dit: Net, params: Any, text_emb: Float[Array, "b *g s e"], text_mask: Bool[Array, "b *g s"],
                guided: bool = True) -> Any:
  """Keys and values of captions for all layers, from text_emb (B, S, E), text_mask (B, S).

  With G captions a motion, (B, G, S, E) and (B, G, S), their words stand side by side, G * S of them; masks keep G.
  """
  words = text_emb.reshape(text_emb.shape[0], -1, text_emb.shape[-1])
  text_mask = text_mask.reshape(text_mask.shape[0], -1, text_mask.shape[-1])
  return dit.apply(params, words, text_mask, guided, method="text_keys_values")


def block_noise(keys: jax.Array, index: Any, plan: Plan | Layout, channels: int) -> Float[Array, "b l {channels}"]:
  """Noise (B, block, C) of block `index`: a function of each motion's key and the block's place in it, nothing else.

  keys (B,), or their data (B, 2)."""
  draw = lambda key: jax.random.normal(jax.random.fold_in(key, index), (plan.block, channels))
  return jax.vmap(draw)(_typed(keys))


def _typed(keys):
  return keys if jnp.issubdtype(keys.dtype, jax.dtypes.prng_key) else jax.random.wrap_key_data(keys)


def fresh_noise(keys: jax.Array, blocks: Int[Array, " w"], levels: Int[Array, " w"], plan: Plan | Layout, channels: int
                ) -> Float[Array, "b l {channels}"]:
  """Noise (B, W * block, C) that a DDPM's step adds to each of W blocks: of each motion's key, the block's index (W,)
  and the step (W,) that it takes, and of nothing else."""
  def draw(key, index, level):
    key = jax.random.fold_in(key, 2**31 - 1)  # no block has this index, so its first noise is another
    return jax.random.normal(jax.random.fold_in(jax.random.fold_in(key, index), level), (plan.block, channels))

  noise = jax.vmap(lambda key: jax.vmap(lambda index, level: draw(key, index, level))(blocks, levels))(_typed(keys))
  return noise.reshape(len(keys), -1, channels)


def window_at(plan: Plan, steps: Any, past: Any, caption: Int[Array, "b w"], since: Int[Array, "b w"] | None = None,
              lengths: Int[Array, " b"] | None = None, until: Int[Array, "b w"] | None = None) -> Window:
  """The window of the step after `steps` others, after `past` given latents, traced if any argument is.

  caption (B, W): which of the captions in text each block has. since (B, W): the first block that each sees,
  `seen_since`; None: all within the context. lengths (B,): latents of each motion; later ones, in its last block or in
  the blocks of a longer motion of the batch, see and are seen by themselves alone. None: no end. until (B, W): the
  latent with which the caption of each block ends (`caption_ends`), `ENDLESS` or more: unknown; None: for networks
  without `time_left`.
  """
  xp = jnp if any(isinstance(a, jax.Array) for a in (steps, past, caption, since, lengths)) else np
  size, slots, within = plan.block, xp.arange(plan.ring), xp.arange(plan.block)
  base = oldest_block(plan, steps)
  blocks = base + xp.arange(plan.width)
  held = base - 1 - (base - 1 - slots) % plan.ring  # the block that a slot of the ring holds
  seen = xp.concatenate([held, blocks])
  spread = lambda a: xp.repeat(a, size, axis=-1)
  positions = spread(seen - base) * size + xp.tile(within, len(seen))
  apart = spread(blocks)[:, None] - spread(seen)[None]
  # Block-causal, no farther back than the context, and nothing before what was given.
  mask = ((apart >= 0) & (apart < plan.context // size) & (positions + base * size >= -past))[None, None]
  if since is not None:
    mask = mask & (spread(seen) >= spread(since)[:, None, :, None])
  if lengths is not None:
    key, lengths = positions + base * size, xp.asarray(lengths)[:, None, None, None]
    query = key[-plan.width * size:, None]
    mask = mask & (((key < lengths) & (query < lengths)) | (key == query))
  if plan.guided and not (since is None and lengths is None):
    mask = xp.concatenate([mask, mask])
  levels = xp.where(blocks < 0, plan.num_steps, (steps - blocks) * plan.lag)
  left = None
  if until is not None:
    left = spread(until) - (positions + base * size)[-plan.width * size:]
    left = xp.where(spread(until) < ENDLESS, left, -1).astype(xp.int32)
    left = xp.concatenate([left, left]) if plan.guided else left
  number = lambda a: xp.asarray(a, xp.int32)
  return Window(number(steps), xp.asarray((steps <= 0) | (steps > plan.age)), number((base - 1) % plan.ring * size),
                number(blocks), number(levels), number(plan.num_steps), mask,
                number(positions[:plan.ring * size]), number(caption), left)


def first_state(dit: Net, layout: Layout, batch: int, xp: Any = jnp) -> Stream:
  """The state before the first step: nothing in window and cache."""
  dtype = jax.dtypes.canonicalize_dtype(np.float64)  # that of `block_noise`
  rows, head = batch * (2 if layout.guided else 1), (dit.num_heads, dit.width // dit.num_heads)
  pair = lambda blocks: tuple(xp.zeros((dit.depth, rows, blocks * layout.block, *head), dit.dtype) for _ in range(2))
  window = xp.zeros((batch, layout.width * layout.block, dit.latent_dim), dtype)
  return Stream(xp.int32(0), window, pair(layout.ring), pair(1), window, xp.int32(0))


def _words_of_blocks(text, caption, size):
  """Text whose mask shows each latent the words of its block's caption only; caption (B, blocks)."""
  if text is None:
    return None
  mask = text.mask[:, None] & (caption[:, :, None, None] == jnp.arange(text.mask.shape[1])[:, None])
  return text._replace(mask=jnp.repeat(mask.reshape(mask.shape[:2] + (-1,)), size, axis=1))


def first_latents(dit: Net, layout: Layout, keys: jax.Array, now: Window, given: Float[Array, "_ _ _"]
                  ) -> Float[Array, "b w l c"]:
  """Initial latents of blocks (B, W, block, C): noise; before the first block `given`, clean latents (B, block, C)."""
  noise = jax.vmap(lambda index: block_noise(keys, index, layout, dit.latent_dim), out_axes=1)(now.blocks)
  return jnp.where(now.steps < 0, jnp.expand_dims(given, -3), noise)


def begin(layout: Layout, state: Stream, now: Window, start: Float[Array, "b _ l c"], fresh: Any = True) -> Stream:
  """The state in which the next block has begun, and that before the window, if it moves on, is in the cache.

  start: of `first_latents`, what blocks that have not begun are filled with. fresh: False leaves the state as it is.
  """
  size, moves = layout.block, now.moves & fresh

  def put(ring, new):
    new = jnp.where(moves, new.astype(ring.dtype), jax.lax.dynamic_slice_in_dim(ring, now.slot, size, axis=2))
    return jax.lax.dynamic_update_slice_in_dim(ring, new, now.slot, axis=2)

  start = jnp.broadcast_to(start, start.shape[:1] + now.blocks.shape + start.shape[2:]).reshape(state.latents.shape)
  latents = jnp.where(moves, jnp.roll(state.latents, -size, axis=1), state.latents)
  begins = jnp.repeat(now.blocks >= now.steps, size)[:, None] & fresh
  return state._replace(cache=jax.tree.map(put, state.cache, state.oldest), latents=jnp.where(begins, start, latents))


def iterate(dit: Net, layout: Layout, conditions: Conditions, state: Stream, now: Window, first: Any, last: Any
            ) -> Stream:
  """The state after iterations first to last, last excluded, of a step."""
  params, constants, text, scale, keys, control = conditions
  size, within = layout.block, jnp.arange(layout.width * layout.block)
  scale = jnp.reshape(scale, (-1, 1, 1))
  # Parity: the paper has this cache, the code recomputes everything; the results agree to rounding.
  past = dit.apply(params, state.cache, now.positions, method="turn_keys")
  text = _words_of_blocks(text, now.caption, size)
  spread = lambda a: jnp.repeat(a, size)

  def velocity_at(latents, level):
    modulation = jnp.repeat(constants.modulation[:, level], size, axis=1)[:, None]
    x = jnp.concatenate([latents, latents]) if layout.guided else latents
    left = {} if now.left is None else {"left": now.left}
    velocity, new = dit.apply(params, x, spread(constants.times[level])[None], modulation, text, now.attn_mask, within,
                              past, control, method="window", **left)
    if layout.guided:
      with_text, without = jnp.split(velocity, 2)
      velocity = combine(with_text, without, scale)
    return velocity.astype(latents.dtype), jax.tree.map(lambda a, old: a[:, :, :size].astype(old.dtype), new,
                                                        state.oldest)

  def iteration(i, carry):
    latents = carry[0]
    level, then = (jnp.clip(now.levels + j, 0, now.num_steps) for j in (i, i + 1))
    velocity, oldest = velocity_at(latents, level)
    if constants.steps is not None:  # the network says noise
      noise: Any = 0.0
      if layout.solver == "ancestral" and keys is not None:
        noise = fresh_noise(keys, now.blocks, level, layout, dit.latent_dim).astype(latents.dtype)
      return ddpm_forcing.step(constants.steps, latents, velocity, spread(level), spread(then), noise), oldest, latents
    step = spread(constants.times[then] - constants.times[level])[:, None]
    if layout.solver == "heun":
      velocity = (velocity + velocity_at(latents + step * velocity, then)[0]) / 2
    return latents + step * velocity, oldest, latents + (1 - spread(constants.times[level]))[:, None] * velocity

  latents, oldest, clean = jax.lax.fori_loop(first, last, iteration, (state.latents, state.oldest, state.clean))
  return state._replace(latents=latents, oldest=oldest, clean=clean)


def advance(dit: Net, layout: Layout, conditions: Conditions, state: Stream, now: Window, given: Any, first: Any,
            last: Any) -> Stream:
  """`begin`, before iteration 0, and `iterate`: the program of a step. given: see `first_latents`."""
  state = begin(layout, state, now, first_latents(dit, layout, conditions.keys, now, given), first == 0)
  return iterate(dit, layout, conditions, state, now, first, last)


@flax.struct.dataclass
class Sampler:
  """Frame-wise sampling of B motions, bound to all that stays the same from step to step. Made by `bind`.

  dit, plan: network and choices, static. params of the network, stacked; constants: `make_constants`; text:
  `encode_text`; scale: of guidance; keys (B,): one per motion; control: the embedded constraints. A pytree: a jitted
  function takes it as one argument.
  """
  dit: Any = flax.struct.field(pytree_node=False)
  plan: Plan = flax.struct.field(pytree_node=False)
  params: Any
  constants: Constants
  text: Any
  scale: Any
  keys: Any
  control: Any = None        # (B, blocks * block, N) of `CausalDiT.control_tokens`, from block control_first on
  control_first: Any = 0
  lengths: Any = None        # (B,) latents of each motion, see `window_at`; None: no end
  guide: Any = None          # a `guiding.Guide`, which pulls latents of flows towards constraints

  def init(self) -> Stream:
    """The state before the first step."""
    state = first_state(self.dit, self.plan.layout, len(self.keys))
    return state if self.guide is None else state._replace(behind=self.guide.begin())

  def prefill(self, state: Stream, *, past: Float[Array, "b p c"], count: Any, caption: Int[Array, "b k"] | None = None
              ) -> Stream:
    """A state as of `init` after clean latents: the motion continues the last `count` of past (B, P, C).

    P is whole blocks, and the past ends where block 0 begins; what stands before its last `count` latents is ignored.
    Block after block enters the window at t = 1 and leaves its keys and values in the cache. caption (B, P / block):
    which of the captions in text each block of the past was made with.
    """
    size, length = self.plan.block, past.shape[1]
    if length % size:
      raise ValueError(f"got a past of {length} latents, expected whole blocks of {size}; pad it in front")
    blocks = jnp.stack(jnp.split(past, length // size, axis=1))
    state = state._replace(steps=jnp.int32(-len(blocks)), past=jnp.asarray(count, jnp.int32))

    def fill(state, given):
      return self._advanced(state, self._window(state, caption, None, len(blocks)), given, 1), None

    return jax.lax.scan(fill, state, blocks)[0]

  def _window(self, state, caption, since, offset=0, until=None):
    """`window_at` with captions, sights and ends (B, N) of all blocks, the first of them block -offset."""
    at = oldest_block(self.plan, state.steps) + jnp.arange(self.plan.width) + offset
    of_window = lambda rows: rows[:, jnp.clip(at, 0, rows.shape[1] - 1)]
    caption = jnp.zeros((len(self.keys), self.plan.width), jnp.int32) if caption is None else of_window(caption)
    since, until = (None if rows is None else of_window(rows) for rows in (since, until))
    return window_at(self.plan, state.steps, state.past, caption, since, self.lengths, until)

  def _advanced(self, state, now, given, count):
    """The state one block further, of `count` iterations."""
    dit, plan, control = self.dit, self.plan, self.control
    if control is not None:
      first = (now.blocks[0] - self.control_first) * plan.block
      control = jax.lax.dynamic_slice_in_dim(control, first, plan.width * plan.block, axis=1)
      control = jnp.where(now.steps < 0, 0, control)
    state = begin(plan.layout, state, now, first_latents(dit, plan.layout, self.keys, now, given))
    conditions = Conditions(self.params, self.constants, self.text, self.scale, self.keys, control)
    run = lambda state, first, last: iterate(dit, plan.layout, conditions, state, now, first, last)
    if self.guide is None:
      return run(state, 0, count)._replace(steps=state.steps + 1)

    def guided(i, state):
      state = run(state, i, i + 1)
      pulled = lambda: pull(plan.layout, self.guide, state.behind, self.constants.times, now, state.latents,
                            state.clean, i, min(plan.lag, 2))
      return state._replace(latents=jax.lax.cond(plan.pulled(i), pulled, lambda: state.latents))

    state = jax.lax.fori_loop(0, count, guided, state)
    leaves = (now.steps >= plan.age)  # the oldest block: the next step's window is without it
    behind = self.guide.move_on(state.behind, state.latents[:, :plan.block])
    behind = jax.tree.map(lambda new, old: jnp.where(leaves, new, old), behind, state.behind)
    return state._replace(steps=state.steps + 1, behind=behind)

  def step(self, state: Stream, *, caption: Int[Array, "b w"] | None = None, since: Int[Array, "b w"] | None = None
           ) -> tuple[Stream, Float[Array, "b n c"], Bool[Array, ""]]:
    """One block further: (state, block (B, block, C), done) where done says that the block is a clean one.

    The first plan.age - 1 steps give none. caption, since (B, W): of the window's blocks, see `window_at`.
    """
    caption = jnp.zeros((len(self.keys), self.plan.width), jnp.int32) if caption is None else caption
    return self._stepped(state, window_at(self.plan, state.steps, state.past, caption, since, self.lengths))

  def _stepped(self, state, now):
    plan = self.plan
    state = self._advanced(state, now, jnp.zeros((1, 1, 1)), plan.lag)
    finished = jnp.maximum(now.steps - plan.age + 1, 0)  # the block that became clean in this step
    block = jax.lax.dynamic_slice_in_dim(state.latents, (finished - now.blocks[0]) * plan.block, plan.block, axis=1)
    return state, block, now.steps >= plan.age - 1

  def sample(self, num_blocks: int, *, segment: Int[Array, "b {num_blocks}"] | None = None,
             state: Stream | None = None) -> Float[Array, "b l c"]:
    """Clean latents (B, num_blocks * block, C), all in one trace: `lax.scan` over `step`.

    segment: rising, which of the captions in text each block has. state: one of `prefill`, to go on from a past; `init`
    if left out.
    """
    plan, since, sampler = self.plan, seen_since(self.plan, segment), self
    if self.lengths is None and getattr(self.dit, "two_way", False):  # blocks that begin after the last one are unseen
      sampler = dataclasses.replace(self, lengths=jnp.full(len(self.keys), num_blocks * plan.block))

    until = None
    if getattr(self.dit, "time_left", False):
      lengths = jnp.full(len(self.keys), num_blocks * plan.block) if self.lengths is None else self.lengths
      until = caption_ends(jnp.zeros((len(self.keys), num_blocks), int) if segment is None else segment, lengths,
                           plan.block)

    def body(state, _):
      state, block, _ = sampler._stepped(state, sampler._window(state, segment, since, until=until))
      return state, block

    _, blocks = jax.lax.scan(body, self.init() if state is None else state, None, length=plan.age + num_blocks - 1)
    blocks = blocks[plan.age - 1:]  # (num_blocks, B, block, C)
    return jnp.moveaxis(blocks, 0, 1).reshape(len(self.keys), num_blocks * plan.block, self.dit.latent_dim)


def bind(dit: FrameWiseNetwork, plan: Plan, params: Any, *, text_emb: Float[Array, "b *g s e"] | None = None,
         text_mask: Bool[Array, "b *g s"] | None = None, scale: Any = 1.0, keys: jax.Array,
         control: Float[Array, "b l n"] | None = None, lengths: Int[Array, " b"] | None = None) -> Sampler:
  """A sampler for captions text_emb (B, S, E), text_mask (B, S), or G of them a motion, see `encode_text`; None for a
  network without captions. control (B, L, N): of `control.conditioning.features`. lengths: see `window_at`."""
  params = dit.stack_layers(params)
  text = None if text_emb is None or text_mask is None else encode_text(dit, params, text_emb, text_mask, plan.guided)
  tokens = None if control is None else control_tokens(dit, plan, params, control)
  return Sampler(dit, plan, params, make_constants(dit, params, plan), text, scale, keys, tokens, lengths=lengths)


def control_tokens(dit: Net, plan: Plan, params: Any, control: Float[Array, "b l n"]) -> Float[Array, "b _ width"]:
  """The embedded control (B, L, N) for all layers; zeros for later latents that a window reaches."""
  tokens = dit.apply(params, control, method="control_tokens")
  return jnp.pad(tokens, ((0, 0), (0, plan.width * plan.block), (0, 0)))
