"""Motion from CMDM's denoiser as pure functions: frame-wise sampling, and the plain loop it is tested against."""
import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from motion_jax.control import conditioning
from motion_jax.control.signal import ControlSignal
from motion_jax.diffusion import guidance, samplers, schedules
from motion_jax.diffusion.paths import add_noise, velocity_to_x1
from motion_jax.latents import VaeCodec
from motion_jax.models.cmdm import ddpm_forcing, streaming
from motion_jax.models.cmdm.guiding import Behind, Guide
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.masks import padding_mask, sliding_mask
from motion_jax.shapes import Array, AttentionMask, Bool, Float, Int, Latents


def generate(dit: CausalDiT, plan: streaming.Plan, num_blocks: int, params: Any, codec: VaeCodec, *,
             text_emb: Float[Array, "b *g s e"], text_mask: Bool[Array, "b *g s"], scale: Any, keys: jax.Array,
             segment: Int[Array, "b {num_blocks}"] | None = None, lengths: Int[Array, " b"] | None = None,
             control: ControlSignal | None = None, guide: Guide | None = None) -> Float[Array, "b t f"]:
  """Normalized features (B, frames, F) of num_blocks blocks, by frame-wise sampling (lag < num_steps) or block after
  block (lag = num_steps). keys (B,): one per motion. Pure; dit, plan and num_blocks are static.

  With segment (B, num_blocks), text_emb (B, G, S, E) and text_mask (B, G, S) are G captions a motion, and segment says
  which of them each block has. lengths (B,): latents of each motion, after which nothing is attended to; None: whole
  blocks. control: constraints of the generated frames, for a network that was trained on constraints; guide: guidance
  over as many frames, for any network.
  """
  sampler = streaming.bind(dit, plan, params, text_emb=text_emb, text_mask=text_mask, scale=scale, keys=keys,
                           control=control_emb_of(codec, control), lengths=lengths)
  if guide is None:
    return codec.decode(sampler.sample(num_blocks, segment=segment))
  guide = guide.over((num_blocks + plan.width) * plan.block * codec.frames_per_latent)  # as far as a window reaches
  return codec.decode(guide.settle(dataclasses.replace(sampler, guide=guide).sample(num_blocks, segment=segment)))


def generate_whole(dit: CausalDiT, plan: streaming.Plan, num_blocks: int, params: Any, codec: VaeCodec, *,
                   text_emb: Float[Array, "b *g s e"], text_mask: Bool[Array, "b *g s"], scale: Any, keys: jax.Array,
                   segment: Int[Array, "b {num_blocks}"] | None = None, lengths: Int[Array, " b"] | None = None,
                   control: ControlSignal | None = None, guide: Guide | None = None) -> Float[Array, "b t f"]:
  """The same by the plain loop over all latents at once; a plan of lag 0 cleans them all together.

  What `generate` is tested against, and the full-sequence schedule of the paper's ablation. guide pulls finished
  latents alone.
  """
  decode = lambda latents: codec.decode(latents if guide is None else guide.settle(latents))
  length = num_blocks * plan.block
  noise = jnp.concatenate([streaming.block_noise(keys, i, plan, dit.latent_dim) for i in range(num_blocks)], axis=1)
  if segment is not None:
    text_emb, text_mask = words_of_latents(text_emb, text_mask, jnp.repeat(segment, plan.block, axis=1))
  attn_mask = sliding_mask(length, plan.block, plan.context)
  since = streaming.seen_since(plan, segment)
  if since is not None:
    attn_mask &= jnp.arange(length) // plan.block >= jnp.repeat(since, plan.block, axis=1)[:, None, :, None]
  if lengths is not None:
    real = padding_mask(lengths, length)[:, None]
    attn_mask &= (real[..., None, :] & real[..., None]) | jnp.eye(length, dtype=bool)
  left = None
  if dit.time_left:
    ends = streaming.caption_ends(jnp.zeros((len(keys), num_blocks), int) if segment is None else segment,
                                  jnp.full(len(keys), length) if lengths is None else jnp.asarray(lengths), plan.block)
    left = jnp.repeat(ends, plan.block, axis=1) - jnp.arange(length)
  velocity = plain_velocity(dit, params, text_emb, text_mask, attn_mask, scale, plan.guided,
                            control_emb_of(codec, control), left)
  if plan.solver in ddpm_forcing.SOLVERS:
    # Parity: algorithm 2 of the paper, whose steps draw fresh noise; the code's, and our default, are Euler's.
    levels = schedules.staircase_levels(plan.num_steps, length, plan.lag, plan.block)
    steps, blocks = ddpm_forcing.make_steps(plan.num_steps, plan.solver), jnp.arange(num_blocks)
    fresh = lambda now: streaming.fresh_noise(keys, blocks, now[::plan.block], plan, dit.latent_dim)
    return decode(ddpm_forcing.sample(velocity, noise, levels, steps, fresh))
  times = jnp.asarray(schedules.staircase(plan.num_steps, length, plan.lag, plan.block))
  return decode(samplers.SOLVERS[plan.solver](velocity, noise, times))


def control_emb_of(codec: VaeCodec, control: ControlSignal | None) -> Float[Array, "b l n"] | None:
  """The embedded constraints of the latents of a motion; None without constraints."""
  return None if control is None else conditioning.features(control, codec.frames_per_latent)


def words_of_latents(text_emb: Float[Array, "b g s e"], text_mask: Bool[Array, "b g s"], segment: Int[Array, "b l"]
                     ) -> tuple[Float[Array, "b gs e"], Bool[Array, "b l gs"]]:
  """Words (B, G * S, E) and mask (B, L, G * S) that show each latent its own of G captions; segment (B, L)."""
  batch, count, words, _ = text_emb.shape
  mask = text_mask[:, None] & (segment[:, :, None, None] == jnp.arange(count)[:, None])
  return text_emb.reshape(batch, count * words, -1), mask.reshape(mask.shape[:2] + (-1,))


def plain_velocity(dit: CausalDiT, params: Any, text_emb: Float[Array, "b s e"], text_mask: Bool[Array, "b *l s"],
                   attn_mask: AttentionMask, scale: Any, guided: bool = True,
                   control: Float[Array, "b l n"] | None = None, left: Int[Array, "b l"] | None = None
                   ) -> Callable[..., jax.Array]:
  """velocity(x, t (L,)) of the network itself, recomputed completely in every call."""
  def velocity(x, t, drop):
    twice = lambda a: jnp.concatenate([a, a]) if drop.shape[0] > a.shape[0] > 1 else a
    emb = jnp.where(drop[:, None, None], 0.0, jnp.concatenate([text_emb] * (drop.shape[0] // text_emb.shape[0])))
    mask = jnp.concatenate([text_mask] * (drop.shape[0] // text_mask.shape[0]))
    control_emb = None if control is None else jnp.concatenate([control] * (drop.shape[0] // control.shape[0]))
    return dit.apply(params, x, jnp.broadcast_to(t, x.shape[:2]), emb, twice(attn_mask), mask, control_emb,
                     None if left is None else twice(left))

  if guided:
    return guidance.guided(velocity, scale)
  return lambda x, t: velocity(x, t, jnp.zeros(x.shape[0], bool))


def renoising_step(velocity: Callable[..., Array], x: Latents, t: Float[Array, " l"],
                   t_next: Float[Array, " l"], past: Float[Array, "b p c"], noise: Latents
                   ) -> Latents:
  """One step of the window x (B, P + N, C) from times t to t_next (P + N,); past (B, P, C), noise like x.

  A window holds P past latents and N new ones, blocks counted from its start. A step predicts the clean window, puts
  the given past in its place, and goes to the next level with fresh noise (docs/papers/cmdm.md#continuation): the
  sampler is stochastic, and the network sees no clean past. Our own way, a cache of the clean past, is
  `streaming.Sampler.prefill`.

  In the first step the network sees noise in place of the past, which is inserted after each prediction.
  """
  # Parity: the paper keeps a clean past in the context (equation 12); this is what the code does.
  t, t_next = (jnp.broadcast_to(a, x.shape[:2]) for a in (t, t_next))
  x1 = jnp.asarray(velocity_to_x1(x, velocity(x, t[0]), t))
  x1 = x1.at[:, :past.shape[1]].set(past.astype(x.dtype))
  return add_noise(x1, noise, t_next)


def renoised(velocity: Callable[..., Array], x: Latents, times: Float[Array, "n l"],
             past: Float[Array, "b p c"], fresh: Callable[[Any], Array]) -> Latents:
  """Carries noise x (B, P + N, C) to data after a clean past (B, P, C) along times (M + 1, P + N).

  velocity(x, t (P + N,)) -> like x; fresh(m) is the new noise of step m, m a traced integer. The window comes back
  whole, its first P latents those given.
  """
  def body(x, interval):
    m, t, t_next = interval
    return renoising_step(velocity, x, t, t_next, past, fresh(m)), None

  return jax.lax.scan(body, x, (jnp.arange(len(times) - 1), times[:-1], times[1:]))[0]


def chained(dit: CausalDiT, plan: streaming.Plan, params: Any, *, text_emb: Float[Array, "b s e"],
            text_mask: Bool[Array, "b *l s"], scale: Any, lengths: Int[Array, " b"], past: Float[Array, "b p c"],
            noise: Float[Array, "b l c"], fresh: Callable[[Any], Array], times: Float[Array, "m l"] | None = None,
            since: Int[Array, "b l"] | None = None, until: Int[Array, "b l"] | None = None) -> Float[Array, "b n c"]:
  """New latents (B, N, C) after a past (B, P, C) as the released code makes them: plain recompute, past re-noised.
  text_mask (B, S), or (B, P + N, S) where latents have captions of their own.

  noise (B, P + N, C) and fresh(m) alike: see `renoised`; lengths (B,) of the new latents, those beyond
  mean nothing. P = 0 is the first segment of a chain, an ordinary run. Positions restart in every segment, and
  blocks count from the window's start. since (B, P + N): the first latent that each sees; None: any. until (B, P + N):
  the latent with which the caption of each ends, for a network with time_left; None: unknown.
  """
  length, given = noise.shape[1], past.shape[1]
  if times is None:
    times = jnp.asarray(schedules.staircase(plan.num_steps, length, plan.lag, plan.block))
  context = plan.context + -(-given // plan.block) * plan.block  # the past comes on top, 1 + 48 in the code
  attn_mask = sliding_mask(length, plan.block, context) & padding_mask(given + lengths, length)[:, None, None, :]
  if since is not None:
    attn_mask &= jnp.arange(length) >= since[:, None, :, None]
  left = None if until is None else until - jnp.arange(length)
  velocity = plain_velocity(dit, params, text_emb, text_mask, attn_mask, scale, plan.guided, left=left)
  if not given:
    return samplers.euler(velocity, noise, times)
  return renoised(velocity, noise, times, past, fresh)[:, given:]


def chain_segment(dit: CausalDiT, plan: streaming.Plan, length: int, params: Any, *, text_emb: Float[Array, "b s e"],
                  text_mask: Bool[Array, "b *l s"], scale: Any, lengths: Int[Array, " b"], past: Float[Array, "b p c"],
                  keys: jax.Array, since: Int[Array, "b l"] | None = None, until: Int[Array, "b l"] | None = None
                  ) -> Float[Array, "b n c"]:
  """`chained` for a window of `length`, past included; its noise belongs to a motion's key and a latent's place."""
  def fresh(m):
    keys_now = jax.vmap(lambda key: jax.random.fold_in(key, m))(keys)
    blocks = [streaming.block_noise(keys_now, i, plan, dit.latent_dim) for i in range(-(-length // plan.block))]
    return jnp.concatenate(blocks, axis=1)[:, :length]

  return chained(dit, plan, params, text_emb=text_emb, text_mask=text_mask, scale=scale, lengths=lengths, past=past,
                 noise=fresh(0), fresh=lambda m: fresh(m + 1), since=since, until=until)


def block_words(dit: CausalDiT, guided: bool, params: Any, text_emb: Float[Array, "b g s e"],
                text_mask: Bool[Array, "b g s"]) -> tuple[Any, Any, Any]:
  """Keys, values and constant of captions, see `streaming.encode_text`, as a bare tuple: a cached program cannot return
  a named tuple that is not among its arguments."""
  text = streaming.encode_text(dit, params, text_emb, text_mask, guided)
  return text.k, text.v, text.null


def block_constants(dit: CausalDiT, plan: streaming.Plan, rows: int, params: Any) -> tuple:
  """`streaming.make_constants` as a bare tuple."""
  return tuple(streaming.make_constants(dit, params, plan, rows))


def block_control(dit: CausalDiT, codec: VaeCodec, params: Any, control: ControlSignal, start: Float[Array, "b 3"]
                  ) -> Float[Array, "b l n"]:
  """`CausalDiT.control_tokens` of constraints on the frames from here on, where a body stands at start: x, z and
  heading."""
  features = conditioning.features(control, codec.frames_per_latent, start)
  return jnp.asarray(dit.apply(params, features, method="control_tokens"))


def block_pull(guide: Guide, behind: tuple, base: Any, latents: Float[Array, "b w c"], variance: Float[Array, "1 w 1"],
               num_steps: Any, tolerance: Any) -> Float[Array, "b w c"]:
  """`Guide.newton_step`, given a bare tuple."""
  return guide.newton_step(Behind(*behind), base, latents, variance, num_steps, tolerance)
