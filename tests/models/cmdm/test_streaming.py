"""The fast sampler gives the plain one's numbers: whole, streamed, past its cache, with words that change."""
import dataclasses
import functools
import types

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import samplers
from motion_jax.diffusion.schedules import staircase, staircase_levels
from motion_jax.models import cmdm
from motion_jax.models.cmdm import offline, streaming
from motion_jax.nets.masks import block_causal_mask, padding_mask, sliding_mask
from tests import fixtures
from tests.golden import check, golden, recordings
from tests.nets.test_causal_dit import captions, network, small

SCALE = 3.0
make_constants = jax.jit(streaming.make_constants, static_argnums=(0, 2))
encode_text = jax.jit(streaming.encode_text, static_argnums=(0, 4))


@functools.partial(jax.jit, static_argnums=(0, 8, 9))
def whole(dit, params, text_emb, text_mask, attn_mask, noise, times, scale, solver=samplers.euler, guided=True):
  """The plain sampler: everything recomputed in every step, both branches with all their words."""
  return solver(cmdm.plain_velocity(dit, params, text_emb, text_mask, attn_mask, scale, guided), noise, times)


@golden("sampling")
def run_sampling(fixture, dtype):
  dit, params = network(fixture, dtype)
  made = {}
  for name, (num_steps, lag, length, block) in fixture.config["runs"].items():
    # The float64 recording has times of that precision.
    times = 1 - (num_steps - staircase_levels(num_steps, length, lag, block)) / num_steps
    times = np.asarray(times if dtype == jnp.float64 else staircase(num_steps, length, lag, block), dtype)
    mask = block_causal_mask(length, block) & padding_mask(fixture[f"in/lengths/{name}"], length)[:, None, None, :]
    x, states = jnp.asarray(fixture[f"in/noise/{name}"], dtype), []
    for m in range(len(times) - 1):
      x = whole(dit, params, *captions(fixture, dtype), mask, x, times[m:m + 2], fixture.config["scale"])
      states.append(x)
    made |= {f"levels/{name}": times[:-1], f"states/{name}": np.stack(states), f"final/{name}": x}
  return made


@pytest.mark.slow
@recordings("sampling")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


# --- against the plain sampler -----------------------------------------------------------------------------------

def setting(num_steps, lag, block, context, num_blocks=None, batch=2, guided=True, **fields):
  """A random network and all that the step needs."""
  dit, params = small(block=block, **fields)
  plan = streaming.make_plan(num_steps, lag, block, context, num_blocks, guided)
  keys = jax.vmap(jax.random.key)(jnp.arange(batch))
  text_emb = jax.random.normal(jax.random.key(9), (batch, 4, dit.text_dim))
  text_mask = jnp.arange(4) < jnp.array([[4], [2], [3]])[:batch]
  # A gentle network: a random one multiplies a step's rounding by its steepness.
  params = jax.tree.map(lambda a: 0.5 * a, params)
  constants = make_constants(dit, params, plan)
  return dit, plan, params, constants, text_emb, text_mask, keys


@functools.partial(jax.jit, static_argnums=(0, 1, 7))
def fast(dit, plan, params, constants, text, scale, keys, num_blocks, segment=None):
  return streaming.Sampler(dit, plan, params, constants, text, scale, keys).sample(num_blocks, segment=segment)


@functools.partial(jax.jit, static_argnums=(1, 2, 3))
def noise_of(keys, plan, num_blocks, channels=5):
  """The noise that a motion of this number of blocks begins with (B, L, C)."""
  return jnp.concatenate([streaming.block_noise(keys, i, plan, channels) for i in range(num_blocks)], axis=1)


step = jax.jit(streaming.Sampler.step)


def streamed(dit, plan, params, constants, text, keys, num_blocks, scale=SCALE, segment=None):
  """Block after block from a loop, as a live player would ask for them; -> (latents, state)."""
  sampler = streaming.Sampler(dit, plan, params, constants, text, scale, keys)
  state, blocks, caption = sampler.init(), [], None
  for at in range(plan.age + num_blocks - 1):
    if segment is not None:
      window = max(at - plan.age, 0) + np.arange(plan.width)
      caption = jnp.asarray(segment[:, np.minimum(window, num_blocks - 1)])
    since = streaming.seen_since(plan, segment)
    sees = None if since is None else since[:, np.minimum(window, num_blocks - 1)]
    state, block, done = step(sampler, state, caption=caption, since=sees)
    if done:
      blocks.append(block)
  return np.concatenate(blocks, axis=1), state


def assert_close(made, expected, bound):
  difference = np.abs(np.asarray(made) - np.asarray(expected)).max() / max(1, np.abs(expected).max())
  assert difference < bound, difference


@pytest.mark.parametrize("num_steps, lag, block, context, num_blocks, solver", [
    pytest.param(8, 2, 3, 48, 2, "euler", id="shorter than the window"),
    pytest.param(7, 3, 3, 9, 9, "euler", id="past the cache, lag does not divide"),
    pytest.param(4, 4, 1, 3, 9, "euler", id="autoregressive past the cache"),
    pytest.param(4, 2, 3, 6, 4, "heun", id="heun")])
@pytest.mark.slow
def test_fast_is_plain_and_streaming_is_offline(num_steps, lag, block, context, num_blocks, solver):
  """test_any_network.py has the quick proof, with a network of one layer."""
  dit, plan, params, constants, text_emb, text_mask, keys = setting(num_steps, lag, block, context, num_blocks)
  plan, text = plan._replace(solver=solver), encode_text(dit, params, text_emb, text_mask)
  made = fast(dit, plan, params, constants, text, SCALE, keys, num_blocks)
  length = num_blocks * block
  noise, times = noise_of(keys, plan, num_blocks), staircase(num_steps, length, lag, block)
  expected = whole(dit, params, text_emb, text_mask, sliding_mask(length, block, context), noise, times, SCALE,
                   samplers.SOLVERS[solver])
  assert made.shape == (2, length, 5) and np.abs(expected - noise).max() > 0.1
  assert_close(made, expected, 1e-5)
  endless = streaming.make_plan(num_steps, lag, block, context, solver=solver)
  assert_close(streamed(dit, endless, params, constants, text, keys, num_blocks)[0], made, 2e-6)
  half = dit.clone(dtype=jnp.bfloat16)  # the network may compute in 16 bits, latents stay in 32
  in_half = lambda params: fast(half, plan, params, streaming.make_constants(half, params, plan), streaming.encode_text(
      half, params, text_emb, text_mask), SCALE, keys, num_blocks)
  assert jax.eval_shape(in_half, params).dtype == jnp.float32


@pytest.mark.slow
def test_a_two_way_window_is_cached_as_well_and_sees_no_latents_behind_the_end():
  """Motions that end inside a block and with the last one, past the cache: each is the plain loop over its latents."""
  num_blocks, ends = 7, np.array([9, 14])
  dit, plan, params, constants, text_emb, text_mask, keys = setting(7, 3, 2, 8, num_blocks, two_way=True)
  text = encode_text(dit, params, text_emb, text_mask)
  sampler = streaming.Sampler(dit, plan, params, constants, text, SCALE, keys, lengths=ends)
  made, noise = jax.jit(lambda sampler: sampler.sample(num_blocks))(sampler), noise_of(keys, plan, num_blocks)
  for row, end in enumerate(ends):
    own = slice(row, row + 1)
    expected = whole(dit, params, text_emb[own], text_mask[own], sliding_mask(14, 2, 8)[..., :end, :end],
                     noise[own, :end], staircase(7, 14, 3, 2)[:, :end], SCALE)
    assert_close(made[own, :end], expected, 1e-5)
  assert_close(fast(dit, plan, params, constants, text, SCALE, keys, num_blocks)[1], made[1], 2e-6)  # 14 if left out
  state, blocks = sampler.init(), []
  for _ in range(plan.age + num_blocks - 1):
    state, block, done = step(sampler, state)
    blocks += [block] if done else []
  assert_close(np.concatenate(blocks, axis=1)[0, :9], made[0, :9], 2e-6)
  causal = fast(dit.clone(two_way=False), plan, params, constants, text, SCALE, keys, num_blocks)
  assert np.abs(causal[1] - made[1]).max() > 1e-3


@pytest.mark.parametrize("memory, guided", [(None, True), (0, True), (6, False)])
@pytest.mark.slow
def test_every_block_has_its_own_words_and_new_ones_look_back_no_farther_than_the_memory(memory, guided):
  """Cached = recomputed = streamed, for two motions whose words change at different blocks, past the cache; with no
  memory what came before decides nothing."""
  block, num_blocks = 3, 9
  dit, plan, params, constants, _, _, keys = setting(6, 2, block, 12, num_blocks, guided=guided)
  text_emb = jax.random.normal(jax.random.key(7), (2, 5, 4, dit.text_dim))  # five captions for each motion
  text_mask = np.arange(4) < 1 + (np.arange(5)[:, None] + np.arange(2)[:, None, None]) % 4
  text = encode_text(dit, params, text_emb, text_mask, guided)
  segment = np.stack([np.sort(np.arange(num_blocks) % 4), np.arange(num_blocks) // 5]).astype(np.int32)
  plan = streaming.make_plan(6, 2, block, 12, num_blocks, guided, memory=memory)
  made = fast(dit, plan, params, constants, text, SCALE, keys, num_blocks, segment)

  length = num_blocks * block
  begins = np.array([[np.argmax(row == value) for value in row] for row in segment])
  since = np.repeat(np.where(begins, begins * block - (length if memory is None else memory), 0), block, axis=1)
  mask = sliding_mask(length, block, 12) & (np.arange(length) >= since[..., None])[:, None]
  words = cmdm.words_of_latents(text_emb, text_mask, jnp.repeat(segment, block, axis=1))
  assert_close(made, whole(dit, params, *words, mask, noise_of(keys, plan, num_blocks), staircase(6, length, 2, block),
                           SCALE, guided=guided), 1e-5)
  endless = streaming.make_plan(6, 2, block, 12, guided=guided, memory=memory)
  assert_close(streamed(dit, endless, params, constants, text, keys, num_blocks, segment=segment)[0], made, 2e-6)

  if memory == 0:
    other = encode_text(dit, params, text_emb.at[:, 0].add(1.0), text_mask, guided)
    changed = np.abs(fast(dit, plan, params, constants, other, SCALE, keys, num_blocks, segment) - made).max(2)
    first = np.repeat(segment == 0, block, axis=1)
    assert (changed[~first] < 2e-6).all() and (changed[first] > 1e-4).all()


def test_what_a_window_shows_and_a_block_sees():
  plan = streaming.make_plan(6, 2, 3, 12, memory=3)
  since = streaming.seen_since(plan, np.array([[0, 0, 1, 1, 2]]))
  assert since[0, 2:].tolist() == [1, 1, 3] and (since[0, :2] < -1000).all()  # the first words: all that was given
  segment = np.array([[0, 0, 0, 1, 1, 2, 3, 4, 4, 4]])
  assert [offline.captions_seen(segment, width) for width in (1, 2, 3, 4, 10)] == [1, 2, 4, 4, 8]
  assert offline.captions_seen(np.zeros((2, 5), int), 3) == 1


@pytest.mark.slow
def test_an_endless_stream_stays_as_it_is():
  """Shapes do not grow, nothing compiles again, and hour 1000 is computed to the bit as minute one."""
  dit, plan, params, constants, text_emb, text_mask, keys = setting(6, 2, 3, 12)
  text = encode_text(dit, params, text_emb, text_mask)
  sampler = streaming.Sampler(dit, plan, params, constants, text, SCALE, keys)
  start = jax.tree.map(jnp.shape, sampler.init())
  _, state = streamed(dit, plan, params, constants, text, keys, 12)
  compiled = step._cache_size()
  _, state = streamed(dit, plan, params, constants, text, keys, 40)
  assert step._cache_size() == compiled and jax.tree.map(jnp.shape, state) == start
  assert bool(jnp.isfinite(state.latents).all())

  late = state._replace(steps=state.steps + plan.ring * 100_000)
  (now, block, _), (then, late_block, _) = step(sampler, state), step(sampler, late)
  np.testing.assert_array_equal(block, late_block)
  chex.assert_trees_all_equal(now.cache, then.cache)
  # Only the noise of the block that comes in knows how late it is.
  np.testing.assert_array_equal(now.latents[:, :-3], then.latents[:, :-3])
  assert float(jnp.abs(now.latents[:, -3:] - then.latents[:, -3:]).max()) > 0.1


def test_noise_belongs_to_key_place_and_step():
  """A DDPM's steps add noise that is new in every block and step."""
  plan, keys = streaming.make_plan(4, 2, 3, 12), jax.vmap(jax.random.key)(jnp.arange(2))
  draw = jax.jit(lambda keys, index: streaming.block_noise(keys, index, plan, 5))
  noise = np.concatenate([draw(keys, i) for i in range(200)], axis=1)
  assert noise.shape == (2, 600, 5) and abs(noise.mean()) < 0.05 and abs(noise.std() - 1) < 0.05
  np.testing.assert_array_equal(draw(keys[1:], 7), noise[1:, 21:24])
  draw = jax.jit(lambda keys, blocks, levels: streaming.fresh_noise(keys, blocks, levels, plan, 5))
  fresh = np.asarray(draw(keys, np.array([0, 1, 0, 7]), np.array([0, 0, 1, 3])))
  assert fresh.shape == (2, 12, 5)
  values = np.concatenate([np.ravel(noise[:, :6]), np.ravel(fresh)])
  assert len(np.unique(values)) == len(values)
  np.testing.assert_array_equal(draw(keys[1:], np.array([7]), np.array([3]))[0], fresh[1, 9:])


def test_bad_plans_and_pasts_are_refused():
  for bad, words in ((dict(lag=0), "lag 0"), (dict(lag=60), "lag <= num_steps"), (dict(num_steps=0), "num_steps 0"),
                     (dict(context=10), "whole blocks of 3"), (dict(context=0), "whole blocks"),
                     (dict(memory=4), "memory of 4 latents, expected whole blocks of 3"),
                     (dict(solver="dopri"), "euler, heun")):
    with pytest.raises(ValueError, match=words):
      streaming.make_plan(**(dict(num_steps=50, lag=2, block=3, context=48) | bad))
  plan = streaming.make_plan(6, 2, 3, 12, memory=6)
  assert plan.memory == 2
  sampler = streaming.Sampler(small()[0], plan, None, streaming.Constants(None, None), None, SCALE,
                              np.zeros((2, 2), np.uint32))
  with pytest.raises(ValueError, match="whole blocks of 3"):
    sampler.prefill(sampler.init(), past=jnp.zeros((2, 4, 5)), count=4)


@pytest.mark.slow
@pytest.mark.parametrize("lengths", [None, (11, 10)])
def test_latents_that_know_how_many_are_left(lengths):
  """Cached sampling, with captions that change, is the plain loop; rows of zeros are no embedding."""
  dit, plan, params, constants, text_emb, text_mask, keys = setting(6, 2, 3, 12, time_left=True)
  rows = jax.random.normal(jax.random.key(5), params["params"]["time_left_rows"].shape) * 0.5
  params = {"params": params["params"] | {"time_left_rows": rows}}
  emb, mask = jnp.stack([text_emb, text_emb[::-1]], 1), jnp.stack([text_mask, text_mask[::-1]], 1)
  segment = jnp.array([[0, 0, 1, 1], [0, 1, 1, 1]])
  codec = types.SimpleNamespace(decode=lambda z: z, frames_per_latent=4)
  lengths = None if lengths is None else jnp.array(lengths)
  run = lambda function, dit, params: np.asarray(function(
      dit, plan, 4, params, codec, text_emb=emb, text_mask=mask, scale=SCALE, keys=keys, segment=segment,
      lengths=lengths))[:, :10]
  cached = run(cmdm.generate, dit, params)
  np.testing.assert_allclose(cached, run(cmdm.generate_whole, dit, params), atol=2e-5)
  plain = {"params": {name: value for name, value in params["params"].items() if name != "time_left_rows"}}
  without = run(cmdm.generate, dataclasses.replace(dit, time_left=False, parent=None), plain)
  zeros = {"params": params["params"] | {"time_left_rows": 0 * rows}}
  np.testing.assert_array_equal(run(cmdm.generate, dit, zeros), without)
  assert np.abs(cached - without).max() > 1e-3


def test_ends_of_captions():
  segment = np.array([[0, 0, 1, 1], [0, 1, 2, 2]])
  ends = streaming.caption_ends(segment, np.array([11, 20]), 3)
  assert ends.tolist() == [[6, 6, 11, 11], [3, 6, 20, 20]]
  now = streaming.window_at(streaming.make_plan(6, 2, 3, 12, 4, False), 0, 0, segment, until=ends)
  assert now.left[0].tolist()[:12] == [6, 5, 4, 3, 2, 1, 5, 4, 3, 2, 1, 0]
  unknown = np.full((1, 4), streaming.ENDLESS)
  assert (streaming.window_at(streaming.make_plan(6, 2, 3, 12, 4, False), 0, 0, segment[:1], until=unknown).left
          == -1).all()
