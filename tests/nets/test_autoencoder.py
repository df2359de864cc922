"""The autoencoder is the reference's, and padding may be hidden from it."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.models import cdamd
from motion_jax.models.shared.autoencoder_weights import autoencoder_names
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.training.setup import untrained
from tests import fixtures
from tests.golden import check, golden, recordings


def module(sizes, dtype, dropout=0.0):
  """Our module for a recorded network's arguments."""
  depth, growth = sizes.get("depth", 3), sizes.get("dilation_growth_rate", 3)
  return Autoencoder(sizes["input_width"], sizes["output_emb_width"], sizes["width"], sizes.get("down_t", 2),
                     tuple(growth ** b for b in reversed(range(depth))), dropout, dtype)


@golden("ae63", bounds={"": (1e-5, 1e-10)})
@golden("ae66", bounds={"": (1e-5, 1e-10)})
def run_autoencoder(fixture, dtype):
  net = module(fixture.meta["arguments"], dtype)
  params = from_torch(fixture.params, autoencoder_names(net.num_halvings, len(net.dilations)))
  params = jax.tree.map(lambda a: jnp.asarray(a, dtype), params)

  @jax.jit
  def run(x):
    z = net.apply(params, x, method="encode")
    y = net.apply(params, z, method="decode")
    terms = cdamd.autoencoder_terms(y, x[:, :y.shape[1]])
    return z.swapaxes(1, 2), y, jnp.stack([terms["loss"], terms["rec"], terms["positions"]])

  made = {}
  for name, x in fixture.under("in/motion").items():
    made[f"latent{name}"], made[f"decoded{name}"], made[f"loss{name}"] = run(jnp.asarray(x, dtype))
  return made


@pytest.mark.slow
@recordings("ae63", "ae66")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cdamd/{name}.npz"), [precision]).failures


@pytest.fixture(scope="module")
def small():
  net = Autoencoder(features=7, latent_dim=3, width=8)
  return net, untrained(jax.eval_shape(net.init, jax.random.key(0), jnp.zeros((1, 16, 7))))


def test_too_few_frames_are_refused(small):
  net, params = small
  with pytest.raises(ValueError, match="one latent needs 4"):
    net.apply(params, jnp.zeros((1, 3, 7)), method="encode")


@pytest.mark.slow
def test_hidden_padding_is_no_padding(small):
  """A clip is encoded and decoded as at its own length, whatever lies behind it; not so where padding is not hidden."""
  net, params = small
  x = jax.random.normal(jax.random.key(1), (3, 40, 7))
  hiding = net.clone(hide_padding=True)
  frames = jnp.array([16, 27, 40])
  real = jnp.arange(40) < frames[:, None]
  latents = jnp.arange(10) < frames[:, None] // 4

  @jax.jit
  def run(x):
    z = hiding.apply(params, x, real_mask=real, method="encode")
    return z, hiding.apply(params, z.at[:1, 4:].set(9.0), real_mask=latents, method="decode")

  z, y = run(x)
  for i, count in enumerate(frames.tolist()):
    whole = count // 4
    alone = jax.jit(lambda x: net.apply(params, x, method="encode"))(x[i:i + 1, :count])
    np.testing.assert_allclose(z[i, :whole], alone[0], atol=1e-5)
    assert not np.any(z[i, whole:]) and not np.any(y[i, 4 * whole:])
    decoded = jax.jit(lambda z: net.apply(params, z, method="decode"))(alone)
    np.testing.assert_allclose(y[i, :4 * whole], decoded[0], atol=1e-5)
  np.testing.assert_array_equal(run(jnp.where(real[..., None], x, 7.0))[0], z)
  shown = jax.jit(lambda x: net.apply(params, x, real_mask=real, method="encode"))(x)
  assert np.abs(shown - z)[0, :4].max() > 1e-3 and np.allclose(shown[2], z[2], atol=1e-5)
