"""Networks, inputs and gradients of the recordings of MoMask and T2M-GPT, and what is compared with them."""
import jax.numpy as jnp
import numpy as np

from motion_jax.convert.state import from_torch
from motion_jax.latents import RvqCodec
from motion_jax.models import autoencoders
from motion_jax.models.autoencoder_weights import autoencoder_names, rvq_from_torch
from motion_jax.models.momask.weight_names import masked_names, residual_names
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
from tests.nets.naming import by_reference
from tests.nets.test_masked_transformer import cast

EXACT = (0, 0)
CODES = {name: EXACT for name in ("ids", "masked", "input", "drawn", "res_codes", "tokens")}


def codec_of(sizes, state, dtype):
  """-> (RvqCodec, number of levels) of a recorded RVQ-VAE."""
  net = Autoencoder(features=sizes["input_width"], latent_dim=sizes["output_emb_width"], width=sizes["width"],
                    num_halvings=sizes["down_t"],
                    dilations=tuple(sizes["dilation_growth_rate"] ** b for b in reversed(range(sizes["depth"]))),
                    dropout=0.0, dtype=dtype)
  levels = sizes["args"]["num_quantizers"]
  return RvqCodec(net, cast(rvq_from_torch(state, levels, net.num_halvings, len(net.dilations)), dtype)), levels


def transformer_of(kind, sizes, state, dtype, **fields):
  """-> (net, params, table of names) of a recorded transformer of MoMask."""
  fields |= dict(num_codes=sizes["opt"]["num_tokens"], code_dim=sizes["code_dim"], width=sizes["latent_dim"],
                 depth=sizes["num_layers"], num_heads=sizes["num_heads"], ff_width=sizes["ff_size"],
                 text_dim=sizes["clip_dim"], dropout=0.0, dtype=dtype)
  if kind == "masked":
    net, table = MaskedCodeTransformer(**fields), masked_names(sizes["num_layers"])
  else:
    shared = "token_embed_weight_" in state
    net = ResidualCodeTransformer(num_levels=sizes["opt"]["num_quantizers"], shared_tables=shared, **fields)
    table = residual_names(sizes["num_layers"], shared)
  return net, cast(from_torch(state, table), dtype), table


def given(fixture, dtype, prefix="in/"):
  """Inputs: integers as they are, numbers in the precision of the run."""
  return {name: jnp.asarray(array, None if array.dtype.kind in "iub" else dtype)
          for name, array in fixture.under(prefix).items()}


def recorded(fixture, dtype, name):
  wide = fixture.arrays.get(f"out64/{name}") if dtype == jnp.float64 else None
  return fixture[f"out/{name}"] if wide is None else wide


def compared_grads(fixture, grads, table, prefix=""):
  """Gradients to be compared, by their names in the file; one that is rounding on both sides counts as the recorded."""
  made, found = by_reference(grads["params"], table), {}
  for name, expected in fixture.under(f"out/{prefix}grad/").items():
    array = np.asarray(made[name])
    if np.abs(expected).max() < 1e-7:  # biases of keys do nothing
      assert np.abs(array).max() < 1e-6, name
      array = expected
    found[f"{prefix}grad/{name}"] = array
  return found


GRADIENTS = {f"{case}grad/": (2e-5, 1e-5) for case in ("", "all/", "drop/", "shared/", "plain/", "fixed/", "drawn/")}


def loss_terms(y, x, commitment):
  """(total, all columns, positions, commitment) as MoMask and T2M-GPT weigh them."""
  columns = (4, 64 if x.shape[-1] == 251 else 67)
  terms = autoencoders.rvq_terms(y, x[:, :y.shape[1]], commitment, velocity_weight=0.0, commitment_weight=0.02,
                                 position_weight=0.5, columns=columns)
  return jnp.stack([terms[name] for name in ("loss", "rec", "positions", "commitment")])


def autoencoder_table(net):
  return autoencoder_names(net.num_halvings, len(net.dilations))


def real_rows(fixture, dtype, name, array, real, axis):
  """Ours at real places; what lies at padding means nothing. axis: that of places, of ours and of the recorded."""
  shape = [1] * array.ndim
  shape[-real.ndim if axis == -1 and array.ndim == real.ndim else axis] = real.shape[-1]
  batch = array.ndim - 3 if array.ndim > real.ndim else array.ndim - 2
  shape[batch] = real.shape[0]
  return np.where(np.reshape(real, shape), np.asarray(array), recorded(fixture, dtype, name))


def gumbel_of(u):
  """Gumbel noise of uniform numbers, as the reference makes it."""
  log = lambda x: jnp.log(jnp.maximum(x, 1e-20))
  return -log(-log(u))
