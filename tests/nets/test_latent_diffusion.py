"""MLD's VAE and denoiser are the reference's, in all variants; padding changes nothing."""
import jax
import jax.numpy as jnp
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.models.mld.weight_names import UNUSED, denoiser_names, vae_names
from motion_jax.nets.latent_diffusion import TokenDenoiser, TokenVAE
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.skip_transformer import SkipTransformer
from tests import fixtures
from tests.golden import check, golden, recordings


def part_of(fixture, prefix):
  return {name[len(prefix):]: array for name, array in fixture.params.items() if name.startswith(prefix)}


def vae(fixture, dtype, prefix="", **fields):
  """-> (net, params, table) of a recorded VAE."""
  sizes, state = fixture.meta["arguments"], part_of(fixture, prefix)
  count, width = state["global_motion_token"].shape
  linear = "dist_layer.weight" in state
  depth = sizes["layers"]
  fields |= dict(distribution="linear" if linear else "tokens",
                 position_kind="learned" if "query_pos_encoder.pe" in state else "sines")
  net = TokenVAE(state["final_layer.weight"].shape[0], width, count if linear else count // 2, depth, sizes["heads"],
                 sizes["ff"], dtype=dtype, **fields)
  table = vae_names(depth, net.distribution, net.decoder, net.position_kind)
  return net, jax.tree.map(lambda a: jnp.asarray(a, dtype), from_torch(state, table)), table


def denoiser(fixture, dtype, prefix=""):
  """-> (net, params, table) of a recorded denoiser."""
  sizes, state = fixture.meta["arguments"], part_of(fixture, prefix)
  features = len(state["pose_proj.weight"]) if "pose_proj.weight" in state else 0
  width, text_dim = state["time_embedding.linear_1.weight"].shape
  table = denoiser_names(sizes["layers"], features, "emb_proj.1.weight" in state)
  net = TokenDenoiser(width, sizes["layers"], sizes["heads"], sizes["ff"], text_dim, features, dtype=dtype)
  params = from_torch(state, table, () if features else UNUSED)
  return net, jax.tree.map(lambda a: jnp.asarray(a, dtype), params), table


def run_vae(fixture, dtype, prefix="", noise="in/eps", **fields):
  net, params, _ = vae(fixture, dtype, prefix, **fields)
  x, noise = jnp.asarray(fixture["in/motion"], dtype), jnp.asarray(fixture[noise], dtype).swapaxes(0, 1)
  real = padding_mask(jnp.asarray(fixture["in/lengths"]), x.shape[1])

  @jax.jit
  def run(x):
    mean, logvar = net.apply(params, x, real, method="encode")
    std = jnp.sqrt(jnp.exp(logvar))
    decode = lambda z: net.apply(params, z, real, method="decode")
    tokens = {"mu": mean, "std": std, "z": mean + std * noise}
    return {name: value.swapaxes(0, 1) for name, value in tokens.items()} | {
        "decoded": decode(tokens["z"]), "decoded_mean": decode(mean)}

  return run(x)


@golden("mld_vae", bounds={"": (1e-5, 1e-10)})
def run_mld_vae(fixture, dtype):
  return run_vae(fixture, dtype)


@golden("mld_vae_variants", bounds={"": (1e-5, 1e-10)})
def run_mld_vae_variants(fixture, dtype):
  made = {}
  for name in ("tokens", "linear"):
    decoder = "encoder" if fixture.meta["arguments"][name]["arch"] == "all_encoder" else "memory"
    out = run_vae(fixture, dtype, f"{name}/", f"in/{name}/eps", decoder=decoder)
    made |= {f"{name}/{key}": value for key, value in out.items()}
  return made


# The reference rounds angles of up to 999 in float32: off by up to 6e-5.
@golden("mld_denoiser", bounds={"time_features": (6e-5, 1e-10), "": (3e-5, 1e-10)})
def run_mld_denoiser(fixture, dtype):
  net, params, _ = denoiser(fixture, dtype)
  given = {name: jnp.asarray(a, dtype if a.dtype.kind == "f" else None) for name, a in fixture.under("in/").items()}
  run = jax.jit(lambda z, t, text: net.apply(params, z, t, text))
  one_t = jnp.broadcast_to(given["t"][1], given["t"].shape)
  return {"time_features": net.apply(params, given["t"], method="time_features"),
          "time_embedding": net.apply(params, given["t"], method="time"),
          "predicted": run(given["latents"], given["t"], given["text"]),
          "predicted3": run(given["latents3"], given["t"], given["text4"]),
          "predicted_one_t": run(given["latents"], one_t, given["text"])}


NAMES = ("mld_vae", "mld_vae_variants", "mld_denoiser")


@pytest.mark.slow
@recordings(*NAMES)
def test_golden(name, precision):
  assert not check(fixtures.path(f"mld/{name}.npz"), [precision]).failures


def test_errors_name_what_came():
  with pytest.raises(ValueError, match="got 4 layers with skip connections, expected an odd number"):
    SkipTransformer(4, 2, 8).init(jax.random.key(0), jnp.zeros((1, 2, 8)))
  net = TokenVAE(6, 8, 1, 1, 2, 8, max_length=4)
  with pytest.raises(ValueError, match="got a sequence of 7, this network has positions for 4"):
    net.init(jax.random.key(0), jnp.zeros((1, 5, 6)), jnp.zeros((1, 1, 8)), jnp.ones((1, 5), bool))
