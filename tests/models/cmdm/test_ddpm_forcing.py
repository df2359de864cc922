"""The paper's own diffusion: levels, steps and loss are those of its equations; fast is plain, streamed is offline."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import ddpm
from motion_jax.diffusion.schedules import staircase_levels
from motion_jax.models import cmdm
from motion_jax.models.cmdm import ddpm_forcing, streaming
from motion_jax.nets.masks import sliding_mask
from tests.models.cmdm.test_streaming import (
  SCALE,
  assert_close,
  encode_text,
  fast,
  make_constants,
  noise_of,
  setting,
  streamed,
)

BETAS = 1e-4 + (0.02 - 1e-4) * np.arange(1000) / 999  # of levels 1 to 1000
KEPT = np.array([np.prod(1 - BETAS[:k]) for k in range(1001)])


def test_levels_of_noise():
  np.testing.assert_allclose(ddpm_forcing.kept_shares(), KEPT, rtol=1e-10)
  assert KEPT[0] == 1 and KEPT[1000] == pytest.approx(4.0358e-5, rel=1e-4)  # 4e-5, as is known of this schedule
  levels = np.arange(1001)
  t = jnp.asarray(1 - levels / 1000, jnp.float32)
  np.testing.assert_array_equal(ddpm_forcing.level_of(t), levels)
  x1, noise = np.random.default_rng(0).standard_normal((2, 1001, 3)).astype(np.float32)
  made = ddpm_forcing.add_noise(jnp.asarray(x1), jnp.asarray(noise), t)
  np.testing.assert_allclose(made, np.sqrt(KEPT)[:, None] * x1 + np.sqrt(1 - KEPT)[:, None] * noise, atol=1e-6)
  np.testing.assert_array_equal(made[0], x1[0])


def test_each_block_draws_a_level_of_its_own():
  t = np.asarray(ddpm_forcing.forcing_times(jax.random.key(0), 20_000, 5, 2))
  levels = np.asarray(ddpm_forcing.level_of(t))
  assert (levels[:, 0] == levels[:, 1]).all() and (levels[:, 2] == levels[:, 3]).all()
  assert levels.min() == 0 and levels.max() == 1000  # both ends, as in algorithm 1
  assert abs(levels[:, 0].mean() - 500) < 10 and abs(np.corrcoef(levels[:, 0], levels[:, 2])[0, 1]) < 0.03
  whole = np.asarray(ddpm_forcing.forcing_times(jax.random.key(0), 4, 5, 0))
  assert (whole == whole[:, :1]).all() and len(set(whole[:, 0].tolist())) == 4


def test_the_loss_is_the_error_of_the_noise():
  rng = np.random.default_rng(1)
  x1, noise = rng.standard_normal((2, 2, 4, 3)).astype(np.float32)
  level = np.array([[0, 1000, 300, 17], [5, 999, 2, 640]])
  real = np.array([[True, True, True, False], [True, True, False, False]])
  seen = np.sqrt(KEPT)[level][..., None] * x1 + np.sqrt(1 - KEPT)[level][..., None] * noise
  t = jnp.asarray(1 - level / 1000, jnp.float32)
  noise_at = lambda x, t: 0.5 * x + t[..., None]
  sums, weight = ddpm_forcing.forcing_loss(noise_at, jnp.asarray(x1), jnp.asarray(real), t, noise)
  error = ((0.5 * seen + (1 - level / 1000)[..., None] - noise) ** 2).mean(-1)
  np.testing.assert_allclose(sums["loss"], error[real].sum(), rtol=1e-5)
  assert weight == 5


def test_fifty_steps_are_those_of_a_schedule_with_fifty():
  """K = 50 at inference: the tables of a DDPM whose levels are every twentieth of the thousand."""
  levels = np.arange(1000, -1, -20)
  steps = ddpm_forcing.make_steps(50)
  np.testing.assert_allclose(steps.times, 1 - levels / 1000, atol=1e-7)
  kept = KEPT[levels[:-1]][::-1]
  schedule = ddpm.schedule_of(1 - kept / np.append(1.0, kept[:-1]))
  x, predicted, fresh = np.random.default_rng(0).standard_normal((3, 1, 50, 4)).astype(np.float32)
  now = np.arange(50)
  made = ddpm_forcing.step(steps, jnp.asarray(x), predicted, now, now + 1, fresh)
  back = jax.jit(lambda x, predicted, index, noise: ddpm.step_back(
      schedule, x, ddpm.x1_of_noise(schedule, x, predicted, index), index, noise))
  expected = [back(x[0, m], predicted[0, m], 49 - m, fresh[0, m]) for m in range(50)]
  np.testing.assert_allclose(made[0], expected, rtol=2e-4, atol=2e-5)
  held = ddpm_forcing.step(steps, jnp.asarray(x), predicted, now, now, fresh)
  np.testing.assert_array_equal(held, x)  # neither what has not begun nor what is done moves
  for wrong in (0, 1001):
    with pytest.raises(ValueError, match=f"{wrong} sampler steps"):
      ddpm_forcing.make_steps(wrong)


def _of_gaussian(mean, std):
  """The best guess of the noise where data are normal, in closed form."""
  kept = jnp.asarray(KEPT, jnp.float32)

  def noise_at(x, t):
    left = kept[ddpm_forcing.level_of(t)][:, None]
    return jnp.sqrt(1 - left) * (x - jnp.sqrt(left) * mean) / (left * std ** 2 + 1 - left)

  return noise_at


@jax.jit
def _sampled(x, levels, steps, fresh):
  """Data with mean 2 and standard deviation 0.5 of noise; fresh: 0 for none."""
  draw = lambda now: fresh * jax.random.normal(jax.random.fold_in(jax.random.key(1), now.sum()), x.shape)
  return ddpm_forcing.sample(_of_gaussian(2.0, 0.5), x, levels, steps, draw)


def test_gaussian_data_come_out_and_ddim_is_a_solver():
  """Many steps from noise give data of the right mean and spread, whatever the lag. Without fresh noise the error
  against the exact map of the ODE falls with the steps: x = mean + std noise, to the last level's rest."""
  x = np.random.default_rng(0).standard_normal((4000, 3, 1)).astype(np.float32)
  start = np.sqrt(KEPT[1000] * 0.25 + 1 - KEPT[1000])
  exact = 2 + 0.5 * (x - np.sqrt(KEPT[1000]) * 2) / start
  run = lambda count, solver, fresh: np.asarray(_sampled(
      x, staircase_levels(count, 3, count // 10), ddpm_forcing.make_steps(count, solver), fresh))
  made = run(100, "ancestral", 1.0)
  np.testing.assert_allclose(made.mean((0, 2)), 2.0, atol=0.04)
  np.testing.assert_allclose(made.std((0, 2)), 0.5, atol=0.04)
  coarse, fine = (np.abs(run(count, "ddim", 0.0) - exact).max() for count in (25, 100))
  assert fine < coarse / 3 and fine < 0.1


@pytest.mark.slow
def test_fast_is_plain_and_streamed_is_offline():
  num_steps, lag, block, num_blocks = 5, 2, 3, 3
  dit, plan, params, _, text_emb, text_mask, keys = setting(num_steps, lag, block, 6, num_blocks, predicts="ddpm",
                                                            time_scale=100.0)
  plan = plan._replace(solver="ancestral")
  constants, text = make_constants(dit, params, plan), encode_text(dit, params, text_emb, text_mask)
  made = fast(dit, plan, params, constants, text, SCALE, keys, num_blocks)

  levels = staircase_levels(num_steps, num_blocks * block, lag, block)
  steps, mask = ddpm_forcing.make_steps(num_steps), sliding_mask(num_blocks * block, block, 6)
  noise_at = cmdm.plain_velocity(dit, params, text_emb, text_mask, mask, SCALE)
  fresh = lambda now: streaming.fresh_noise(keys, jnp.arange(num_blocks), now[::block], plan, 5)
  expected = jax.jit(lambda noise: ddpm_forcing.sample(noise_at, noise, levels, steps, fresh))(
      noise_of(keys, plan, num_blocks))
  assert_close(made, expected, 2e-5)
  endless = streaming.make_plan(num_steps, lag, block, 6, solver="ancestral")
  assert_close(streamed(dit, endless, params, constants, text, keys, num_blocks)[0], made, 5e-6)
