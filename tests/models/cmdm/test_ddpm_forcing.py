"""The paper's own diffusion: levels, steps and loss are those of its equations; fast is plain, streamed is offline."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.diffusion import ddpm, guidance
from motion_jax.diffusion.schedules import staircase_levels
from motion_jax.models.cmdm import ddpm_forcing, streaming
from motion_jax.nets.masks import sliding_mask
from tests.models.cmdm.test_streaming import SCALE, assert_close, encode_text, fast, make_constants, setting, streamed

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


def test_steps_are_those_of_algorithm_2():
  """One level at a time: 1 / sqrt(a), (1 - a) / sqrt(1 - kept); no noise into level 0."""
  steps = ddpm_forcing.make_steps(1000)
  a, kept, after = (1 - BETAS)[::-1], KEPT[1:][::-1], KEPT[:-1][::-1]
  np.testing.assert_allclose(steps.of_x, 1 / np.sqrt(a), rtol=1e-6)
  np.testing.assert_allclose(steps.of_predicted, -BETAS[::-1] / np.sqrt(1 - kept) / np.sqrt(a), rtol=1e-5)
  np.testing.assert_allclose(steps.of_fresh, np.sqrt(BETAS[::-1] * (1 - after) / (1 - kept)), rtol=1e-5, atol=1e-9)
  assert steps.of_fresh[-1] == 0 and steps.times[0] == 0 and steps.times[-1] == 1


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


def test_gaussian_data_come_out():
  """Many steps from noise give data of the right mean and spread, whatever the lag."""
  levels = staircase_levels(100, 3, 10)
  x = jax.random.normal(jax.random.key(0), (4000, 3, 1))
  fresh = lambda now: jax.random.normal(jax.random.fold_in(jax.random.key(1), now.sum()), x.shape)
  for solver in ddpm_forcing.SOLVERS:
    steps = ddpm_forcing.make_steps(100, solver)
    made = np.asarray(jax.jit(lambda x, steps=steps: ddpm_forcing.sample(
        _of_gaussian(2.0, 0.5), x, levels, steps, fresh))(x))
    np.testing.assert_allclose(made.mean((0, 2)), 2.0, atol=0.04)
    np.testing.assert_allclose(made.std((0, 2)), 0.5, atol=0.04)


def test_ddim_is_a_solver():
  """Its error against the exact map of the ODE falls with the steps: x = mean + std noise, to the last level's rest."""
  x = jax.random.normal(jax.random.key(0), (64, 1, 1))
  start = np.sqrt(KEPT[1000] * 0.25 + 1 - KEPT[1000])
  expected = 2 + 0.5 * (np.asarray(x) - np.sqrt(KEPT[1000]) * 2) / start
  errors = []
  for count in (25, 100):
    made = ddpm_forcing.sample(_of_gaussian(2.0, 0.5), x, staircase_levels(count, 1, 0),
                               ddpm_forcing.make_steps(count, "ddim"), lambda now: 0.0)
    errors.append(np.abs(np.asarray(made) - expected).max())
  assert errors[1] < errors[0] / 3 and errors[1] < 0.04


def _ddpm_setting(num_steps, lag, block, context, num_blocks=None, solver="ancestral", **options):
  dit, plan, params, *rest = setting(num_steps, lag, block, context, num_blocks, predicts="ddpm", time_scale=100.0,
                                     **options)
  plan = plan._replace(solver=solver)
  return dit, plan, params, make_constants(dit, params, plan), *rest[1:]


@pytest.mark.parametrize("num_steps, lag, block, context, num_blocks, solver", [
    (4, 2, 1, 2, 5, "ancestral"), (5, 2, 3, 6, 3, "ancestral")])
@pytest.mark.slow
def test_fast_is_plain_and_streamed_is_offline(num_steps, lag, block, context, num_blocks, solver):
  dit, plan, params, constants, text_emb, text_mask, keys = _ddpm_setting(
      num_steps, lag, block, context, num_blocks, solver)
  text, length = encode_text(dit, params, text_emb, text_mask), num_blocks * block
  made = fast(dit, plan, params, constants, text, SCALE, keys, num_blocks)

  noise = jnp.concatenate([streaming.block_noise(keys, i, plan, 5) for i in range(num_blocks)], axis=1)
  mask = sliding_mask(length, block, context)

  def noise_at(x, t, drop):
    words = jnp.where(drop[:, None, None], 0, jnp.concatenate([text_emb, text_emb]))
    return dit.apply(params, x, jnp.broadcast_to(t, x.shape[:2]), words, mask, jnp.concatenate([text_mask, text_mask]))

  fresh = lambda now: streaming.fresh_noise(keys, jnp.arange(num_blocks), now[::block], plan, 5)
  levels = staircase_levels(num_steps, length, lag, block)
  steps = ddpm_forcing.make_steps(num_steps, solver)
  expected = jax.jit(lambda noise: ddpm_forcing.sample(guidance.guided(noise_at, SCALE), noise, levels, steps, fresh))(
      noise)
  assert_close(made, expected, 2e-5)

  live, _ = streamed(dit, streaming.make_plan(num_steps, lag, block, context, solver=solver), params, constants, text,
                     keys, num_blocks)
  assert_close(live, made, 5e-6)
  alone = encode_text(dit, params, text_emb[1:], text_mask[1:])
  assert_close(fast(dit, plan, params, constants, alone, SCALE, keys[1:], num_blocks), made[1:], 5e-6)


def test_fresh_noise_is_new_in_every_step_block_and_motion():
  plan, keys = streaming.make_plan(4, 2, 2, 4), jax.vmap(jax.random.key)(jnp.arange(2))
  noise = streaming.fresh_noise(keys, jnp.array([0, 1, 0, 7]), jnp.array([0, 0, 1, 3]), plan, 3)
  assert noise.shape == (2, 8, 3)
  first = jnp.concatenate([streaming.block_noise(keys, i, plan, 3) for i in (0, 1)], axis=1)
  values = np.concatenate([np.ravel(noise), np.ravel(first)])
  assert len(np.unique(values)) == len(values)
  alone = streaming.fresh_noise(keys[1:], jnp.array([7]), jnp.array([3]), plan, 3)
  np.testing.assert_array_equal(alone[0], noise[1, 6:])
