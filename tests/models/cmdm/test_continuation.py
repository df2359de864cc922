"""Going on from a past: the released way gives its recorded numbers, the cached way those of a plain recompute."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import samplers
from motion_jax.diffusion.schedules import staircase, staircase_levels
from motion_jax.models import cmdm
from motion_jax.models.cmdm import streaming
from motion_jax.nets.masks import sliding_mask
from tests import fixtures
from tests.golden import check, golden, recordings
from tests.models.cmdm.test_streaming import SCALE, assert_close, encode_text, noise_of, setting
from tests.nets.test_causal_dit import captions, network


@functools.partial(jax.jit, static_argnums=(0, 1))
def chained(dit, plan, params, fresh, **given):
  """fresh: the noise of each step (M, B, L, C), or None."""
  return cmdm.chained(dit, plan, params, fresh=fresh if fresh is None else fresh.__getitem__, **given)


prefill = jax.jit(streaming.Sampler.prefill)


@golden("continuation", leave_out=("levels/", "states/", "long/"))
def run_continuation(fixture, dtype):
  """The last state, which all others decide; a motion of several segments is no more than these one after another."""
  dit, params = network(fixture, dtype, fixture.config["block"])
  config, made = fixture.config, {}
  plan = streaming.make_plan(config["steps"], config["lag"], dit.block, 16 * dit.block)
  array = lambda name: np.asarray(fixture[name], dtype)  # numpy's slices compile nothing
  caption_emb, caption_mask = map(np.asarray, captions(fixture, dtype))

  def times_of(length):
    # The float64 recording has times of that precision.
    levels = staircase_levels(plan.num_steps, length, plan.lag, dit.block)
    return np.asarray(1 - (plan.num_steps - levels) / plan.num_steps, dtype) if dtype == jnp.float64 else (
        np.asarray(staircase(plan.num_steps, length, plan.lag, dit.block)))

  for name in config["prefixes"]:
    past, x, fresh = (array(f"in/{part}/{name}") for part in ("prefix", "noise", "fresh"))
    lengths, (batch, length, _) = jnp.asarray(fixture[f"in/lengths/{name}"]), x.shape
    made[f"final/{name}"] = chained(
        dit, plan, params, fresh, text_emb=caption_emb[:batch], text_mask=caption_mask[:batch], scale=config["scale"],
        lengths=lengths, past=past, noise=x, times=times_of(length))
  return made


@pytest.mark.slow
@recordings("continuation")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


# --- a clean past in the cache -----------------------------------------------------------------------------------


@functools.partial(jax.jit, static_argnums=0)
def whole_after(dit, params, text_emb, text_mask, attn_mask, past, noise, times, scale):
  """Plain: the past stands before the window, clean at t = 1, and everything is recomputed in every step."""
  given = past.shape[1]
  velocity = cmdm.plain_velocity(dit, params, text_emb, text_mask, attn_mask, scale)

  def behind(x, t):
    t = jnp.concatenate([jnp.ones(given), t])
    return velocity(jnp.concatenate([past, x], axis=1), t)[:, given:]

  return samplers.euler(behind, noise, times)


@pytest.mark.slow
def test_a_clean_past_is_kept_exactly():
  """Cached = recomputed, for a past that is longer than the cache and no whole number of blocks; behind it also for a
  motion whose last block is not whole."""
  given, context, num_blocks = 13, 9, 4
  dit, plan, params, constants, text_emb, text_mask, keys = setting(6, 2, 3, context, num_blocks)
  sampler = streaming.Sampler(dit, plan, params, constants, encode_text(dit, params, text_emb, text_mask), SCALE, keys)
  past = jax.random.normal(jax.random.key(5), (2, given, 5))
  front = -given % 3
  padded = jnp.pad(past, ((0, 0), (front, 0), (0, 0)), constant_values=9.0)  # garbage that nobody may see
  behind = lambda past: prefill(sampler, sampler.init(), past=past, count=given)
  run = jax.jit(lambda state: sampler.sample(num_blocks, state=state))
  made = run(behind(padded))

  length = 3 * num_blocks
  mask = sliding_mask(front + given + length, 3, context) & (np.arange(front + given + length) >= front)
  expected = whole_after(dit, params, text_emb, text_mask, mask, padded, noise_of(keys, plan, num_blocks),
                         staircase(6, length, 2, 3), SCALE)
  assert_close(made, expected, 1e-5)
  ended = jax.jit(lambda state: sampler.replace(lengths=np.full(2, length - 1)).sample(num_blocks, state=state))(
      behind(padded))
  shorter = whole_after(dit, params, text_emb, text_mask, mask[..., :-1, :-1], padded,
                        noise_of(keys, plan, num_blocks)[:, :-1], staircase(6, length - 1, 2, 3), SCALE)
  assert_close(ended[:, :-1], shorter, 1e-5)
  assert float(jnp.abs(run(behind(-padded)) - made).max()) > 1e-2  # the past matters
