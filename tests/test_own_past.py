"""A past that the network made itself: which latents it is, that it counts as clean, that no gradient flows through."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import fit
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
  made, times, own = stages.with_own_past(said, z1, real, t, noise, keys, BLOCK, 0.5)
  count = np.asarray(own.sum(1))
  np.testing.assert_array_equal(own, np.arange(LENGTH) < count[:, None])
  assert set(count[1::2]) == {0, 3, 6, 9} and set(count[::2]) == {0, 3}  # 5 real latents are two blocks: one stays
  assert 0.3 < (count[1::2] > 0).mean() < 0.45  # half are chosen, of which one in four begins at the very start
  np.testing.assert_allclose(made, np.where(own[..., None], 7, z1), rtol=1e-5)
  np.testing.assert_array_equal(times, np.where(own, 1, 0.25))
  np.testing.assert_array_equal(*(stages.with_own_past(said, z1[a], real[a], t[a], noise[a], keys[a], BLOCK, 0.5)[0][0]
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
  config.loss.own_past = 1.0
  stage = stages.denoiser_stage(config)
  sums, weight = loss(stage, params)
  assert 0 < weight < whole and np.isfinite(sums["loss"])

  gradient = jax.grad(lambda params: loss(stage, params)[0]["loss"])(params)
  monkeypatch.setattr(stages.jax.lax, "stop_gradient", lambda x: x)
  through = jax.grad(lambda params: loss(stage, params)[0]["loss"])(params)
  assert any(not np.array_equal(a, b) for a, b in zip(*map(jax.tree.leaves, (gradient, through))))
