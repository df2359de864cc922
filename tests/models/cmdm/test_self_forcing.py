"""A past that the network made itself: which latents it is, that it counts as clean, that no gradient flows through."""
import jax
import numpy as np
import pytest

from motion_jax import fit
from motion_jax.diffusion import paths
from motion_jax.models.cmdm import stages
from motion_jax.training.setup import untrained
from tests.conftest import load_config

BLOCK, LENGTH, CLIPS = 3, 12, 200


def test_a_beginning_of_whole_blocks_is_its_own_and_clean_and_has_no_gradient():
  draw = np.random.default_rng(0)
  z1, noise = draw.normal(size=(2, CLIPS, LENGTH, 2)).astype(np.float32)
  real = np.arange(LENGTH) < np.where(np.arange(CLIPS) % 2, 12, 5)[:, None]
  t, keys = np.full((CLIPS, LENGTH), 0.25, np.float32), jax.random.split(jax.random.key(2), CLIPS)

  def run(seven, keys):
    seen = []

    def said(x, t):
      seen.append(t)
      return (seven - x) / (1 - t[..., None])  # wherever it is, it heads for 7

    made = stages.self_forced(said, z1, real, t, noise, keys, BLOCK, 0.5)
    return made[0].sum(), (*made, *seen)

  (_, (made, times, own, level)), slope = jax.jit(jax.value_and_grad(run, has_aux=True))(7.0, keys)
  assert 0.5 <= level.min() < 0.51 and level.max() > 0.99  # noise that is more than half gone
  own, count = np.asarray(own), np.asarray(own).sum(1)
  np.testing.assert_array_equal(own, np.arange(LENGTH) < count[:, None])
  assert set(count[1::2]) == {0, 3, 6, 9} and set(count[::2]) == {0, 3}  # 5 real latents are two blocks: one stays
  assert 0.3 < (count[1::2] > 0).mean() < 0.45  # half are chosen, of which one in four begins at the very start
  np.testing.assert_allclose(made, np.where(own[..., None], 7, z1), rtol=1e-5)
  np.testing.assert_array_equal(times, np.where(own, 1, t))
  assert slope == 0


@pytest.mark.parametrize("field", ["self_forcing", "pyramid_levels"])
@pytest.mark.slow
def test_only_what_comes_after_is_learned(field):
  """Neither latents of its own nor those that are finished count."""
  config = fit.resolve(load_config("cmdm_denoiser", "tiny"))[0].copy_and_resolve_references().unlock()
  setup = fit.setups()[config.stage](config)
  batch, rng = setup.next_batch(0), jax.random.key(0)
  params = untrained(jax.eval_shape(setup.stage.init, batch, rng))
  config.loss[field] = 1.0
  sums, weight = jax.jit(stages.denoiser_stage(config).loss)(params, setup.frozen, batch, 0, rng)
  assert 0 < weight < (batch["num_frames"] // 4).sum() and np.isfinite(sums["loss"])


def test_times_of_a_moment_of_sampling_rise_towards_the_past():
  draw = jax.jit(jax.vmap(lambda key, real: paths.ramp_times(key, 14, BLOCK, real=real), (0, None)))
  keys = jax.random.split(jax.random.key(0), CLIPS)
  times, short = np.asarray(draw(keys, 14)), np.asarray(draw(keys, 2))
  assert times.shape == (CLIPS, 14) and times.min() == 0 and times.max() == 1
  assert (np.diff(times) <= 0).all() and (np.diff(times[:, :3]) == 0).all()  # whole blocks, the past first
  finished = lambda times: (times[:, 0] == 1).mean()
  assert finished(short) < finished(times)  # a moment of two latents, not of what is padded behind them
  steep = -np.diff(times[:, ::BLOCK]).min(1)
  assert (steep > 0.6).any() and ((steep > 0) & (steep < 0.1)).any()
