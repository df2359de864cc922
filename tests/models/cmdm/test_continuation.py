"""Going on from a past: the released way gives its recorded numbers, the cached way those of a plain recompute."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import samplers
from motion_jax.diffusion.schedules import staircase, staircase_levels
from motion_jax.models import cmdm
from motion_jax.models.cmdm import continuation, streaming
from motion_jax.nets.masks import padding_mask, sliding_mask
from tests import fixtures
from tests.golden import check, golden, recordings
from tests.models.cmdm.test_streaming import SCALE, assert_close, encode_text, setting, step
from tests.nets.test_causal_dit import captions, network

chained = jax.jit(cmdm.chained, static_argnums=(0, 1))
prefill = jax.jit(streaming.Sampler.prefill)


@functools.partial(jax.jit, static_argnums=0)
def one_step(dit, params, text_emb, text_mask, attn_mask, scale, x, t, t_next, past, noise):
  velocity = cmdm.plain_velocity(dit, params, text_emb, text_mask, attn_mask, scale)
  return continuation.step(velocity, x, t, t_next, past, noise)


@golden("continuation")
def run_continuation(fixture, dtype):
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
    lengths, (batch, length, _), given = jnp.asarray(fixture[f"in/lengths/{name}"]), x.shape, past.shape[1]
    text = caption_emb[:batch], caption_mask[:batch]
    times = times_of(length)
    mask = sliding_mask(length, dit.block, 49 * dit.block) & padding_mask(given + lengths, length)[:, None, None, :]
    states = []
    for m in range(len(times) - 1):
      before = states[-1] if states else x
      states.append(one_step(dit, params, *text, mask, config["scale"], before, times[m], times[m + 1], past, fresh[m]))
    final = chained(dit, plan, params, text_emb=text[0], text_mask=text[1], scale=config["scale"], lengths=lengths,
                    past=past, noise=x, fresh=Replay(fresh), times=times)
    made |= {f"levels/{name}": times[:-1], f"states/{name}": np.stack(states), f"final/{name}": final}

  for name, one in config["longs"].items():
    latents = None
    for i, frames in enumerate(one["frames"]):
      noise = array(f"in/segment_noise/{name}/{i}")
      batch, past = noise.shape[0], noise[:, :0] if latents is None else latents[:, -one["past"]:]
      text_emb, text_mask = (np.repeat(a[i:i + 1], batch, axis=0) for a in (caption_emb, caption_mask))
      lengths = jnp.full(batch, max(1, frames // 4))
      fresh = Replay(array(f"in/segment_fresh/{name}/{i}")) if i else None
      new = chained(dit, plan, params, text_emb=text_emb, text_mask=text_mask, scale=config["scale"], lengths=lengths,
                    past=past, noise=noise, fresh=fresh, times=times_of(noise.shape[1]))
      latents = np.asarray(new) if latents is None else np.concatenate([latents, new], axis=1)
    made[f"long/{name}"] = latents
  return made


@jax.tree_util.register_pytree_node_class
class Replay:
  """Recorded noise (M, B, L, C) in the place of fresh draws."""

  def __init__(self, noise):
    self.noise = noise

  def __call__(self, m):
    return self.noise[m]

  def tree_flatten(self):
    return (self.noise,), None

  @classmethod
  def tree_unflatten(cls, _, leaves):
    return cls(*leaves)


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


@pytest.mark.parametrize("given, context, num_blocks", [
    (7, 48, 3), *(pytest.param(*sizes, marks=pytest.mark.slow) for sizes in ((12, 9, 8), (12, 48, 4), (1, 12, 5)))])
def test_a_clean_past_is_kept_exactly(given, context, num_blocks):
  """Cached = recomputed, for pasts of whole blocks and not, shorter and longer than the cache."""
  dit, plan, params, constants, text_emb, text_mask, keys = setting(6, 2, 3, context, num_blocks)
  sampler = streaming.Sampler(dit, plan, params, constants, encode_text(dit, params, text_emb, text_mask), SCALE, keys)
  past = jax.random.normal(jax.random.key(5), (2, given, 5))
  front = -given % 3
  padded = jnp.pad(past, ((0, 0), (front, 0), (0, 0)), constant_values=9.0)  # garbage that nobody may see
  behind = lambda past: prefill(sampler, sampler.init(), past=past, count=given)
  run = jax.jit(lambda state: sampler.sample(num_blocks, state=state))
  made = run(behind(padded))

  length = 3 * num_blocks
  noise = jnp.concatenate([streaming.block_noise(keys, i, plan, 5) for i in range(num_blocks)], axis=1)
  mask = sliding_mask(front + given + length, 3, context)
  mask = (mask & (jnp.arange(front + given + length) >= front))
  times = jnp.asarray(staircase(6, length, 2, 3))
  expected = whole_after(dit, params, text_emb, text_mask, mask, padded, noise, times, SCALE)
  assert_close(made, expected, 1e-5)
  assert float(jnp.abs(run(behind(-padded)) - made).max()) > 1e-2  # the past matters


def test_a_stream_goes_on_from_its_own_past(monkeypatch):
  """A run that is cut and prefilled with its own clean latents equals the uncut one: autoregressive, so that no block
  is under way at the cut."""
  dit, plan, params, constants, text_emb, text_mask, keys = setting(4, 4, 3, 12)
  sampler = streaming.Sampler(dit, plan, params, constants, encode_text(dit, params, text_emb, text_mask), SCALE, keys)
  run = lambda state, count: live(sampler, state, count)
  whole, _ = run(sampler.init(), 5)
  state = prefill(sampler, sampler.init(), past=whole[:, :9], count=9)
  draw = streaming.block_noise
  monkeypatch.setattr(streaming, "block_noise", lambda keys, index, *about: draw(keys, index + 3, *about))
  rest, _ = live(sampler, state, 2, jax.jit(lambda *given: streaming.Sampler.step(*given)))
  assert_close(rest, whole[:, 9:], 1e-5)


def live(sampler, state, num_blocks, step=step):
  plan, blocks = sampler.plan, []
  for _ in range(plan.age + num_blocks - 1):
    state, block, done = step(sampler, state)
    if done:
      blocks.append(block)
  return jnp.concatenate(blocks, axis=1), state


def test_padding_of_a_chain_is_invisible():
  """Latents beyond a segment's length change nothing in it."""
  dit, plan, params, _, text_emb, text_mask, keys = setting(4, 2, 3, 12, guided=False)
  past = jax.random.normal(jax.random.key(1), (2, 1, 5))
  results = []
  for length in (8, 14):
    draw = lambda m, length=length: jnp.concatenate(
        [streaming.block_noise(keys, 100 * m + i, plan, 5) for i in range(5)], axis=1)[:, :length]
    made = jax.jit(lambda noise, draw=draw: cmdm.chained(
        dit, plan, params, text_emb=text_emb, text_mask=text_mask, scale=SCALE, lengths=jnp.array([7, 4]), past=past,
        noise=noise, fresh=lambda m: draw(m + 1)))(draw(0))
    results.append(np.asarray(made))
  np.testing.assert_allclose(results[0][0, :7], results[1][0, :7], atol=2e-6)
  np.testing.assert_allclose(results[0][1, :4], results[1][1, :4], atol=2e-6)


def test_bad_pasts_are_told():
  dit, plan, params, constants, text_emb, text_mask, keys = setting(4, 2, 3, 12)
  sampler = streaming.Sampler(dit, plan, params, constants, encode_text(dit, params, text_emb, text_mask), SCALE, keys)
  with pytest.raises(ValueError, match="whole blocks of 3"):
    sampler.prefill(sampler.init(), past=jnp.zeros((2, 4, 5)), count=4)
