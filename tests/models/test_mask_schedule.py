"""Which latents are masked is as in the reference, to the last tie; and the tables are those in the docstrings."""
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.models.shared import mask_schedule as masking
from motion_jax.models.shared.editing import edited_latents
from motion_jax.models.shared.pasting import requested_frames
from motion_jax.nets.masks import padding_mask
from tests import fixtures
from tests.golden import check, golden, recordings


@golden("corruption", bounds={"": (0, 0)})
def run_corruption(fixture, dtype):
  draws = {name: jnp.asarray(array, dtype) for name, array in fixture.under("in/").items()}
  latents = draws["latents"]
  real = padding_mask(fixture["in/lengths"], latents.shape[1])
  made = masking.corruption(draws["time_u"], draws["order_u"], draws["noise_u"], draws["keep_u"], real)
  x = masking.corrupt(latents, made, draws["noise"], jnp.asarray(fixture.params["mask_latent"], dtype), real)
  clean = np.where(np.asarray(real)[..., None], latents, 0)
  masked = clean[np.asarray(made.masked)]
  copies = len(fixture["out/target_rows"]) // len(masked)
  rows = np.concatenate([masked] * copies)  # copy-major, as the batch is repeated
  return made._asdict() | {"input": x, "target_rows": rows}


@golden("mask_schedule", bounds={"": (0, 0)})
def run_mask_schedule(fixture, dtype):
  return {name: masking.masked_counts(int(name), fixture["in/lengths"]).T for name in fixture.under("out/")}


@golden("edit_masks", bounds={"": (0, 0)})
def run_edit_masks(fixture, dtype):
  return {task: masking.task_mask(task, fixture["in/frames"], recorded.shape[1])
          for task, recorded in fixture.under("out/").items()}


@recordings(single=("corruption", "mask_schedule", "edit_masks"))
def test_golden(name, precision):
  assert not check(fixtures.path(f"cdamd/{name}.npz"), [precision]).failures


# Numbers of iterations N for which torch 2.13.0+cpu has cos < 1/2 in iteration 2 (N - 1) / 3, of all N <= 64 with one:
#   [N for N in range(4, 65, 3) if torch.cos(torch.linspace(0, 1, N) * math.pi * 0.5)[2 * (N - 1) // 3] < 0.5]
ROUNDED_DOWN = [10, 19, 22, 28, 37, 40, 43, 46, 55, 58]


def test_ties_are_pytorchs():
  down = []
  for num_iterations in range(4, 65, 3):
    share = masking.masked_shares(num_iterations)[2 * (num_iterations - 1) // 3]
    assert share != 0.5 and abs(share - 0.5) < 1e-7
    down += [num_iterations] * int(share < 0.5)
    odd = np.arange(3, 64, 2)
    counts = masking.masked_counts(num_iterations, odd)[2 * (num_iterations - 1) // 3]
    np.testing.assert_array_equal(counts, odd // 2 + (share > 0.5))
  assert down == ROUNDED_DOWN


def test_counts():
  """Measured on the reference (docs/papers/cdamd.md#generation)."""
  assert masking.masked_counts(10, [30])[:, 0].tolist() == [30, 30, 28, 26, 23, 19, 15, 10, 5, 1]
  assert masking.masked_counts(10, [49])[:, 0].tolist() == [49, 48, 46, 42, 38, 31, 24, 17, 9, 1]
  assert masking.masked_counts(18, [30, 49]).sum(0).tolist() == [341, 557]
  for num_iterations in range(1, 65):
    counts = masking.masked_counts(num_iterations, np.arange(1, 65))
    assert (counts[0] == np.arange(1, 65)).all() and (np.diff(counts, axis=0) <= 0).all() and (counts >= 1).all()
  with pytest.raises(ValueError, match="0 decoding iterations"):
    masking.masked_counts(0, [30])


def test_every_latent_is_unmasked_once():
  rng = np.random.default_rng(0)
  order, lengths = rng.random((3, 12), np.float32), np.array([12, 9, 1])
  order[np.arange(12) >= lengths[:, None]] = np.inf
  counts = masking.masked_counts(10, lengths)
  masked = masking.masked_table(order, counts)
  np.testing.assert_array_equal(masked.sum(-1), counts)
  assert (masked[1:] <= masked[:-1]).all()
  np.testing.assert_array_equal(masked.any(0), np.isfinite(order))
  assert masking.masked_table(np.array([[.2, .7, .1, np.inf]]), [[3], [2], [1]])[:, 0].astype(int).tolist() == [
      [1, 1, 1, 0], [1, 0, 1, 0], [0, 0, 1, 0]]


def test_shares_of_the_corruption():
  """Measured on the reference: 63.5 % of latents carry loss; 10.1, 79.1, 10.8 % of these are noise, masked, kept."""
  rng = np.random.default_rng(0)
  time_u, (order_u, noise_u, keep_u) = rng.random(2000), rng.random((3, 2000, 49))
  made = masking.corruption(time_u, order_u, noise_u, keep_u, jnp.ones((2000, 49), bool))
  masked = made.masked.sum()
  shares = np.array([masked / made.masked.size, made.noised.sum() / masked, made.replaced.sum() / masked])
  np.testing.assert_allclose(shares, [0.635, 0.10, 0.792], atol=0.015)


def test_editing_masks():
  drawn = lambda mask: "".join(".1"[int(edited)] for edited in mask)
  for task, drawing in (("inpainting", "...111111..."), ("outpainting", "111......111"), ("prefix", "......111111"),
                        ("suffix", "111111......")):
    assert drawn(masking.task_mask(task, [48], 13)[0]) == drawing + ".", task
  with pytest.raises(ValueError, match="'upper_body'.*inpainting, outpainting, prefix, suffix"):
    masking.task_mask("upper_body", [48], 12)
  new = requested_frames(40, keep=[(0, 9), (20, 32)])  # a latent is kept if all its frames are
  assert drawn(edited_latents([new], 11, 4)[0]) == "..111...11."
  with pytest.raises(ValueError, match="span 10:50 of a motion of 40 frames"):
    requested_frames(40, keep=[(10, 50)])
