"""A past that the network made itself: which latents it is, that it counts as clean, that no gradient flows through."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import fit
from motion_jax.diffusion import paths
from motion_jax.models.cmdm import stages
from motion_jax.training.setup import untrained
from tests.conftest import load_config

BLOCK, LENGTH, CLIPS = 3, 12, 200


def inputs():
  draw = lambda seed: jax.random.normal(jax.random.key(seed), (CLIPS, LENGTH, 2))
  real = jnp.arange(LENGTH) < jnp.where(jnp.arange(CLIPS) % 2, 12, 5)[:, None]
  return draw(0), real, jnp.full((CLIPS, LENGTH), 0.25), draw(1), jax.random.split(jax.random.key(2), CLIPS)


@pytest.mark.slow
def test_a_beginning_of_whole_blocks_is_its_own_and_clean():
  z1, real, t, noise, keys = inputs()
  said = lambda x, t: (7 - x) / (1 - t[..., None])  # wherever it is, it heads for 7
  made, times, own = stages.self_forced(said, z1, real, t, noise, keys, BLOCK, 0.5)
  count = np.asarray(own.sum(1))
  np.testing.assert_array_equal(own, np.arange(LENGTH) < count[:, None])
  assert set(count[1::2]) == {0, 3, 6, 9} and set(count[::2]) == {0, 3}  # 5 real latents are two blocks: one stays
  assert 0.3 < (count[1::2] > 0).mean() < 0.45  # half are chosen, of which one in four begins at the very start
  np.testing.assert_allclose(made, np.where(own[..., None], 7, z1), rtol=1e-5)
  np.testing.assert_array_equal(times, np.where(own, 1, 0.25))
  np.testing.assert_array_equal(*(stages.self_forced(said, z1[a], real[a], t[a], noise[a], keys[a], BLOCK, 0.5)[0][0]
                                  for a in (slice(40, 41), slice(40, 80))))  # alone or among others


@pytest.mark.slow
def test_only_what_comes_after_is_learned(monkeypatch):
  """The tiny denoiser: a loss over fewer latents, and no gradient through the pass that made the past."""
  config, _ = fit.resolve(load_config("cmdm_denoiser", "tiny"))
  config = config.copy_and_resolve_references().unlock()
  setup = fit.setups()[config.stage](config)
  batch, rng = setup.next_batch(0), jax.random.key(0)
  params = untrained(jax.eval_shape(setup.stage.init, batch, rng))
  loss = lambda stage, params: stage.loss(params, setup.frozen, batch, 0, rng)
  _, whole = loss(setup.stage, params)
  config.loss.self_forcing = 1.0
  stage = stages.denoiser_stage(config)
  sums, weight = loss(stage, params)
  assert 0 < weight < whole and np.isfinite(sums["loss"])

  # Decoded motion goes on from what was made: the decoder is told the past, and no frame of it counts.
  config.loss.acceleration = 1.0
  seen = []
  monkeypatch.setattr(stages.VaeCodec, "decode", lambda self, z: seen.append(z) or self.net.apply(
      self.params, self.unscale(z), method="decode"))
  frozen = fit.setups()[config.stage](config).frozen
  stages.denoiser_stage(config).loss(params, frozen, batch, 0, rng)
  real = np.arange(seen[-1].shape[1]) < np.asarray(batch["num_frames"] // 4)[:, None]
  assert (np.abs(np.asarray(seen[-1])).max(-1) > 0)[real].all()
  config.loss.acceleration = 0.0

  gradient = jax.grad(lambda params: loss(stage, params)[0]["loss"])(params)
  monkeypatch.setattr(stages.jax.lax, "stop_gradient", lambda x: x)
  through = jax.grad(lambda params: loss(stage, params)[0]["loss"])(params)
  assert any(not np.array_equal(a, b) for a, b in zip(*map(jax.tree.leaves, (gradient, through))))


@pytest.mark.slow
def test_times_of_a_moment_of_sampling_rise_towards_the_past():
  times = np.asarray(jax.vmap(lambda key: paths.ramp_times(key, 14, BLOCK))(jax.random.split(jax.random.key(0), CLIPS)))
  assert times.shape == (CLIPS, 14) and times.min() == 0 and times.max() == 1
  assert (np.diff(times) <= 0).all() and (np.diff(times[:, :3]) == 0).all()  # whole blocks, the past first
  short = np.asarray(jax.vmap(lambda key: paths.ramp_times(key, 14, BLOCK, real=jnp.array(2)))(
      jax.random.split(jax.random.key(0), CLIPS)))
  finished = lambda times: (times[:, 0] == 1).mean()
  assert finished(short) < finished(times)  # a moment of two latents, not of what is padded behind them
  slopes = -np.diff(times[:, ::BLOCK])
  steep = slopes.max(1)
  assert (steep > 0.6).any() and ((steep > 0) & (steep < 0.1)).any()
  config, _ = fit.resolve(load_config("cmdm_denoiser", "tiny"))
  config = config.copy_and_resolve_references().unlock()
  setup = fit.setups()[config.stage](config)
  batch = setup.next_batch(0)
  shape = jax.eval_shape(setup.stage.init, batch, jax.random.key(0))
  weights = []
  for ramp in (0.0, 1.0):
    config.loss.pyramid_levels = ramp
    sums, weight = stages.denoiser_stage(config).loss(untrained(shape), setup.frozen, batch, 0, jax.random.key(1))
    weights.append(int(weight))
    assert np.isfinite(sums["loss"])
  assert 0 < weights[1] < weights[0]  # what is finished does not count
