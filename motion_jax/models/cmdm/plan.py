"""The choices of frame-wise sampling, and the position of a step among its blocks."""
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.diffusion.samplers import SOLVERS
from motion_jax.models.cmdm import ddpm_forcing
from motion_jax.shapes import Array, Int

ENDLESS = 2**30  # latents of a motion without end
_ANY = -2**30  # before all blocks that there are


class Layout(NamedTuple):
  """The choices that the program of a step depends on; hashable, so that jit can specialize on it."""
  block: int    # latents per block
  context: int  # latents that a latent attends to
  width: int    # blocks in the window
  guided: bool
  solver: str = "euler"

  @property
  def ring(self) -> int:
    """Blocks in the cache."""
    return max(self.context // self.block - 1, 1)


class Plan(NamedTuple):
  """All choices of frame-wise sampling; hashable."""
  num_steps: int
  lag: int      # iterations between the starts of two blocks; num_steps is autoregressive
  block: int    # latents per block
  context: int  # latents that a latent attends to
  width: int    # blocks in the window
  guided: bool
  solver: str = "euler"
  memory: int | None = None  # blocks before a caption's first one that its blocks see; None: all within the context

  @property
  def layout(self) -> Layout:
    return Layout(self.block, self.context, self.width, self.guided, self.solver)

  @property
  def age(self) -> int:
    """Steps after which a block is clean."""
    return -(-self.num_steps // self.lag)

  @property
  def ring(self) -> int:
    """Blocks in the cache."""
    return self.layout.ring

  def pulled(self, iteration: Any) -> Any:
    """Whether a guide pulls in an iteration of a step: in every second one, which costs half; the one that finishes a
    block is among them."""
    return (iteration - (self.num_steps - 1) % self.lag) % min(self.lag, 2) == 0

  def fitted(self, num_blocks: int) -> "Plan":
    """The same plan with a window no wider than a motion of this number of blocks."""
    return self._replace(width=min(self.width, num_blocks))


def make_plan(num_steps: int, lag: int, block: int, context: int, num_blocks: int | None = None, guided: bool = True,
              solver: str = "euler", memory: int | None = None) -> Plan:
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
  plan = Plan(num_steps, lag, block, context, -(-num_steps // lag) + 1, guided, solver,
              None if memory is None else memory // block)
  return plan.fitted(num_blocks) if num_blocks else plan


def seen_since(plan: Plan, segment: Int[Array, "b n"] | None) -> Int[Array, "b n"] | None:
  """The first block that each block attends to, by the plan's memory of blocks with other captions; None: no limit.

  segment (B, N): rising, which caption each block has. Blocks of the first caption attend to all that was given before.
  """
  if plan.memory is None or segment is None:
    return None
  xp = jnp if isinstance(segment, jax.Array) else np
  starts = xp.where(xp.diff(segment, axis=1, prepend=-1) != 0, xp.arange(segment.shape[1]), 0)
  begins = jax.lax.cummax(starts, axis=1) if xp is jnp else np.maximum.accumulate(starts, axis=1)
  return xp.where(begins == 0, _ANY, begins - plan.memory)


class Window(NamedTuple):
  """Position of a step in the stream, and its attention mask. Made by `streaming.window_at`, in
  numpy or inside of a trace."""
  steps: Any      # () how many steps were done before
  moves: Any      # () whether the window moves on to the next block
  slot: Any       # () where the block that left it goes in the cache, in latents
  blocks: Any     # (W,) the blocks of the window, counted from the first that is sampled
  levels: Any     # (W,) iterations that each has had; negative: not begun
  num_steps: Any  # () of a block
  attn_mask: Any  # (rows or 1, 1, W * block, (ring + W) * block) what latents see of cache and window
  positions: Any  # (ring * block,) of cached keys
  caption: Any    # (B, W) which of the captions each block has
  left: Any = None  # (rows, W * block) how many latents each one's caption has left, itself included; negative: unknown


def oldest_block(plan: Plan, steps: Any) -> Any:
  """The oldest block of the window after a number of steps; negative while a past is filled in."""
  xp = jnp if isinstance(steps, jax.Array) else np
  return xp.where(steps < 0, steps, xp.maximum(steps - plan.age, 0))


def caption_ends(segment: Int[Array, "b n"], lengths: Int[Array, " b"], size: int) -> Int[Array, "b n"]:
  """The latent with which the caption of each block ends. segment (B, N): rising, the caption of each block; lengths
  (B,): latents of each motion; size: latents of a block."""
  xp = jnp if any(isinstance(a, jax.Array) for a in (segment, lengths)) else np
  past = (segment[:, None, :] <= segment[:, :, None]).sum(-1) * size
  last = segment == segment[:, -1:]  # it may last longer than its blocks
  return xp.where(last, lengths[:, None], xp.minimum(past, lengths[:, None]))
