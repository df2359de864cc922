"""The fast sampler gives the plain one's numbers: whole, streamed, past its cache, alone or in a batch."""
import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import guidance, samplers
from motion_jax.diffusion.schedules import staircase, staircase_levels
from motion_jax.models import cmdm
from motion_jax.models.cmdm import offline, streaming
from motion_jax.nets.masks import block_causal_mask, padding_mask, sliding_mask
from tests import fixtures
from tests.golden import Fixture, check, golden, recordings
from tests.nets.test_causal_dit import captions, network, small

SCALE = 3.0
make_constants = jax.jit(streaming.make_constants, static_argnums=(0, 2))
encode_text = jax.jit(streaming.encode_text, static_argnums=(0, 4))


@functools.partial(jax.jit, static_argnums=(0, 8))
def whole(dit, params, text_emb, text_mask, attn_mask, noise, times, scale, solver=samplers.euler):
  """The plain sampler: everything recomputed in every step, both branches with all their words."""
  twice = lambda a: jnp.concatenate([a, a]) if a.shape[0] > 1 or noise.shape[0] == 1 else a

  def velocity(x, t, drop):
    text = jnp.where(drop[:, None, None], 0, twice(text_emb))
    return dit.apply(params, x, jnp.broadcast_to(t, x.shape[:2]), text, twice(attn_mask), twice(text_mask))

  return solver(guidance.guided(velocity, scale), noise, times)


# --- recorded trajectories ---------------------------------------------------------------------------------------


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


@recordings("sampling")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


@pytest.mark.parametrize("kind, name", [
    pytest.param(kind, name, marks=[] if kind == "float64" and name in ("fss", "ar") else pytest.mark.slow)
    for kind in ("float32", "float64") for name in ("fss", "ar", "fss_block1", "fss_partial", "one_block")])
def test_golden_fast(kind, name, monkeypatch):
  """The recorded results again, by window and cache; whole blocks, since it makes no others."""
  fixture = Fixture(fixtures.path("cmdm/sampling.npz"))
  num_steps, lag, length, block = fixture.config["runs"][name]
  num_blocks = -(-length // block)
  with jax.enable_x64(kind == "float64"), jax.default_matmul_precision("highest"):
    dtype = jnp.dtype(kind)
    dit, params = network(fixture, dtype, block)
    noise = jnp.asarray(fixture[f"in/noise/{name}"], dtype)
    noise = jnp.pad(noise, ((0, 0), (0, 100 * block), (0, 0)))
    monkeypatch.setattr(streaming, "block_noise", lambda keys, index, plan, channels: jax.lax.dynamic_slice_in_dim(
        noise, index * plan.block, plan.block, axis=1))
    plan = streaming.make_plan(num_steps, lag, block, 48, num_blocks)
    text = encode_text(dit, params, *captions(fixture, dtype))
    constants = make_constants(dit, params, plan)
    if kind == "float64":  # the recording's times have that precision too
      times = jnp.asarray(1 - np.arange(num_steps, -1, -1) / num_steps)
      constants = streaming.Constants(times, dit.apply(params, times, method="modulation"))
    keys = jnp.stack([jax.random.key(0)] * len(noise))
    sampler = streaming.Sampler(dit, plan, params, constants, text, fixture.config["scale"], keys)
    made = jax.jit(lambda: sampler.sample(num_blocks))()
  expected = fixture[f"{'out64' if kind == 'float64' else 'out'}/final/{name}"]
  compared = 0
  for sample, count in enumerate(fixture[f"in/lengths/{name}"]):
    real = count // block * block
    difference = np.abs(made[sample, :real] - expected[sample, :real]).max(initial=0)
    assert difference / max(1, np.abs(expected).max()) < (1e-10 if kind == "float64" else fixture.meta["tolerance"])
    compared += real
  assert compared or name == "one_block"


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
  return jnp.concatenate(blocks, axis=1), state


def assert_close(made, expected, bound):
  difference = np.abs(np.asarray(made) - np.asarray(expected)).max() / max(1, np.abs(expected).max())
  assert difference < bound, difference


PLANS = {  # num_steps, lag, block, context, num_blocks
    "frame-wise": (6, 2, 3, 48, 5), "shorter than the window": (8, 2, 3, 48, 2), "one block": (4, 2, 3, 48, 1),
    "past the cache, lag does not divide": (7, 3, 3, 9, 9), "context of one block": (4, 2, 1, 1, 6),
    "autoregressive past the cache": (4, 4, 1, 3, 9)}
# Recorded trajectories are frame-wise and autoregressive, a cache that is passed has a plan of its own, and one block,
# too, is shorter than the window.
REPEATED = {"frame-wise", "autoregressive past the cache", "shorter than the window", "one block",
            "context of one block"}


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=pytest.mark.slow) if name in REPEATED else name for name in PLANS])
def test_fast_is_plain_and_streaming_is_offline(name):
  num_steps, lag, block, context, num_blocks = PLANS[name]
  dit, plan, params, constants, text_emb, text_mask, keys = setting(num_steps, lag, block, context, num_blocks)
  text = encode_text(dit, params, text_emb, text_mask)
  made = fast(dit, plan, params, constants, text, SCALE, keys, num_blocks)
  length = num_blocks * block
  assert made.shape == (2, length, 5)

  noise = jnp.concatenate([streaming.block_noise(keys, i, plan, 5) for i in range(num_blocks)], axis=1)
  mask = sliding_mask(length, block, context)
  if length <= context:
    assert bool((mask == block_causal_mask(length, block)).all())
  times = jnp.asarray(staircase(num_steps, length, lag, block))
  expected = whole(dit, params, text_emb, text_mask, mask, noise, times, SCALE)
  assert float(jnp.abs(expected - noise).max()) > 0.1
  assert_close(made, expected, 1e-5)

  endless = streaming.make_plan(num_steps, lag, block, context)
  live, _ = streamed(dit, endless, params, constants, text, keys, num_blocks)
  assert_close(live, made, 2e-6)


# --- words that change on the way --------------------------------------------------------------------------------


def told(dit, params, batch=2, count=5):
  """Five captions for each motion, of different lengths: (text_emb, text_mask, keys and values)."""
  text_emb = jax.random.normal(jax.random.key(7), (batch, count, 4, dit.text_dim))
  text_mask = jnp.arange(4) < 1 + (jnp.arange(count)[:, None] + jnp.arange(batch)[:, None, None]) % 4
  return text_emb, text_mask, encode_text(dit, params, text_emb, text_mask)


@pytest.mark.parametrize("block, context, num_blocks", [
    (3, 9, 9), (1, 4, 14), (7, 14, 7)])
@pytest.mark.slow
def test_every_block_has_its_own_words(block, context, num_blocks):
  """Cached = recomputed = streamed, past the cache, for two motions whose words change at different blocks."""
  dit, plan, params, constants, _, _, keys = setting(6, 2, block, context, num_blocks)
  text_emb, text_mask, text = told(dit, params)
  segment = np.stack([np.sort(np.arange(num_blocks) % 5), np.arange(num_blocks) // 3]).astype(np.int32)
  made = fast(dit, plan, params, constants, text, SCALE, keys, num_blocks, segment)

  length = num_blocks * block
  noise = jnp.concatenate([streaming.block_noise(keys, i, plan, 5) for i in range(num_blocks)], axis=1)
  words, mask = cmdm.words_of_latents(text_emb, text_mask, jnp.repeat(segment, block, axis=1))
  times = jnp.asarray(staircase(6, length, 2, block))
  expected = whole(dit, params, words, mask, sliding_mask(length, block, context), noise, times, SCALE)
  assert_close(made, expected, 1e-5)

  endless = streaming.make_plan(6, 2, block, context)
  live, _ = streamed(dit, endless, params, constants, text, keys, num_blocks, segment=segment)
  assert_close(live, made, 2e-6)

  # What is said later changes nothing before, and something after.
  other = segment.copy()
  other[:, num_blocks // 2:] = 4
  later, _ = streamed(dit, endless, params, constants, text, keys, num_blocks, segment=other)
  same = num_blocks // 2 * block
  np.testing.assert_array_equal(live[0, :same], later[0, :same])
  assert float(jnp.abs(live[:, same:] - later[:, same:]).max()) > 1e-3

  # In another place and with a companion of other captions: as in the batch.
  twice = np.array([1, 1])
  text = encode_text(dit, params, text_emb[twice], text_mask[twice])
  again = fast(dit, plan, params, constants, text, SCALE, keys[twice], num_blocks, segment[twice])
  assert_close(again[:1], made[1:], 2e-6)


@pytest.mark.slow
def test_one_caption_for_all_is_the_plain_run():
  dit, plan, params, constants, text_emb, text_mask, keys = setting(6, 2, 3, 12, 4)
  text = encode_text(dit, params, text_emb, text_mask)
  twice = encode_text(dit, params, jnp.stack([text_emb] * 2, axis=1), jnp.stack([text_mask] * 2, axis=1))
  segment = np.array([[0, 0, 1, 1], [0, 1, 1, 1]], np.int32)
  plain = fast(dit, plan, params, constants, text, SCALE, keys, 4)
  assert_close(fast(dit, plan, params, constants, twice, SCALE, keys, 4, segment), plain, 2e-6)


@pytest.mark.parametrize("memory, guided", [
    (0, True), pytest.param(3, True, marks=pytest.mark.slow), pytest.param(6, False, marks=pytest.mark.slow)])
def test_new_words_look_back_no_farther_than_the_memory(memory, guided):
  """Cached = recomputed = streamed, for two motions whose words change at different blocks, past the cache; with no
  memory what came before decides nothing, one with a memory as long as the context is one without any."""
  block, num_blocks = 3, 9
  dit, plan, params, constants, _, _, keys = setting(6, 2, block, 12, num_blocks, guided=guided)
  text_emb, text_mask, _ = told(dit, params)
  text = encode_text(dit, params, text_emb, text_mask, guided)
  segment = np.stack([np.sort(np.arange(num_blocks) % 4), np.arange(num_blocks) // 5]).astype(np.int32)
  plan = streaming.make_plan(6, 2, block, 12, num_blocks, guided, memory=memory)
  made = fast(dit, plan, params, constants, text, SCALE, keys, num_blocks, segment)

  begins = np.array([[np.argmax(row == value) for value in row] for row in segment])
  since = np.repeat(np.where(begins, begins * block - memory, 0), block, axis=1)
  mask = sliding_mask(num_blocks * block, block, 12) & (np.arange(num_blocks * block) >= since[..., None])[:, None]
  noise = jnp.concatenate([streaming.block_noise(keys, i, plan, 5) for i in range(num_blocks)], axis=1)
  words = cmdm.words_of_latents(text_emb, text_mask, jnp.repeat(segment, block, axis=1))
  times = jnp.asarray(staircase(6, num_blocks * block, 2, block))
  assert_close(made, whole(dit, params, *words, mask, noise, times, SCALE if guided else 1.0), 1e-5)
  endless = streaming.make_plan(6, 2, block, 12, guided=guided, memory=memory)
  assert_close(streamed(dit, endless, params, constants, text, keys, num_blocks, segment=segment)[0], made, 2e-6)

  if memory == 0:
    other = encode_text(dit, params, text_emb.at[:, 0].add(1.0), text_mask, guided)
    changed = np.abs(fast(dit, plan, params, constants, other, SCALE, keys, num_blocks, segment) - made).max(2)
    first = np.repeat(segment == 0, block, axis=1)
    assert (changed[~first] < 2e-6).all() and (changed[first] > 1e-4).all()
  every = fast(dit, plan._replace(memory=None), params, constants, text, SCALE, keys, num_blocks, segment)
  longest = fast(dit, plan._replace(memory=4), params, constants, text, SCALE, keys, num_blocks, segment)
  assert_close(longest, every, 2e-6)
  assert np.abs(made - every).max() > 1e-3


def test_a_memory_is_of_whole_blocks():
  assert streaming.make_plan(6, 2, 3, 12, memory=6).memory == 2
  with pytest.raises(ValueError, match="memory of 4 latents, expected whole blocks of 3"):
    streaming.make_plan(6, 2, 3, 12, memory=4)


def test_captions_seen():
  segment = np.array([[0, 0, 0, 1, 1, 2, 3, 4, 4, 4]])
  assert [offline.captions_seen(segment, width) for width in (1, 2, 3, 4, 10)] == [1, 2, 4, 4, 8]
  assert offline.captions_seen(np.zeros((2, 5), int), 3) == 1


@pytest.mark.parametrize("lag", [2, 4])
@pytest.mark.slow
def test_heun_is_fast_too(lag):
  dit, plan, params, constants, text_emb, text_mask, keys = setting(4, lag, 3, 6, 4)
  plan = plan._replace(solver="heun")
  text = encode_text(dit, params, text_emb, text_mask)
  made = fast(dit, plan, params, constants, text, SCALE, keys, 4)
  noise = jnp.concatenate([streaming.block_noise(keys, i, plan, 5) for i in range(4)], axis=1)
  times = jnp.asarray(staircase(4, 12, lag, 3))
  expected = whole(dit, params, text_emb, text_mask, sliding_mask(12, 3, 6), noise, times, SCALE, samplers.heun)
  assert_close(made, expected, 1e-5)
  euler = whole(dit, params, text_emb, text_mask, sliding_mask(12, 3, 6), noise, times, SCALE)
  assert float(jnp.abs(euler - made).max()) > 1e-3


@pytest.mark.parametrize("fields", [{"use_rope": False}, pytest.param({"use_adaln": False}, marks=pytest.mark.slow)])
def test_ablations_are_fast_too(fields):
  dit, plan, params, constants, text_emb, text_mask, keys = setting(4, 2, 3, 6, 4, **fields)
  text = encode_text(dit, params, text_emb, text_mask)
  made = fast(dit, plan, params, constants, text, SCALE, keys, 4)
  noise = jnp.concatenate([streaming.block_noise(keys, i, plan, 5) for i in range(4)], axis=1)
  times = jnp.asarray(staircase(4, 12, 2, 3))
  assert_close(made, whole(dit, params, text_emb, text_mask, sliding_mask(12, 3, 6), noise, times, SCALE), 1e-5)


def test_a_longer_run_begins_with_the_shorter_one():
  results = []
  for num_blocks in (4, 7):
    dit, plan, params, constants, *text, keys = setting(6, 2, 3, 12, num_blocks)
    text = encode_text(dit, params, *text)
    results.append(fast(dit, plan, params, constants, text, SCALE, keys, num_blocks))
  assert_close(results[1][:, :12], results[0], 2e-6)


def test_batch_mates_are_invisible():
  dit, plan, params, constants, text_emb, text_mask, keys = setting(6, 2, 3, 12, 4)
  text = encode_text(dit, params, text_emb, text_mask)
  together = fast(dit, plan, params, constants, text, SCALE, keys, 4)
  alone = encode_text(dit, params, text_emb[1:2], text_mask[1:2])
  assert_close(together[1:2], fast(dit, plan, params, constants, alone, SCALE, keys[1:2], 4), 2e-6)


def test_guidance_of_one_and_zero():
  """1 is the plan without guidance, 0 a caption of zeros."""
  dit, plan, params, constants, text_emb, text_mask, keys = setting(4, 2, 3, 12, 3)
  text = encode_text(dit, params, text_emb, text_mask)
  guided = lambda scale: fast(dit, plan, params, constants, text, scale, keys, 3)
  bare = plan._replace(guided=False)
  unguided = lambda emb: fast(dit, bare, params, constants, encode_text(dit, params, emb, text_mask, False),
                              1.0, keys, 3)
  assert_close(guided(1.0), unguided(text_emb), 2e-6)
  assert_close(guided(0.0), unguided(0 * text_emb), 2e-6)
  assert float(jnp.abs(guided(3.0) - guided(1.0)).max()) > 1e-2


def test_an_endless_stream_stays_as_it_is(monkeypatch):
  """Shapes do not grow, nothing compiles anew, and hour 1000 is computed to the bit as minute one."""
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
  run = lambda state: step(sampler, state)[:2]
  (now, block), (then, late_block) = run(state), run(late)
  np.testing.assert_array_equal(block, late_block)
  chex.assert_trees_all_equal(now.cache, then.cache)
  # Only the noise of the block that comes in knows how late it is.
  np.testing.assert_array_equal(now.latents[:, :-3], then.latents[:, :-3])
  assert float(jnp.abs(now.latents[:, -3:] - then.latents[:, -3:]).max()) > 0.1


def test_noise_belongs_to_key_and_place():
  _, plan, _, _, _, _, keys = setting(4, 2, 3, 12)
  draw = lambda keys, index: np.asarray(streaming.block_noise(keys, index, plan, 5))
  assert draw(keys, 7).shape == (2, 3, 5)
  np.testing.assert_array_equal(draw(keys, 7)[1:], draw(keys[1:], jnp.int32(7)))
  assert np.abs(draw(keys, 7) - draw(keys, 8)).min() > 0 and np.abs(draw(keys, 7)[0] - draw(keys, 7)[1]).min() > 0
  many = np.concatenate([draw(keys, i) for i in range(200)])
  assert abs(many.mean()) < 0.05 and abs(many.std() - 1) < 0.05


@pytest.mark.slow
def test_bfloat16_stays_near():
  dit, plan, params, constants, text_emb, text_mask, keys = setting(4, 2, 3, 12, 3)
  exact = fast(dit, plan, params, constants, encode_text(dit, params, text_emb, text_mask), SCALE, keys, 3)
  half = dit.clone(dtype=jnp.bfloat16)
  rough = fast(half, plan, params, make_constants(half, params, plan),
               encode_text(half, params, text_emb, text_mask), SCALE, keys, 3)
  assert rough.dtype == jnp.float32
  assert float(jnp.abs(rough - exact).mean() / jnp.abs(exact).mean()) < 0.1


def test_bad_plans_are_told():
  for bad, words in ((dict(lag=0), "lag 0"), (dict(lag=60), "lag <= num_steps"), (dict(num_steps=0), "num_steps 0"),
                     (dict(context=10), "whole blocks of 3"), (dict(context=0), "whole blocks"),
                     (dict(solver="dopri"), "euler, heun")):
    with pytest.raises(ValueError, match=words):
      streaming.make_plan(**(dict(num_steps=50, lag=2, block=3, context=48) | bad))
