"""The straight path: conversions undo one another, forcing draws one time per block, the loss counts real latents."""
import jax
import numpy as np
import pytest

from motion_jax.diffusion import paths


def arrays():
  draw = np.random.default_rng(0)
  return (*draw.normal(size=(2, 2, 6, 4)).astype(np.float32), draw.uniform(0.05, 0.95, (2, 6)).astype(np.float32))


def test_conversions_undo_one_another_and_data_are_at_time_1():
  x1, noise, t = arrays()
  x, velocity = paths.add_noise(x1, noise, t), x1 - noise
  np.testing.assert_allclose(paths.velocity_to_x1(x, velocity, t), x1, atol=1e-5)
  np.testing.assert_allclose(paths.velocity_to_noise(x, velocity, t), noise, atol=1e-5)
  np.testing.assert_array_equal(paths.add_noise(x1, noise, np.ones_like(t)), x1)


@pytest.mark.parametrize("length, block, draws", [(12, 3, 4), (12, 1, 12), (11, 3, 4), (12, 0, 1)])
def test_forcing_times(length, block, draws):
  t = np.asarray(paths.forcing_times(jax.random.key(1), 5, length, block))
  assert t.shape == (5, length) and (t >= 0).all() and (t < 1).all()
  assert all(len(np.unique(row)) == draws for row in t) and len(np.unique(t)) == 5 * draws
  if block:
    np.testing.assert_array_equal(t, t[:, np.arange(length) // block * block])


def test_loss_counts_real_latents_only():
  """Sum over real latents of the mean over channels; two halves of a batch add up to the whole.

  Source: docs/papers/cmdm.md#denoiser-loss.
  """
  x1, noise, t = arrays()
  mask = np.arange(6) < np.array([[4], [6]])
  run = jax.jit(lambda x1, mask: paths.forcing_loss(lambda x, t: x * t[..., None], x1, mask, t, noise))
  sums, weight = run(x1, mask)
  x = t[..., None] * x1 + (1 - t[..., None]) * noise
  error = ((x * t[..., None] - (x1 - noise)) ** 2).mean(-1)
  np.testing.assert_allclose(sums["loss"], error[0, :4].sum() + error[1].sum(), rtol=1e-6)
  assert int(weight) == 10
  halves = [run(x1, mask & (np.arange(2) == i)[:, None]) for i in range(2)]
  np.testing.assert_allclose(sum(half["loss"] for half, _ in halves), sums["loss"], rtol=1e-6)
  # Padding may hold anything, even what is not a number.
  broken, _ = run(np.where(mask[..., None], x1, np.float32(np.nan)), mask)
  np.testing.assert_array_equal(broken["loss"], sums["loss"])


def test_targets_weigh_times():
  """eps is off by t times the velocity's error, x1 by 1 - t times (the path is straight)."""
  x1, noise, t = arrays()
  velocity = lambda x, t: x1 - noise + 1.0
  loss = jax.jit(lambda mask: {target: paths.forcing_loss(velocity, x1, mask, t, noise, target)[0]["loss"]
                               for target in paths.TARGETS})(np.ones(t.shape, bool))
  t = np.asarray(t, np.float64)
  for target, expected in (("velocity", t.size), ("eps", (t ** 2).sum()), ("x1", ((1 - t) ** 2).sum())):
    assert loss[target] == pytest.approx(expected, rel=1e-4)


def test_further_terms_weigh_a_clip_by_its_real_latents():
  """And a caption that contradicts the motion costs what its error is short of the true one's plus a margin."""
  x1, noise, t = arrays()
  mask = np.arange(6) < np.array([[4], [6]])
  off = lambda error: lambda x, t: x1 - noise + error  # the mean squared error is that of `error`
  counts = mask & np.array([[True], [False]])  # the second clip has no such caption
  run = jax.jit(lambda other, mask, counts: paths.forcing_loss(
      off(2.0), x1, mask, t, noise, errors_of=lambda clean: {"far": np.array([0.25, 0.5])},
      contrast=paths.Contrast(off(other), counts, 0.1, 3.0))[0])
  sums = run(1.0, mask, counts)
  np.testing.assert_allclose([sums["far"], sums["contrast"]], [0.25 * 4 + 0.5 * 6, 0.1 * (3 + 4 - 1) * 4], rtol=1e-5)
  np.testing.assert_allclose(sums["loss"], 4 * 10 + sums["far"] + sums["contrast"], rtol=1e-5)
  assert run(3.0, mask, counts)["contrast"] == 0  # 9 is over 4 + 3
