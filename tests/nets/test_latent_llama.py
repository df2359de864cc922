"""MotionStreamer's transformer and head are the reference's; a cache gives the rows of the whole sequence."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.diffusion import ddpm, guidance
from motion_jax.models.motionstreamer.weight_names import generator_names
from motion_jax.nets.diffusion_mlp import DiffusionMLP
from motion_jax.nets.latent_llama import LatentGenerator, LatentLlama
from tests import fixtures
from tests.golden import check, golden, recordings

HEAD = "diff_loss.net."


def state_of(fixture, prefix):
  return {name[len(prefix):]: array for name, array in fixture.params.items() if name.startswith(prefix)}


def head_of(state, depth, dtype, prefix=HEAD):
  width, latent_dim = state[f"{prefix}input_proj.weight"].shape
  return DiffusionMLP(latent_dim, width, depth, dtype=dtype)


def generator(fixture, dtype, prefix=""):
  """-> (net, params, table) of a recorded transformer with its head; all sizes are those of its tensors."""
  sizes, state = fixture.meta["arguments"], state_of(fixture, prefix)
  width, latent_dim = state["transformer.wte.weight"].shape
  head_depth = sizes["num_diffusion_head_layers"]
  llama = LatentLlama(latent_dim, width, sizes["n_layer"], sizes["n_head"], sizes["T5_xxl_dim"], sizes["block_size"],
                      state["transformer.h.0.mlp.c_fc1.weight"].shape[0], dtype=dtype)
  assert llama.clone(mlp_width=0).mlp_width == 0
  net, table = LatentGenerator(llama, head_of(state, head_depth, dtype)), generator_names(sizes["n_layer"], head_depth)
  return net, jax.tree.map(lambda a: jnp.asarray(a, dtype), from_torch(state, table)), table


def scales(net, prefix=""):
  """{name: first value} of the attention's scale in each layer."""
  made = net.transformer if isinstance(net, LatentGenerator) else net
  params = made.init(jax.random.key(0), jnp.zeros((1, made.text_dim)), jnp.zeros((1, 1, made.latent_dim)))["params"]
  exact = np.log2(float(made.max_length) ** 2 - made.max_length)
  for i in range(made.depth):
    np.testing.assert_allclose(params[f"block{i}"]["attn"]["logit_scale"], exact, rtol=1e-6)
  return {f"{prefix}scale_init/{i}": exact for i in range(made.depth)}


@golden("ms_transformer", bounds={"": (1e-5, 1e-10)})
def run_ms_transformer(fixture, dtype):
  net, params, _ = generator(fixture, dtype)
  text, latents = (jnp.asarray(fixture[f"in/{name}"], dtype) for name in ("text", "latents"))
  rows = jax.jit(lambda x: net.apply(params, text, x, method="condition"))(latents)
  first = net.apply(params, text[:1], latents[:1, :0], method="condition")

  @jax.jit
  def cached(latents):
    """One row after the other, then all latents at once."""
    cache = net.apply(params, len(text), method="init_cache")
    row, cache = net.apply(params, text, cache, method="begin")
    once = net.apply(params, latents, cache, method="extend")[0]
    made = [row]
    for i in range(latents.shape[1]):
      row, cache = net.apply(params, latents[:, i:i + 1], cache, method="extend")
      made.append(row)
    return jnp.concatenate(made, axis=1), once

  by_row, once = cached(latents)
  exact = 1e-5 if dtype == jnp.float32 else 1e-12
  np.testing.assert_allclose(by_row, rows, atol=exact)
  np.testing.assert_allclose(once, rows[:, 1:], atol=exact)
  return {"conditions": by_row, "first": first, **scales(net)}


@golden("ms_head", leave_out=("grad/",), bounds={
    "tables/posterior_log": (1e-9, 1e-9), "tables": (1e-12, 1e-12), "loss": (1e-6, 1e-10),
    "predicted_noise": (1e-6, 1e-10), "": (1e-5, 1e-10)})
def run_ms_head(fixture, dtype):
  sizes, state = fixture.meta["arguments"], fixture.params
  table = {name: value for name, value in generator_names(0, sizes["num_diffusion_head_layers"]).items()
           if name.startswith(HEAD)}
  table = {name: (ours.removeprefix("head/"), kind) for name, (ours, kind) in table.items()}
  net = head_of(state, sizes["num_diffusion_head_layers"], dtype)
  params = jax.tree.map(lambda a: jnp.asarray(a, dtype), from_torch(state, table))
  given = {name: jnp.asarray(a, dtype if a.dtype.kind == "f" else None) for name, a in fixture.under("in/").items()}
  schedule = ddpm.cosine_schedule(sizes["steps"])
  made = {f"tables/{name}": getattr(schedule, name) for name in (
      "betas", "alphas_cumprod", "posterior_log_variance_clipped", "posterior_mean_coef1", "posterior_mean_coef2")}
  noisy = ddpm.add_noise(schedule, given["target"], given["noise"], given["t"])
  made["predicted_noise"] = jax.jit(net.apply)(params, noisy, given["t"], given["z"])
  made["loss"] = ((made["predicted_noise"] - given["noise"]) ** 2).mean()
  made["x0"] = ddpm.x1_of_noise(schedule, noisy, made["predicted_noise"], given["t"])

  def run(scale, temperature):
    z = given["z"] if scale is None else jnp.concatenate([given["z"], given["z_empty"]])
    noise_of = lambda x, t, z=z: net.apply(params, x, jnp.broadcast_to(t, len(x)), z)
    both = lambda x, t: guidance.combine(*jnp.split(noise_of(jnp.concatenate([x, x]), t), 2), scale)
    fresh = given["steps"][:, :len(given["start"])]
    return jax.jit(lambda x: ddpm.ancestral(noise_of if scale is None else both, schedule, x, fresh.__getitem__,
                                            temperature))(given["start"])

  made |= {"guided": run(sizes["scale"], 1.0), "guided_cool": run(sizes["scale"], sizes["temperature"]),
           "plain": run(None, 1.0)}
  return made


@pytest.mark.slow
@recordings("ms_transformer", "ms_head")
def test_golden(name, precision):
  assert not check(fixtures.path(f"motionstreamer/{name}.npz"), [precision]).failures


def test_too_many_latents_are_refused():
  net = LatentLlama(4, 8, 1, 2, 3, max_length=5)
  with pytest.raises(ValueError, match="got 5 latents, this transformer has places for 4"):
    net.init(jax.random.key(0), jnp.zeros((1, 3)), jnp.zeros((1, 5, 4)))
