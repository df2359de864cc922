"""The generator trains, generates and edits as the reference does: its recorded runs."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.convert.state import from_torch, select
from motion_jax.models import cdamd
from motion_jax.models.cdamd import draws as draws_lib
from motion_jax.models.cdamd import unmasking
from motion_jax.models.cdamd.weight_names import mardm_names, masked_transformer_names
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.models.shared.autoencoder_weights import autoencoder_names
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.masks import padding_mask
from tests import fixtures
from tests.golden import check, golden, recordings
from tests.models.cdamd.test_cdamd_generator import LOSS
from tests.nets.naming import by_reference
from tests.nets.test_masked_transformer import cast, expected, sizes_of

DOPRI5 = 1e-9  # in float64; in float32 its steps follow rounding, and the result follows the steps (note 1 of README)


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
  for name, array in by_reference(grads["params"], table).items():
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


def recorded_draw(fixture, prefix, masked, dtype):
  """(noise (N, steps, B, L, C), dense start noise (N, B, L, C)), from rows recorded for the masked latents."""
  starts = [fixture[f"in/{prefix}start{k}"] for k in range(len(masked))]
  dense = np.zeros(masked.shape + starts[0].shape[1:], dtype)
  for k, rows in enumerate(starts):
    dense[k][masked[k]] = rows
  noise = [dense[:, None]]
  steps = fixture.under(f"in/{prefix}step0/")
  if steps:
    later = np.zeros((len(masked), len(steps)) + dense.shape[1:], dtype)
    for k in range(len(masked)):
      for j in range(len(steps)):
        later[k, j][masked[k]] = fixture[f"in/{prefix}step{k}/{j}"][:masked[k].sum()]
    noise.append(later)
  return np.concatenate(noise, axis=1), dense


@functools.partial(jax.jit, static_argnums=(0, 1, 2))
def recorded_latents(net, plan, scale, params, latents, text, schedule, real, noise):
  """The latents after each decoding iteration (N, B, L, C); compiled once for all runs of a size."""
  row = jnp.arange(len(latents))[:, None]
  state, step = cdamd.start_decoding(net, plan, params, latents, text_emb=text, schedule=schedule, real_mask=real,
                                     scale=scale, draw=lambda k, j, places: noise[k, j, row, places])

  def iteration(state, k):
    state = step(k, state)
    return state, state.latents

  return jax.lax.scan(iteration, state, jnp.arange(len(noise)))[1]


def run_iterations(fixture, dtype, net, params, latents, masked, real, prefix="", **fields):
  """The recorded loop -> outputs (latents after all iterations and at the end, counts, masked, start noise)."""
  noise, dense = recorded_draw(fixture, prefix, masked, dtype)
  text = jnp.asarray(fixture["in/text"], dtype)[:, None]
  made = recorded_latents(net, cdamd.make_plan(**fields), fixture.meta["arguments"]["scale"], params, latents, text,
                          unmasking.schedule(masked, unmasked_only=False), real, noise)
  return {"rounds": made, "latents": made[-1].swapaxes(1, 2), "masked": masked, "counts": masked.sum(-1),
          **{f"start_dense{k}": array for k, array in enumerate(dense)}}


def below(prefix, outputs, *names):
  return {prefix + name: array for name, array in outputs.items() if not names or name in names}


def generation(fixture, dtype, kind, **fields):
  """-> (run(**fields), net of the autoencoder or None) for a recorded generation."""
  net, params, _ = generator(fixture, dtype, kind)
  order, lengths = fixture["in/order"], fixture["in/lengths"]
  real = padding_mask(jnp.asarray(lengths), order.shape[1])
  masked = masking.masked_table(np.where(real, order, np.inf),
                                masking.masked_counts(fixture.meta["arguments"]["rounds"], lengths))
  latents = jnp.zeros(real.shape + (net.transformer.latent_dim,), dtype)
  return functools.partial(run_iterations, fixture, dtype, net, params, latents, masked, real, **fields)


@golden("generate", bounds={"euler": (5e-5, 1e-10), "masked": (0, 0), "counts": (0, 0), "start_dense": (0, 0),
                            "": (3e-2, DOPRI5)})
def run_generate(fixture, dtype):
  run = generation(fixture, dtype, "cdamd")
  autoencoder, params = coordinates(fixture, dtype)
  made = run(solver="dopri5")
  steps = int(fixture.stated(r"with (\d+) Euler", "out/euler/latents"))
  euler = below("euler/", run(solver="euler", num_steps=steps), "latents", "rounds")
  decode = jax.jit(lambda z: autoencoder.apply(params, z, method="decode"))
  return made | euler | {"motion": decode(made["latents"].swapaxes(1, 2)),
                         "euler/motion": decode(euler["euler/latents"].swapaxes(1, 2))}


@golden("generate_mardm", bounds={"masked": (0, 0), "counts": (0, 0), "start_dense": (0, 0), "": (1e-2, DOPRI5)})
def run_generate_mardm(fixture, dtype):
  return generation(fixture, dtype, "mardm")(solver="dopri5", mask="bidirectional")


@golden("generate_mardm_ddpm", bounds={"masked": (0, 0), "counts": (0, 0), "start_dense": (0, 0), "": (1e-5, 1e-10)})
def run_generate_mardm_ddpm(fixture, dtype):
  return generation(fixture, dtype, "mardm")(
      solver="ddpm", num_steps=len(fixture.under("in/step0/")), mask="bidirectional")


@golden("edit", leave_out=("free/",), bounds={
    **{f"{task}/{name}": (0, 0) for task in masking.TASKS for name in ("edit_mask", "masked", "counts", "start_dense")},
    "encoded": (1e-5, 1e-10), "": (3e-2, DOPRI5)})
def run_edit(fixture, dtype):
  """Of the editing tasks; the reference's pass over a motion of which no part is to be edited is not ours to give."""
  net, params, _ = generator(fixture, dtype)
  autoencoder, ae_params = coordinates(fixture, dtype)
  num_iterations, frames = fixture.meta["arguments"]["rounds"], fixture["in/frames"]
  x = jnp.asarray(fixture["in/motion"], dtype)
  encoded = jax.jit(lambda x: autoencoder.apply(ae_params, x, method="encode"))(x)
  decode = jax.jit(lambda z: autoencoder.apply(ae_params, z, method="decode"))
  real = padding_mask(jnp.asarray(frames // autoencoder.frames_per_latent), encoded.shape[1])
  made = {"encoded": encoded.swapaxes(1, 2)}
  for task in sorted({name.split("/")[0] for name in fixture.under("in/") if "/" in name} - {"free"}):
    edited = masking.task_mask(task, frames, encoded.shape[1])
    counts = masking.masked_counts(num_iterations, edited.sum(-1))
    masked = masking.masked_table(np.where(edited, fixture[f"in/{task}/order"], np.inf), counts)
    latents = jnp.where(real[..., None], encoded, 0)
    out = run_iterations(fixture, dtype, net, params, latents, masked, real, f"{task}/", solver="dopri5")
    kept = ~masked[0]
    np.testing.assert_array_equal(np.asarray(out["rounds"][-1])[kept], np.asarray(latents)[kept])  # bit for bit
    made |= below(f"{task}/", out | {"edit_mask": edited, "motion": decode(out["latents"].swapaxes(1, 2))})
  return made


@pytest.mark.slow
@recordings("train_step", "generate_mardm_ddpm", sharp=("generate",))
def test_golden(name, precision):
  assert not check(fixtures.path(f"cdamd/{name}.npz"), [precision]).failures


@pytest.mark.exhaustive
@recordings(sharp=("generate_mardm", "edit"))
def test_golden_of_what_the_others_imply(name, precision):
  """MARDM as a flow: a network of one and a solver of another recording. Editing: the loop of generating."""
  assert not check(fixtures.path(f"cdamd/{name}.npz"), [precision]).failures
