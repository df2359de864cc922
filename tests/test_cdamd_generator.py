"""The generator trains, generates and edits as the reference does; solving for what is unmasked changes nothing."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.convert.state import from_torch, select
from motion_jax.latents import AutoencoderCodec
from motion_jax.models import cdamd
from motion_jax.models.cdamd import draws as draws_lib
from motion_jax.models.cdamd import mask_schedule as masking
from motion_jax.models.cdamd import setup as setups
from motion_jax.models.cdamd.unmasking import most_unmasked
from motion_jax.models.cdamd.weight_names import autoencoder_names, mardm_names, masked_transformer_names
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.masks import padding_mask
from motion_jax.training.setup import untrained
from tests import fixtures
from tests.conftest import load_config
from tests.golden import check, golden
from tests.nets.test_masked_transformer import cast, expected, sizes_of

DOPRI5 = 1e-9  # in float64; in float32 its steps follow rounding, and the result follows the steps (note 1 of README)

LOSS = dict(mask="dccm", noise_rate=0.1, mask_rate=0.88, mask_draw="count", drop_rate=0.1, prior_drop_rate=0.0,
            prior_drop="batch", prior_levels=2, copies=4, diffusion="flow", ddpm_steps=50)


def generator(fixture, dtype, kind="cdamd"):
  """-> (net, params, table of names) of a recorded transformer with its diffusion head."""
  state = {name: array for name, array in fixture.params.items() if not name.startswith("ae.")}
  head = fixture.meta["arguments"]["diffusion"]
  transformer = sizes_of(fixture, state) | dict(kind=kind, dropout=0.0, dtype=dtype)
  net = cdamd.make_generator(ConfigDict(dict(transformer=transformer, head=head | dict(dtype=dtype)),
                                        convert_dict=False))
  names = {"cdamd": masked_transformer_names, "mardm": mardm_names}[kind]
  table = names(transformer["depth"], head["depth"])
  return net, cast(from_torch(state, table), dtype), table


def coordinates(fixture, dtype):
  """-> (net, params) of the recorded autoencoder."""
  sizes = fixture.meta["arguments"]["ae"]
  net = Autoencoder(features=sizes["input_width"], latent_dim=sizes["output_emb_width"], width=sizes["width"],
                    dtype=dtype)
  return net, cast(from_torch(select(fixture.params, "ae."), autoencoder_names()), dtype)


def to_torch(params, table):
  """Our arrays under the reference's names and layouts."""
  made = {}
  for theirs, (ours, kind) in table.items():
    node = params["params"]
    for key in ours.split("/"):
      node = node[key]
    if kind == "array":
      made[theirs] = node
      continue
    for leaf, array in node.items():
      made[f"{theirs}.{'bias' if leaf == 'bias' else 'weight'}"] = array.T if leaf == "kernel" else array
  return made


# --- recorded runs -----------------------------------------------------------------------------------------------


@golden("train_step", bounds={"grad_rows": (0, 0), "loss": (1e-6, 1e-10)})
def run_train_step(fixture, dtype):
  net, params, table = generator(fixture, dtype)
  given = {name: jnp.asarray(array, None if array.dtype.kind == "i" else dtype)
           for name, array in fixture.under("in/").items()}
  real = padding_mask(given["lengths"], given["latents"].shape[1])
  z1 = jnp.where(real[..., None], given["latents"], 0)
  masked = np.asarray(masking.choose_masked(given["time_u"], given["order_u"], real))
  copies = len(fixture["in/diffusion_t"]) // masked.sum()
  places = np.broadcast_to(masked, (copies,) + masked.shape)
  t, noise = np.zeros(places.shape, dtype), np.zeros(places.shape + z1.shape[2:], dtype)
  t[places], noise[places] = fixture["in/diffusion_t"], fixture["in/diffusion_noise"]
  draws = draws_lib.Draws(given["time_u"], given["text_u"], jnp.ones(len(real)), given["order_u"], given["noise_u"],
                      given["keep_u"], jnp.asarray(t), given["noise"], jnp.asarray(noise))
  config = ConfigDict(LOSS | dict(drop_rate=fixture.meta["arguments"]["cond_drop_prob"]))

  @jax.jit
  @jax.value_and_grad
  def loss(params):
    sums, weight = cdamd.generator_loss(net, params, z1, real, given["text"][:, None], given["codes"], draws, config)
    return sums["loss"] / weight

  value, grads = loss(params)
  rows = np.unique(fixture["in/codes"])  # only these of the table have a gradient at all
  made = {"loss": value, "grad_rows/token_emb.weight": rows}
  for name, array in to_torch(grads, table).items():
    recorded = expected(fixture, dtype)[f"grad/{name}"]
    if name == "token_emb.weight":
      array = array[rows]
    elif name.endswith("pos_emb"):
      array = array[:, :recorded.shape[1]]
    if np.abs(recorded).max() < 1e-7:  # biases of keys do nothing: both are rounding
      assert np.abs(array).max() < 1e-7, name
      array = recorded
    made[f"grad/{name}"] = array
  return made


def recorded_draw(fixture, prefix, hidden, dtype):
  """(noise (N, steps, B, L, C), dense start noise (N, B, L, C)), from rows recorded for the hidden latents."""
  starts = [fixture[f"in/{prefix}start{k}"] for k in range(len(hidden))]
  dense = np.zeros(hidden.shape + starts[0].shape[1:], dtype)
  for k, rows in enumerate(starts):
    dense[k][hidden[k]] = rows
  noise = [dense[:, None]]
  steps = fixture.under(f"in/{prefix}step0/")
  if steps:
    later = np.zeros((len(hidden), len(steps)) + dense.shape[1:], dtype)
    for k in range(len(hidden)):
      for j in range(len(steps)):
        later[k, j][hidden[k]] = fixture[f"in/{prefix}step{k}/{j}"][:hidden[k].sum()]
    noise.append(later)
  return np.concatenate(noise, axis=1), dense


@functools.partial(jax.jit, static_argnums=(0, 1, 2))
def recorded_latents(net, plan, scale, params, latents, text, hidden, real, noise):
  """Compiled once for all runs of a size."""
  return cdamd.make_latents(net, plan, params, latents, text_emb=text, hidden=hidden, real_mask=real, scale=scale,
                            draw=lambda k, j: noise[k, j])


def run_iterations(fixture, dtype, net, params, latents, hidden, real, prefix="", **fields):
  """The recorded loop -> outputs (latents after all iterations and at the end, counts, hidden, start noise)."""
  noise, dense = recorded_draw(fixture, prefix, hidden, dtype)
  text = jnp.asarray(fixture["in/text"], dtype)[:, None]
  made = recorded_latents(net, cdamd.make_plan(**fields), fixture.meta["arguments"]["scale"], params, latents, text,
                          hidden, real, noise)
  return {"rounds": made, "latents": made[-1].swapaxes(1, 2), "masked": hidden, "counts": hidden.sum(-1),
          **{f"start_dense{k}": array for k, array in enumerate(dense)}}


def below(prefix, outputs, *names):
  return {prefix + name: array for name, array in outputs.items() if not names or name in names}


def generation(fixture, dtype, kind, **fields):
  """-> (run(**fields), net of the autoencoder or None) for a recorded generation."""
  net, params, _ = generator(fixture, dtype, kind)
  order, lengths = fixture["in/order"], fixture["in/lengths"]
  real = padding_mask(jnp.asarray(lengths), order.shape[1])
  hidden = masking.hidden_table(np.where(real, order, np.inf),
                                masking.hidden_counts(fixture.meta["arguments"]["rounds"], lengths))
  latents = jnp.zeros(real.shape + (net.transformer.latent_dim,), dtype)
  return functools.partial(run_iterations, fixture, dtype, net, params, latents, hidden, real, **fields)


@golden("generate", bounds={"euler": (5e-5, 1e-10), "masked": (0, 0), "counts": (0, 0), "start_dense": (0, 0),
                            "": (3e-2, DOPRI5)})
def run_generate(fixture, dtype):
  run = generation(fixture, dtype, "cdamd")
  autoencoder, params = coordinates(fixture, dtype)
  made = run(solver="dopri5")
  euler = below("euler/", run(solver="euler", num_steps=10), "latents", "rounds")
  decode = jax.jit(lambda z: autoencoder.apply(params, z, method="decode"))
  return made | euler | {"motion": decode(made["latents"].swapaxes(1, 2)),
                         "euler/motion": decode(euler["euler/latents"].swapaxes(1, 2))}


@golden("generate_mardm", bounds={"masked": (0, 0), "counts": (0, 0), "start_dense": (0, 0), "": (1e-2, DOPRI5)})
def run_generate_mardm(fixture, dtype):
  return generation(fixture, dtype, "mardm")(solver="dopri5", mask="bidirectional")


@golden("generate_mardm_ddpm", bounds={"masked": (0, 0), "counts": (0, 0), "start_dense": (0, 0), "": (1e-5, 1e-10)})
def run_generate_mardm_ddpm(fixture, dtype):
  return generation(fixture, dtype, "mardm")(solver="ddpm", num_steps=50, mask="bidirectional")


def touch_up_counts(num_iterations, lengths, share=0.16):
  """(N, B): the same few latents in every iteration, what the reference does when it is told to edit no part.

  Parity: it draws an order anew each iteration, of latents that the one before left, so it never comes to others.
  """
  count = np.maximum(1, np.round(np.float32(share) * np.asarray(lengths, np.float32))).astype(np.int64)
  return np.broadcast_to(count, (num_iterations,) + count.shape)


@golden("edit", bounds={**{f"{task}/{name}": (0, 0) for task in (*masking.TASKS, "free")
                           for name in ("edit_mask", "masked", "counts", "start_dense")},
                        "encoded": (1e-5, 1e-10), "": (3e-2, DOPRI5)})
def run_edit(fixture, dtype):
  net, params, _ = generator(fixture, dtype)
  autoencoder, ae_params = coordinates(fixture, dtype)
  num_iterations, frames = fixture.meta["arguments"]["rounds"], fixture["in/frames"]
  x = jnp.asarray(fixture["in/motion"], dtype)
  encoded = jax.jit(lambda x: autoencoder.apply(ae_params, x, method="encode"))(x)
  decode = jax.jit(lambda z: autoencoder.apply(ae_params, z, method="decode"))
  real = padding_mask(jnp.asarray(frames // 4), encoded.shape[1])
  made = {"encoded": encoded.swapaxes(1, 2)}
  for task in sorted({name.split("/")[0] for name in fixture.under("in/") if "/" in name}):
    if task == "free":
      edited, counts = np.asarray(real), touch_up_counts(num_iterations, frames // 4)
    else:
      edited = masking.task_mask(task, frames, encoded.shape[1])
      counts = masking.hidden_counts(num_iterations, edited.sum(-1))
    hidden = masking.hidden_table(np.where(edited, fixture[f"in/{task}/order"], np.inf), counts)
    latents = jnp.where(real[..., None], encoded, 0)
    out = run_iterations(fixture, dtype, net, params, latents, hidden, real, f"{task}/", solver="dopri5")
    kept = ~hidden[0]
    np.testing.assert_array_equal(np.asarray(out["rounds"][-1])[kept], np.asarray(latents)[kept])  # bit for bit
    made |= below(f"{task}/", out | {"edit_mask": edited, "motion": decode(out["latents"].swapaxes(1, 2))})
  return made


@pytest.mark.parametrize("name", ["train_step", "generate", "generate_mardm", "generate_mardm_ddpm", "edit"])
def test_golden(name):
  assert not check(fixtures.path(f"cdamd/{name}.npz")).failures


# --- invariants of our own ---------------------------------------------------------------------------------------

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


def make(lengths, length=LENGTH, order="random", seed=0, dtype=jnp.float32, unmasked_only=True, **fields):
  """-> (latents (B, L, C), hidden (N, B, L)) of our own draws; motion i has the key of i, wherever it stands."""
  net, params = small()
  keys = jax.vmap(lambda i: jax.random.fold_in(jax.random.key(seed), i))(jnp.arange(len(lengths)))
  counts = masking.hidden_counts(ITERATIONS, lengths)
  hidden = masking.hidden_table(draws_lib.draw_order(keys, lengths, length, order), counts)
  plan = cdamd.make_plan(num_rows=most_unmasked(counts) if unmasked_only else None, **fields)
  real = padding_mask(jnp.asarray(lengths), length)
  text = jnp.asarray(np.random.default_rng(1).normal(size=(4, 1, 6))[:len(lengths)], dtype)
  net = net if dtype == jnp.float32 else _wide()
  made = _make(net, plan, length, cast(params, dtype), text, hidden, real, keys)
  return np.asarray(made[-1]), hidden


def _wide():
  fields = MODEL.to_dict()
  for part in fields.values():
    part["dtype"] = jnp.float64
  return cdamd.make_generator(ConfigDict(fields, convert_dict=False))


@functools.partial(jax.jit, static_argnums=(0, 1, 2))
def _make(net, plan, length, params, text, hidden, real, keys):
  channels = net.transformer.latent_dim
  latents = jnp.zeros((len(keys), length, channels), text.dtype)
  return cdamd.make_latents(net, plan, params, latents, text_emb=text, hidden=hidden, real_mask=real, scale=3.0,
                            draw=draws_lib.make_draw(keys, length, channels))


@pytest.mark.parametrize("solver, mask", [("euler", "causal"), ("midpoint", "bcm"), ("ddpm", "dccm")])
def test_solving_for_unmasked_latents_alone_changes_nothing(solver, mask):
  """In float64 nothing but rounding is left; with steps of its own the solver would differ by its error."""
  with jax.enable_x64(True):
    run = functools.partial(make, [9, 6, 1], solver=solver, num_steps=3, mask=mask, dtype=jnp.float64)
    few, hidden = run()
    every, _ = run(unmasked_only=False)
  assert hidden.sum() > 2 * 16  # rows solved for without the trick, of 16 latents
  size = max(1, np.abs(every).max())  # the first step back of a DDPM divides by a thousandth
  np.testing.assert_allclose(few / size, every / size, rtol=0, atol=1e-12)
  assert np.abs(few).max() > 0.1 and not few[1, 6:].any()


def test_padding_and_batch_mates_are_invisible():
  alone, _ = make([6], num_steps=2, length=6)
  padded, _ = make([6, 9], num_steps=2)
  np.testing.assert_allclose(padded[:1, :6], alone, atol=2e-5)


def test_left_to_right_never_looks_ahead():
  """Under the causal mask a motion's beginning does not depend on how long it goes on."""
  short, hidden = make([9], num_steps=2, order="left_to_right")
  first = masking.unmasked_table(hidden)[:, 0].argmax(0)
  assert (np.diff(first) >= 0).all()
  with pytest.raises(ValueError, match="'middle'.*random or left_to_right"):
    make([9], order="middle")


def test_an_edit_changes_what_it_should():
  """Kept latents stay to the bit, kept frames with paste; under BCM a hole sees its right side, causally not."""
  net, params = small()
  autoencoder = Autoencoder(features=6, latent_dim=3, width=8)
  x = jnp.asarray(np.random.default_rng(2).normal(size=(1, 36, 6)), jnp.float32)
  tokenizer = untrained(jax.eval_shape(autoencoder.init, jax.random.key(3), x))
  codec = AutoencoderCodec(autoencoder, tokenizer, jnp.full(3, 0.1), jnp.full(3, 2.0))
  real, edited = jnp.ones((1, 9), bool), masking.task_mask("inpainting", [36], 9)
  counts = masking.hidden_counts(ITERATIONS, edited.sum(-1))
  keys = jax.random.split(jax.random.key(0), 1)
  hidden = masking.hidden_table(np.where(edited, draws_lib.draw_order(keys, [9], 9), np.inf), counts)

  text, draw = jnp.ones((1, 1, 6)), draws_lib.make_draw(keys, 9, 3)
  plan = cdamd.make_plan(solver="euler", num_steps=2, num_rows=most_unmasked(counts))
  latents = jax.jit(lambda x: codec.encode(x, real))(x)
  run = jax.jit(lambda z, mask: cdamd.make_latents(
      net, plan._replace(mask=mask), params, z, text_emb=text, hidden=hidden, real_mask=real, scale=3.0,
      draw=draw)[-1], static_argnums=1)
  for mask in ("causal", "bcm"):
    made = np.asarray(run(latents, mask))
    np.testing.assert_array_equal(made[~edited], np.asarray(latents)[~edited])
    assert (np.abs(made - latents).max(-1) > 1e-3)[edited].all()
    moved = np.abs(run(latents.at[:, 7:].add(1.0), mask) - made).max(-1)[edited]
    assert (moved > 1e-5).all() if mask == "bcm" else not moved.any()

  kept = np.repeat(~edited, 4, axis=1)
  run = jax.jit(lambda x, paste: cdamd.edit(
      net, plan, params, codec, x, text_emb=text, edited=edited, hidden=hidden, real_mask=real, scale=3.0, draw=draw,
      paste=paste), static_argnums=1)
  np.testing.assert_array_equal(np.asarray(run(x, True))[kept], np.asarray(x)[kept])
  assert np.abs(run(x, False) - x).max(-1)[kept].min() > 0


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


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_head_in_parts_gives_the_sum_and_the_gradients_of_all_rows(share, monkeypatch):
  """The loop over parts, against one part of all rows: with nothing, some and all of 3 x LENGTH latents masked."""
  net, params = small()
  params = jax.tree.map(lambda a: a.astype(jnp.float32), params)  # recorded runs in float64 may have made them
  keys = jax.random.split(jax.random.key(2), 4)
  z1, codes = jax.random.normal(keys[0], (3, LENGTH, 3)), jax.random.randint(keys[1], (3, LENGTH, 2), 0, 9)
  text, real = jnp.ones((3, 1, 6)), padding_mask(jnp.array([LENGTH, LENGTH, 3 if share else 0]), LENGTH)
  masked = jax.random.bernoulli(keys[3], share, real.shape) & real
  monkeypatch.setattr(masking, "choose_masked", lambda *_: masked)
  config = ConfigDict(LOSS | dict(diffusion="flow", copies=2))
  draws = draws_lib.draw_step(keys[2], jax.random.split(keys[2], 3), LENGTH, 3, config)

  def value_and_grad(least_rows):
    monkeypatch.setattr(cdamd.losses, "LEAST_ROWS", least_rows)
    return jax.jit(jax.value_and_grad(lambda params: cdamd.generator_loss(
        net, params, z1, real, text, codes, draws, config)[0]["loss"]))(params)

  whole, parts = value_and_grad(10_000), value_and_grad(4)
  assert bool(whole[0] > 0) == bool(share)
  jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5), parts, whole)


def test_an_item_draws_one_of_several_masks():
  known, real = jax.random.bernoulli(jax.random.key(0), 0.5, (4, LENGTH)), padding_mask(jnp.array([9, 9, 5, 9]), LENGTH)
  mixed = cdamd.trained_mask("dccm+bcm", known, real, jnp.array([0.0, 0.49, 0.5, 0.99]))
  single = {kind: cdamd.trained_mask(kind, known, real) for kind in ("dccm", "bcm")}
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


def test_scaled_latents_are_undone_before_the_decoder():
  net = Autoencoder(features=6, latent_dim=3, width=8)
  x = jnp.asarray(np.random.default_rng(2).normal(size=(2, 16, 6)), jnp.float32)
  tokenizer = untrained(jax.eval_shape(net.init, jax.random.key(3), x))
  codec = AutoencoderCodec(net, tokenizer)
  fitted = codec.fitted(list(np.asarray(x)), length=16)
  real = padding_mask(jnp.array([4, 3]), 4)
  run = jax.jit(lambda codec: (lambda z: (z, codec.decode(z, real)))(codec.encode(x, real)))
  plain, y = run(codec.unscaled())
  scaled, same = run(fitted)
  np.testing.assert_allclose(plain, np.where(real[..., None], scaled * fitted.std + fitted.mean, 0), atol=1e-5)
  np.testing.assert_allclose(y[0], same[0], atol=1e-5)
  assert not scaled[1, 3].any() and np.abs(scaled - plain)[0].max() > 0.1


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
  draw = lambda keys: draws_lib.draw_step(jax.random.key(2), keys, LENGTH, 3, config)
  whole, half = draw(keys), draw(keys[2:])
  np.testing.assert_array_equal(whole.noise[2:], half.noise)
  np.testing.assert_array_equal(whole.diffusion_noise[:, 2:], half.diffusion_noise)
  np.testing.assert_array_equal(whole.prior_u[2:], half.prior_u)
  assert len(np.unique(whole.prior_u)) == 1 and len(np.unique(whole.text_u)) == 4
  config.prior_drop = "item"
  assert len(np.unique(draw(keys).prior_u)) == 4


def test_what_does_not_fit_is_told():
  with pytest.raises(ValueError, match="'rk5'.*euler, heun, midpoint, rk4, dopri5, ddpm"):
    cdamd.make_plan(solver="rk5")
  with pytest.raises(ValueError, match="'dcc'.*dccm"):
    cdamd.make_plan(mask="dcc")
  with pytest.raises(ValueError, match="0 solver steps"):
    cdamd.make_plan(num_steps=0)
  with pytest.raises(ValueError, match="'vae'.*cdamd, mardm"):
    cdamd.make_generator(ConfigDict(dict(transformer=dict(kind="vae"), head={})))
