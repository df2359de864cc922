"""Solving for what is unmasked changes nothing; what the generator's loss counts, which latents an edit keeps, and what
does not fit is told."""
import functools

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.models import cdamd
from motion_jax.models.cdamd import draws as draws_lib
from motion_jax.models.cdamd import setup as setups
from motion_jax.models.cdamd import unmasking
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.nets.masks import padding_mask
from tests.conftest import load_config
from tests.nets.test_masked_transformer import cast

LOSS = dict(mask="dccm", noise_rate=0.1, mask_rate=0.88, mask_draw="count", drop_rate=0.1, prior_drop_rate=0.0,
            prior_drop="batch", prior_levels=2, copies=4, diffusion="flow", ddpm_steps=50)

LENGTH, ITERATIONS = 9, 5
MODEL = ConfigDict(dict(transformer=dict(kind="cdamd", latent_dim=3, width=16, depth=1, num_heads=2, ff_width=16,
                                         text_dim=6, num_codes=9, num_levels=2, max_length=16, dropout=0.0),
                        head=dict(width=16, depth=1)))


@functools.cache
def small():
  """A small generator whose layers are all random: zero gates would pass any test."""
  net = cdamd.make_generator(MODEL)
  leaves, tree = jax.tree.flatten(cdamd.generator_shapes(net))
  draw = np.random.default_rng(0)
  return net, tree.unflatten([jnp.asarray(0.3 * draw.normal(size=a.shape), a.dtype) for a in leaves])


def make(lengths, length=LENGTH, order="random", seed=0, dtype=jnp.float32, unmasked_only=True, num_rows=2,
         num_iterations=ITERATIONS, **fields):
  """-> (latents (B, L, C), masked (N, B, L)) of our own draws; motion i has the key of i, wherever it stands."""
  net, params = small()
  keys = jax.vmap(lambda i: jax.random.fold_in(jax.random.key(seed), i))(jnp.arange(len(lengths)))
  counts = masking.masked_counts(num_iterations, lengths)
  masked = masking.masked_table(draws_lib.draw_order(keys, lengths, length, order), counts)
  plan = cdamd.make_plan(num_rows=num_rows if unmasked_only else None, **fields)
  real = padding_mask(jnp.asarray(lengths), length)
  text = jnp.asarray(np.random.default_rng(1).normal(size=(4, 1, 6))[:len(lengths)], dtype)
  net = net if dtype == jnp.float32 else _wide()
  schedule = unmasking.schedule(masked, unmasked_only)
  return np.asarray(_make(net, plan, length, cast(params, dtype), text, schedule, real, keys)), masked


def _wide():
  fields = MODEL.to_dict()
  for part in fields.values():
    part["dtype"] = jnp.float64
  return cdamd.make_generator(ConfigDict(fields, convert_dict=False))


@functools.partial(jax.jit, static_argnums=(0, 1, 2))
def _make(net, plan, length, params, text, schedule, real, keys):
  channels = net.transformer.latent_dim
  latents = jnp.zeros((len(keys), length, channels), text.dtype)
  return cdamd.make_latents(net, plan, params, latents, text_emb=text, schedule=schedule, real_mask=real, scale=3.0,
                            draw=draws_lib.make_draw(keys, channels))


@pytest.mark.parametrize("solver, mask", [
    pytest.param("midpoint", "bcm", marks=pytest.mark.slow),
    pytest.param("ddpm", "dccm", marks=pytest.mark.exhaustive)])
def test_solving_for_unmasked_latents_alone_changes_nothing(solver, mask):
  """In float64 nothing but rounding is left; with steps of its own the solver would differ by its error."""
  with jax.enable_x64(True):
    run = functools.partial(make, [9, 6, 1], solver=solver, num_steps=3, mask=mask, dtype=jnp.float64)
    few, masked = run()
    every, _ = run(unmasked_only=False)
  assert masked.sum() > 2 * 16  # rows solved for without the trick, of 16 latents
  size = max(1, np.abs(every).max())  # the first step back of a DDPM divides by a thousandth
  np.testing.assert_allclose(few / size, every / size, rtol=0, atol=1e-12)
  assert np.abs(few).max() > 0.1 and not few[1, 6:].any()


@pytest.mark.slow
def test_padding_and_batch_mates_are_invisible():
  alone, _ = make([6], num_steps=2, length=6)
  padded, _ = make([6, 9], num_steps=2)
  np.testing.assert_allclose(padded[:1, :6], alone, atol=2e-5)


@pytest.mark.parametrize("num_iterations, num_rows", [
    pytest.param(9, 2, marks=pytest.mark.slow), pytest.param(6, 1, marks=pytest.mark.exhaustive)])
def test_a_window_with_a_cache_is_the_whole_pass(num_iterations, num_rows):
  """Left to right under the causal mask: earlier latents are computed once. In float64 only rounding is left."""
  with jax.enable_x64(True):
    run = functools.partial(make, [9, 6, 1], order="left_to_right", num_iterations=num_iterations, solver="euler",
                            num_steps=2, dtype=jnp.float64, num_rows=num_rows)
    whole, masked = run()
    made_at = unmasking.schedule(masked).made_at
    assert (np.diff(made_at[0]) >= 0).all()
    assert unmasking.span(made_at) == {9: 3, 6: 4}[num_iterations]
    windowed, _ = run(window=4)
  np.testing.assert_allclose(windowed, whole, rtol=0, atol=1e-12)
  assert np.abs(whole[0]).min() > 0
  with pytest.raises(ValueError, match="got a window with the mask 'bcm'"):
    cdamd.make_plan(window=4, mask="bcm")


def test_a_schedule_leaves_idle_iterations_out():
  masked = np.array([[[1, 1, 0], [1, 1, 1]], [[1, 0, 0], [1, 1, 1]], [[1, 0, 0], [1, 1, 0]], [[1, 0, 0], [0, 1, 0]]],
                    bool)
  made = unmasking.schedule(masked)
  assert made.made_at.tolist() == [[1, 0, -1], [1, 2, 0]] and made.num_iterations == 3
  assert made.drawn_at.tolist() == [[3, 0, -1], [2, 3, 1]]
  assert unmasking.schedule(masked, unmasked_only=False).num_iterations == 4
  assert unmasking.span(np.array([[2, 2, 1, 0, 0]])) == 5  # the first iteration needs what comes before
  assert unmasking.span(np.array([[0, 1, 1, 2, 3]])) == 3


def test_solvers_of_fixed_steps_are_one_program():
  plans = {cdamd.make_plan(solver=solver, num_steps=steps).split()[0]
           for solver, steps in (("euler", 3), ("midpoint", 10), ("rk4", 1))}
  assert len(plans) == 1 and cdamd.make_plan(solver="dopri5").split()[1] is None


def test_noise_that_is_shared():
  keys = jax.random.split(jax.random.key(3), 400)
  places = lambda keys: np.broadcast_to(np.arange(6), (len(keys), 6))
  drawn = jax.jit(lambda keys, k, shared: draws_lib.make_draw(keys, 4, shared)(k, 0, places(keys)), static_argnums=2)
  draw = lambda shared, keys=keys, k=1: np.asarray(drawn(keys, np.full_like(places(keys), k), shared))
  alone, half, one = (draw(shared) for shared in (0.0, 0.5, 1.0))
  assert (one == one[:, :1]).all() and (one == draw(1.0, k=2)).all() and not (alone == draw(0.0, k=2)).any()
  np.testing.assert_array_equal(draw(0.5, keys[7:8])[0], half[7])  # batch-mates change nothing
  for noise, shared in ((alone, 0), (half, 0.5), (one, 1)):
    assert abs(noise.mean()) < 0.06 and abs(noise.std() - 1) < 0.06  # of each latent a standard normal
    assert abs((noise[:, 0] * noise[:, 5]).mean() - shared) < 0.12
  with pytest.raises(ValueError, match="got 1.5 of the noise to share, expected 0 to 1"):
    cdamd.make_plan(shared_noise=1.5)


@pytest.mark.slow
def test_an_edit_changes_what_it_should():
  """Kept latents stay to the bit; under BCM a hole sees its right side, causally not."""
  net, params = small()
  real, edited = np.ones((1, 9), bool), masking.task_mask("inpainting", [36], 9)
  counts = masking.masked_counts(ITERATIONS, edited.sum(-1))
  keys = jax.random.split(jax.random.key(0), 1)
  schedule = unmasking.schedule(masking.masked_table(
      np.where(edited, draws_lib.draw_order(keys, [9], 9), np.inf), counts))
  plan = cdamd.make_plan(solver="euler", num_steps=2, num_rows=unmasking.most_unmasked(counts))
  latents = np.random.default_rng(2).normal(size=(1, 9, 3)).astype(np.float32)
  run = jax.jit(lambda z, mask: cdamd.make_latents(
      net, plan._replace(mask=mask), params, z, text_emb=jnp.ones((1, 1, 6)), schedule=schedule, real_mask=real,
      scale=3.0, draw=draws_lib.make_draw(keys, 3)), static_argnums=1)
  for mask in ("causal", "bcm"):
    made = np.asarray(run(latents, mask))
    np.testing.assert_array_equal(made[~edited], latents[~edited])
    assert (np.abs(made - latents).max(-1) > 1e-3)[edited].all()
    moved = np.abs(run(latents + (np.arange(9) >= 7)[:, None], mask) - made).max(-1)[edited]
    assert (moved > 1e-5).all() if mask == "bcm" else not moved.any()


@pytest.mark.slow
def test_all_rows_weighted_is_masked_rows_averaged():
  """Also for DDPM; a batch with nothing masked has no loss, and not a number that is none."""
  net, params = small()
  keys = jax.random.split(jax.random.key(1), 3)
  z1, codes = jax.random.normal(keys[0], (3, LENGTH, 3)), jax.random.randint(keys[1], (3, LENGTH, 2), 0, 9)
  text, real = jnp.ones((3, 1, 6)), padding_mask(jnp.array([9, 5, 3]), LENGTH)
  for diffusion in ("flow", "ddpm"):
    config = ConfigDict(LOSS | dict(diffusion=diffusion, ddpm_steps=5, copies=2))
    draws = draws_lib.draw_step(keys[2], keys, LENGTH, 3, config)
    run = jax.jit(lambda real, draws, config=config: cdamd.generator_loss(net, params, z1, real, text, codes, draws,
                                                                          config))
    sums, weight = run(real, draws)
    masked = np.asarray(masking.choose_masked(draws.time_u, draws.order_u, real))
    assert weight == 2 * masked.sum() and 0 < sums["loss"] < np.inf
    # Rows that are not masked may hold anything.
    other = jnp.where(masked[None, ..., None], draws.diffusion_noise, 7.0)
    np.testing.assert_allclose(run(real, draws._replace(diffusion_noise=other))[0]["loss"], sums["loss"], rtol=1e-6)
    sums, weight = run(jnp.zeros_like(real), draws)
    assert sums["loss"] / weight == 0


HEAD = ConfigDict(LOSS | dict(diffusion="flow", copies=2))


@functools.cache
def loss_in_parts(least_rows):
  """-> function(params, masked, ...), compiled once: the loss and its gradients with the head in parts of these sizes,
  where the latents of `masked` (B, L) are masked."""
  @jax.jit
  @jax.value_and_grad
  def loss(params, masked, z1, real, text, codes, draws):
    with pytest.MonkeyPatch.context() as patch:
      patch.setattr(masking, "choose_masked", lambda *_: masked)
      patch.setattr(cdamd.losses, "LEAST_ROWS", least_rows)
      return cdamd.generator_loss(_wide(), params, z1, real, text, codes, draws, HEAD)[0]["loss"]

  return loss


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
@pytest.mark.slow
def test_the_head_in_parts_gives_the_sum_and_the_gradients_of_all_rows(share):
  """The loop over parts, against one part of all rows: with nothing, some and all of 3 x LENGTH latents masked.

  In float64: gradients are sums that nearly cancel, and what float32 rounds off depends on the processor.
  """
  with jax.enable_x64(True):
    params = cast(small()[1], jnp.float64)
    keys = jax.random.split(jax.random.key(2), 4)
    z1, codes = jax.random.normal(keys[0], (3, LENGTH, 3)), jax.random.randint(keys[1], (3, LENGTH, 2), 0, 9)
    text, real = jnp.ones((3, 1, 6)), padding_mask(jnp.array([LENGTH, LENGTH, 3 if share else 0]), LENGTH)
    masked = jax.random.bernoulli(keys[3], share, real.shape) & real
    draws = draws_lib.draw_step(keys[2], jax.random.split(keys[2], 3), LENGTH, 3, HEAD)
    whole, parts = (loss_in_parts(rows)(params, masked, z1, real, text, codes, draws) for rows in (10_000, 4))
    assert bool(whole[0] > 0) == bool(share)
    chex.assert_trees_all_close(parts, whole, rtol=1e-9, atol=1e-9)


def test_an_item_draws_one_of_several_masks():
  known, real = np.random.default_rng(0).random((4, LENGTH)) < 0.5, np.arange(LENGTH) < np.array([[9], [9], [5], [9]])
  mask = jax.jit(cdamd.trained_mask, static_argnums=0)
  mixed = mask("dccm+bcm", known, real, np.array([0.0, 0.49, 0.5, 0.99]))
  single = {kind: mask(kind, known, real) for kind in ("dccm", "bcm")}
  for i, kind in enumerate(("dccm", "dccm", "bcm", "bcm")):
    np.testing.assert_array_equal(mixed[i], single[kind][i])
  assert (single["bcm"] != single["dccm"]).any()


@pytest.mark.parametrize("changes, told", [
    ({"model.transformer.latent_dim": 5}, "latent_dim = 5"), ({"quantizer.num_codes": 4000}, "num_codes = 4000"),
    ({"loss.prior_levels": 5}, "prior_levels = 5"), ({"model.transformer.kind": "mardm"}, "no prior")])
def test_sections_that_do_not_fit_are_told(changes, told):
  config = load_config("cdamd_generator", "tiny")
  config.update_from_flattened_dict(changes)
  with pytest.raises(ValueError, match=told):
    setups.generator(config)


def test_the_papers_reconstruction_loss_is_an_option():
  """L1 alone (CDAMD eq. 7); by default smooth L1, and once more over columns 4 on."""
  x, y = jnp.zeros((1, 2, 8)), jnp.concatenate([jnp.full((1, 2, 4), 0.5), jnp.full((1, 2, 4), 3.0)], axis=-1)
  terms = cdamd.autoencoder_terms(y, x, distance="l1", position_weight=0.0)
  np.testing.assert_allclose(terms["loss"], 1.75)
  terms = cdamd.autoencoder_terms(y, x)
  np.testing.assert_allclose([terms["rec"], terms["positions"], terms["loss"]], [1.3125, 2.5, 3.8125])


def test_draws_do_not_depend_on_the_number_of_devices():
  config = ConfigDict(LOSS)
  keys = jax.random.split(jax.random.key(1), 4)
  draw = jax.jit(lambda keys: draws_lib.draw_step(jax.random.key(2), keys, LENGTH, 3, config))
  whole, half = draw(keys), draw(keys[2:])
  np.testing.assert_array_equal(whole.noise[2:], half.noise)
  np.testing.assert_array_equal(whole.diffusion_noise[:, 2:], half.diffusion_noise)
  np.testing.assert_array_equal(whole.prior_u[2:], half.prior_u)
  assert len(np.unique(whole.prior_u)) == 1 and len(np.unique(whole.text_u)) == 4
  config.prior_drop = "item"
  by_item = jax.jit(lambda: draws_lib.draw_step(jax.random.key(2), keys, LENGTH, 3, config).prior_u)()
  assert len(np.unique(by_item)) == 4


def test_what_does_not_fit_is_refused():
  with pytest.raises(ValueError, match="'middle'.*random or left_to_right"):
    draws_lib.draw_order(jax.random.split(jax.random.key(0), 1), [9], 9, "middle")
  with pytest.raises(ValueError, match="'rk5'.*euler, heun, midpoint, rk4, dopri5, ddpm"):
    cdamd.make_plan(solver="rk5")
  with pytest.raises(ValueError, match="'dcc'.*dccm"):
    cdamd.make_plan(mask="dcc")
  with pytest.raises(ValueError, match="0 solver steps"):
    cdamd.make_plan(num_steps=0)
  with pytest.raises(ValueError, match="'vae'.*cdamd, mardm"):
    cdamd.make_generator(ConfigDict(dict(transformer=dict(kind="vae"), head={})))
