"""Frame-wise sampling at constant cost: a window of latents in denoising, a cache of those that are done.

One pure step, `Sampler.step`, carries the window through `lag` Euler iterations, after which one more block of latents
is clean. Offline sampling is `lax.scan` over it, streaming calls it once a block: they cannot differ. What makes it
cheap changes no number (docs/papers/cmdm.md#cache):

- A block at age A = ceil(num_steps / lag) such steps is clean. It stays in the window for one step more, at t = 1, so
  that its final keys and values are known; then they go to a ring cache and the block is never computed again.
- Blocks that have not begun are not computed: `active` is how many slots of the window are.
- What depends on the time alone is a table over the num_steps + 1 times; what depends on the caption alone is computed
  once; the branch without caption attends to a constant.
- Every block has a caption of its own. A new one begins with a new block; keys and values of older blocks depend on
  their own captions, which do not change, so the cache stays exact and nothing is computed again. With `Plan.memory`
  blocks of a new caption see only the last few before it: what one was doing holds back what one is to do.

A latent attends to `context` latents, its own block included (`nets.masks.sliding_mask`). Cached keys are kept unturned
and positions count from the window, so they never grow and an hour of motion is as exact as a second.

step     0 1 2 3 4 5        blocks in the window, lag = num_steps / 2 (A = 2), width 3:
block 0  o o * .            o in denoising, * done, computed once more for its keys and values, . cached
block 1    o o * .
block 2      o o * .
"""
import dataclasses
from typing import Any, NamedTuple

import flax
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from motion_jax.diffusion.guidance import combine
from motion_jax.diffusion.samplers import SOLVERS
from motion_jax.diffusion.schedules import time_of_level
from motion_jax.models.cmdm import ddpm_forcing
from motion_jax.nets.frame_wise import FrameWiseNetwork
from motion_jax.shapes import Array, Net


class Plan(NamedTuple):
  """The choices that shapes and loops depend on; hashable, so that jit can specialize on it."""
  num_steps: int
  lag: int      # iterations between the starts of two blocks; num_steps is autoregressive
  block: int    # latents per block
  context: int  # latents that a latent attends to
  width: int    # blocks in the window
  guided: bool
  solver: str = "euler"
  captions: int = 1  # how many different captions the blocks of one window may have
  memory: int | None = None  # blocks before a caption's first one that its blocks see; None: all within the context

  @property
  def age(self) -> int:
    """Steps after which a block is clean."""
    return -(-self.num_steps // self.lag)

  @property
  def ring(self) -> int:
    """Blocks in the cache."""
    return max(self.context // self.block - 1, 1)

  def fitted(self, num_blocks: int) -> "Plan":
    """The same plan with a window no wider than a motion of this number of blocks."""
    return self._replace(width=min(self.width, num_blocks))


def make_plan(num_steps: int, lag: int, block: int, context: int, num_blocks: int | None = None, guided: bool = True,
              solver: str = "euler", captions: int = 1, memory: int | None = None) -> Plan:
  """A plan of a memory in latents; with num_blocks its window is no wider than the motion. Raises ValueError."""
  if num_steps < 1 or not 1 <= lag <= num_steps:
    raise ValueError(f"got num_steps {num_steps} and lag {lag}; expected 1 <= lag <= num_steps (lag = num_steps is "
                     "autoregressive)")
  if block < 1 or context < block or context % block:
    raise ValueError(f"got a context of {context} latents, expected whole blocks of {block}")
  if memory is not None and (memory < 0 or memory % block):
    raise ValueError(f"got a memory of {memory} latents, expected whole blocks of {block}; try "
                     f"{memory // block * block}")
  if solver not in (*SOLVERS, *ddpm_forcing.SOLVERS):
    raise ValueError(f"got solver {solver!r}, expected one of {', '.join((*SOLVERS, *ddpm_forcing.SOLVERS))}")
  plan = Plan(num_steps, lag, block, context, -(-num_steps // lag) + 1, guided, solver, captions,
              None if memory is None else memory // block)
  return plan.fitted(num_blocks) if num_blocks else plan


class Stream(NamedTuple):
  """State between two steps; B motions side by side, 2 B rows in the cache when guided."""
  steps: jax.Array    # () how many steps are done
  latents: jax.Array  # (B, width * block, C), the window
  cache: Any          # per layer (k, v), (rows, ring * block, H, K), keys unturned
  past: jax.Array     # () how many latents were given before the first block, see `Sampler.prefill`
  behind: Any = None  # the state after the latents that left the window, for guided samplers


class Constants(NamedTuple):
  """What the time alone decides: times (num_steps + 1,) and modulation (depth, num_steps + 1, 6, D); of a DDPM also
  how to go from each to the next."""
  times: jax.Array
  modulation: jax.Array
  steps: ddpm_forcing.Steps | None = None


def make_constants(dit: Net, params: Any, plan: Plan) -> Constants:
  if plan.solver in ddpm_forcing.SOLVERS:
    steps = ddpm_forcing.make_steps(plan.num_steps, plan.solver)
    return Constants(steps.times, dit.apply(params, steps.times, method="modulation"), steps)
  times = jnp.asarray(time_of_level(range(plan.num_steps + 1), plan.num_steps))
  return Constants(times, dit.apply(params, times, method="modulation"))


def encode_text(dit: Net, params: Any, text_emb: Float[Array, "b *g s e"], text_mask: Bool[Array, "b *g s"],
                guided: bool = True) -> Any:
  """Keys and values of captions for all layers, from text_emb (B, S, E), text_mask (B, S).

  With G captions a motion, (B, G, S, E) and (B, G, S), their words stand side by side, G * S of them; masks keep G.
  """
  words = text_emb.reshape(text_emb.shape[0], -1, text_emb.shape[-1])
  return dit.apply(params, words, text_mask, guided, method="text_keys_values")


def block_noise(keys: jax.Array, index: Any, plan: Plan, channels: int) -> Float[Array, "b l {channels}"]:
  """Noise (B, block, C) of block `index`: a function of each motion's key and the block's place in it, nothing else."""
  draw = lambda key: jax.random.normal(jax.random.fold_in(key, index), (plan.block, channels))
  return jax.vmap(draw)(keys)


def fresh_noise(keys: jax.Array, blocks: Int[Array, " w"], levels: Int[Array, " w"], plan: Plan, channels: int
                ) -> Float[Array, "b l {channels}"]:
  """Noise (B, W * block, C) that a DDPM's step adds to each of W blocks: of each motion's key, the block's index (W,)
  and the step (W,) that it takes, and of nothing else."""
  def draw(key, index, level):
    key = jax.random.fold_in(key, 2**31 - 1)  # no block has this index, so its first noise is another
    return jax.random.normal(jax.random.fold_in(jax.random.fold_in(key, index), level), (plan.block, channels))

  noise = jax.vmap(lambda key: jax.vmap(lambda index, level: draw(key, index, level))(blocks, levels))(keys)
  return noise.reshape(len(keys), -1, channels)


def _words_of_blocks(text, caption, size):
  """Text whose masks show each latent the words of its block's caption only; caption (B, blocks) or None."""
  if caption is None:
    return text
  mask = text[0].mask[:, None] & (caption[:, :, None, None] == jnp.arange(text[0].mask.shape[1])[:, None])
  mask = jnp.repeat(mask.reshape(mask.shape[:2] + (-1,)), size, axis=1)
  return tuple(layer._replace(mask=mask) for layer in text)


def _window_mask(query_blocks, key_blocks, plan, since=None):
  """(1, 1, Q * block, K * block): block-causal and no farther back than the context.

  since (B, Q): the first block that each block of queries sees; the mask has B rows then, twice as many if guided.
  """
  spread = lambda a: jnp.repeat(a, plan.block, axis=-1)
  apart = spread(query_blocks)[:, None] - spread(key_blocks)[None, :]
  mask = ((apart >= 0) & (apart < plan.context // plan.block))[None, None]
  if since is None:
    return mask
  mask &= spread(key_blocks) >= spread(since)[:, None, :, None]
  return jnp.concatenate([mask, mask]) if plan.guided else mask


def segments(plan: Plan, num_blocks: int, buckets: int = 2, prefilled: bool = False) -> list[tuple[int, int, bool]]:
  """[(steps, active, use_cache)]: the runs of steps that share one compiled width, for num_blocks in all.

  Widths are rounded up to `buckets` sizes, so that ramp-up and drain share code. prefilled: the cache is full from
  the start.
  """
  width = -(-plan.width // buckets)
  runs: list[tuple[int, int, bool]] = []
  for at in range(plan.age + num_blocks - 1):
    base = max(at - plan.age, 0)
    needed = min(at + 1, num_blocks) - base
    key = (min(-(-needed // width) * width, plan.width), prefilled or at > plan.age)
    if runs and runs[-1][1:] == key:
      runs[-1] = (runs[-1][0] + 1, *key)
    else:
      runs.append((1, *key))
  return runs


def captions_seen(segment: Int[Array, "b n"], width: int) -> int:
  """How many captions a window of `width` blocks shows at most, up to a power of two: a plan's `captions`.

  segment (B, num_blocks): rising integers, which caption each block has.
  """
  segment = np.asarray(segment)
  last = segment[:, np.minimum(np.arange(segment.shape[1]) + width - 1, segment.shape[1] - 1)]
  return 1 << int((last - segment).max()).bit_length()


def seen_since(plan: Plan, segment: Int[Array, "b n"] | None) -> Int[Array, "b n"] | None:
  """The first block that each block sees, by the plan's memory of what was made with other captions; None: any.

  segment (B, N): rising, which caption each block has. What is made with the first one sees all that was given before.
  """
  if plan.memory is None or segment is None:
    return None
  starts = jnp.where(jnp.diff(segment, axis=1, prepend=-1) != 0, jnp.arange(segment.shape[1]), 0)
  begins = jax.lax.cummax(starts, axis=1)
  return jnp.where(begins == 0, -2**30, begins - plan.memory)  # a block before all that there are


def window_captions(plan: Plan, text: Any, segment: Int[Array, "b n"] | None, base: Any, active: int
                    ) -> tuple[Any, Int[Array, "b {active}"] | None]:
  """The part of a long text that the window sees, and its blocks' captions therein: (text, caption (B, active)).

  segment (B, num_blocks): rising, which of the G captions of text each block has; None where there is one for all. The
  cost is that of plan.captions captions, however many the motion has.
  """
  if segment is None:
    return text, None
  ids = segment[:, jnp.clip(base + jnp.arange(active), 0, segment.shape[1] - 1)]
  batch, count, words = text[0].mask.shape
  if count <= plan.captions:
    return text, ids
  chosen = jnp.minimum(ids[:, :1] + jnp.arange(plan.captions), count - 1)
  pick = lambda a: a[jnp.arange(batch)[:, None], chosen]
  side_by_side = lambda a: pick(a.reshape((batch, count, words) + a.shape[2:])).reshape(
      (batch, plan.captions * words) + a.shape[2:])
  cut = lambda layer: layer._replace(k=side_by_side(layer.k), v=side_by_side(layer.v), mask=pick(layer.mask))
  return tuple(map(cut, text)), ids - ids[:, :1]


@flax.struct.dataclass
class Sampler:
  """Frame-wise sampling of B motions, bound to all that stays the same from step to step. Made by `bind`.

  dit, plan: network and choices, static. params of the network; constants: `make_constants`; text: `encode_text`;
  scale: of guidance; keys (B,): one per motion; control: the embedded constraints. A
  pytree: a jitted function takes it as one argument.
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
  guide: Any = None          # a `guiding.Guide`, which pulls latents of flows towards constraints

  def init(self) -> Stream:
    """The state before the first step."""
    dit, plan, keys = self.dit, self.plan, self.keys
    noise = [block_noise(keys, index, plan, dit.latent_dim) for index in range(plan.width)]
    rows = keys.shape[0] * (2 if plan.guided else 1)
    shape = (rows, plan.ring * plan.block, dit.num_heads, dit.width // dit.num_heads)
    empty = jnp.zeros(shape, dit.dtype)
    cache = tuple((empty, empty) for _ in range(dit.depth))
    return Stream(jnp.zeros((), jnp.int32), jnp.concatenate(noise, axis=1), cache, jnp.zeros((), jnp.int32),
                  None if self.guide is None else self.guide.begin())

  def prefill(self, state: Stream, *, past: Float[Array, "b p c"], count: Any, caption: Int[Array, "b k"] | None = None
              ) -> Stream:
    """A state as of `init` with clean latents behind it: the motion continues the last `count` of past (B, P, C).

    P is whole blocks, and the past ends where block 0 begins; what stands before its last `count` latents is ignored.
    One pass at t = 1 fills the cache with what these latents would have left there. caption (B, P / block): which of
    the captions in text each block of the past was made with.
    """
    plan, size, length = self.plan, self.plan.block, past.shape[1]
    if length % size:
      raise ValueError(f"got a past of {length} latents, expected whole blocks of {size}; pad it in front")
    blocks, real = jnp.arange(length // size), jnp.arange(length) >= length - count
    attn_mask = _window_mask(blocks, blocks, plan) & real
    x = jnp.concatenate([past, past]) if plan.guided else past
    modulation = self.constants.modulation[:, -1][:, None, None]
    _, new = self.dit.apply(self.params, x, jnp.ones(x.shape[:2], self.constants.times.dtype), modulation,
                            _words_of_blocks(self.text, caption, size), attn_mask, jnp.arange(length), method="window")
    kept = plan.ring * size
    fill = lambda ring, new: jnp.pad(new[:, -kept:], ((0, 0), (max(kept - length, 0), 0), (0, 0), (0, 0))).astype(
        ring.dtype)
    return state._replace(cache=jax.tree.map(fill, state.cache, new), past=jnp.asarray(count, jnp.int32))

  def step(self, state: Stream, *, active: int, use_cache: bool, caption: Int[Array, "b {active}"] | None = None,
           since: Int[Array, "b {active}"] | None = None) -> tuple[Stream, Float[Array, "b n c"], Bool[Array, ""]]:
    """One block further: (state, block (B, block, C), done) where done says that the block is a clean one.

    The first plan.age - 1 steps give none. active: slots of the window that are computed, counted from its oldest
    block; all begun blocks must be among them. use_cache = False is for steps before anything is in the cache.
    caption (B, active): which of the G captions in text each of these blocks is made with; None where there is one.
    since (B, active): the first block that each sees, `seen_since`; None: all within the context.
    """
    dit, plan, params, constants, scale, keys = (
        self.dit, self.plan, self.params, self.constants, self.scale, self.keys)
    size, age = plan.block, plan.age
    # Parity: the paper has this cache, the code recomputes everything; the results agree to rounding.
    base = jnp.maximum(state.steps - age, 0)  # the oldest block of the window
    blocks = base + jnp.arange(active)
    level = (state.steps - blocks) * plan.lag  # iterations that each block has behind it; negative: not begun
    within = jnp.arange(active * size)
    past, attn_mask = None, _window_mask(blocks, blocks, plan, since)
    text = _words_of_blocks(self.text, caption, size)
    if use_cache:
      slots = jnp.arange(plan.ring)
      held = base - 1 - (base - 1 - slots) % plan.ring  # the block that a slot of the ring holds; negative: none yet
      positions = jnp.repeat((held - base) * size, size) + jnp.tile(jnp.arange(size), plan.ring)
      past = dit.apply(params, state.cache, positions, method="turn_keys")
      real = positions + base * size >= -state.past
      attn_mask = jnp.concatenate([_window_mask(blocks, held, plan, since) & real, attn_mask], axis=-1)

    control = None
    if self.control is not None:
      control = jax.lax.dynamic_slice_in_dim(self.control, (base - self.control_first) * size, active * size, axis=1)

    def velocity_at(latents, now):
      t = jnp.repeat(constants.times[now], size)
      modulation = jnp.repeat(constants.modulation[:, now], size, axis=1)[:, None]
      x = jnp.concatenate([latents, latents]) if plan.guided else latents
      velocity, new = dit.apply(params, x, t[None], modulation, text, attn_mask, within, past,
                                control, method="window")
      if plan.guided:
        with_text, without = jnp.split(velocity, 2)
        velocity = combine(with_text, without, scale)
      return velocity.astype(latents.dtype), new

    def iteration(latents, i):
      now = jnp.clip(level + i, 0, plan.num_steps)
      then = jnp.clip(level + i + 1, 0, plan.num_steps)
      velocity, new = velocity_at(latents, now)
      if constants.steps is not None:  # the network says noise
        fresh: Any = 0.0
        if plan.solver == "ancestral":
          fresh = fresh_noise(keys, blocks, now, plan, dit.latent_dim).astype(latents.dtype)
        spread = lambda a: jnp.repeat(a, size)
        moved = ddpm_forcing.step(constants.steps, latents, velocity, spread(now), spread(then), fresh)
        return moved, jax.tree.map(lambda a: a[:, :size], new)
      step = jnp.repeat(constants.times[then] - constants.times[now], size)[:, None]
      if plan.solver == "heun":
        velocity = (velocity + velocity_at(latents + step * velocity, then)[0]) / 2
      step = step * velocity
      if self.guide is not None:
        # In every second iteration, for two of them, which costs half; the one that finishes a block is among them.
        every, last = min(plan.lag, 2), (plan.num_steps - 1) % plan.lag
        moves, t = jnp.repeat(now < then, size), jnp.repeat(constants.times[now], size)
        share = jnp.repeat(constants.times[then] - constants.times[now], size) / jnp.where(moves, 1 - t, 1.0)
        pull = jax.lax.cond((i - last) % every == 0, lambda: self.guide.pull(
            state.behind, base * size, latents, velocity, t, moves).astype(latents.dtype), lambda: 0 * latents)
        step += jnp.minimum(every * share, 1.0)[:, None] * pull
      return latents + step, jax.tree.map(lambda a: a[:, :size], new)

    window, oldest = jax.lax.scan(iteration, state.latents[:, :active * size], jnp.arange(plan.lag))
    latents = state.latents.at[:, :active * size].set(window)
    finished = jnp.maximum(state.steps - age + 1, 0)  # the block that became clean in this step
    block = jax.lax.dynamic_slice_in_dim(latents, (finished - base) * size, size, axis=1)

    # The window moves on once its oldest block has been computed at t = 1.
    moves = state.steps >= age
    cache = jax.tree.map(
        lambda ring, new: jnp.where(moves, jax.lax.dynamic_update_slice_in_dim(
            ring, new[-1].astype(ring.dtype), base % plan.ring * size, axis=1), ring), state.cache, oldest)
    behind = state.behind
    if self.guide is not None:
      behind = jax.tree.map(lambda new, old: jnp.where(moves, new, old), self.guide.move_on(behind, latents[:, :size]),
                            behind)
    noise = block_noise(keys, base + plan.width, plan, dit.latent_dim).astype(latents.dtype)
    latents = jnp.where(moves, jnp.concatenate([latents[:, size:], noise], axis=1), latents)
    return Stream(state.steps + 1, latents, cache, state.past, behind), block, state.steps >= age - 1

  def sample(self, num_blocks: int, *, buckets: int = 2, segment: Int[Array, "b {num_blocks}"] | None = None,
             state: Stream | None = None) -> Float[Array, "b l c"]:
    """Clean latents (B, num_blocks * block, C), all in one trace: `lax.scan` over `step`.

    segment: see `window_captions`. state: one of `prefill`, to go on from a past; `init` if left out.
    """
    plan = self.plan
    runs, blocks, since = segments(plan, num_blocks, buckets, state is not None), [], seen_since(plan, segment)
    state = self.init() if state is None else state
    for count, active, use_cache in runs:

      def body(state, _, active=active, use_cache=use_cache):
        base = jnp.maximum(state.steps - plan.age, 0)
        words, caption = window_captions(plan, self.text, segment, base, active)
        sees = None if since is None else since[:, jnp.clip(base + jnp.arange(active), 0, num_blocks - 1)]
        sampler = dataclasses.replace(self, text=words)
        state, block, _ = sampler.step(state, active=active, use_cache=use_cache, caption=caption, since=sees)
        return state, block

      state, made = jax.lax.scan(body, state, None, length=count)
      blocks.append(made)
    made = jnp.concatenate(blocks)[plan.age - 1:]  # (num_blocks, B, block, C)
    return jnp.moveaxis(made, 0, 1).reshape(len(self.keys), num_blocks * plan.block, self.dit.latent_dim)


def bind(dit: FrameWiseNetwork, plan: Plan, params: Any, *, text_emb: Float[Array, "b *g s e"] | None = None,
         text_mask: Bool[Array, "b *g s"] | None = None, scale: Any = 1.0, keys: jax.Array,
         control: Float[Array, "b l n"] | None = None) -> Sampler:
  """A sampler for captions text_emb (B, S, E), text_mask (B, S), or G of them a motion, see `encode_text`; None for a
  network without captions. control (B, L, N): of `control.conditioning.features`."""
  return Sampler(dit, plan, params, make_constants(dit, params, plan),
                 None if text_emb is None or text_mask is None else encode_text(
                     dit, params, text_emb, text_mask, plan.guided), scale, keys,
                 None if control is None else control_tokens(dit, plan, params, control))


def control_tokens(dit: Net, plan: Plan, params: Any, control: Float[Array, "b l n"]) -> Float[Array, "b _ width"]:
  """The embedded control (B, L, N) for all layers; zeros for later latents that a window reaches."""
  tokens = dit.apply(params, control, method="control_tokens")
  return jnp.pad(tokens, ((0, 0), (0, plan.width * plan.block), (0, 0)))
