"""A codec is its network, weights and scale in one: it goes through jit and files, and what it scales it undoes."""
import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.latents import AutoencoderCodec, VaeCodec
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.nets.masks import padding_mask
from motion_jax.training import checkpoint
from motion_jax.training.setup import untrained

X = np.random.default_rng(0).normal(size=(2, 24, 6)).astype(np.float32)
encode, decode, sample, reconstruct = (jax.jit(lambda codec, *inputs, name=name: getattr(codec, name)(*inputs))
                                       for name in ("encode", "decode", "sample", "reconstruct"))
MEAN, STD = np.array([[0.5, -1.0, 0.0], [2.0, 0.5, 1.0]], np.float32)


@pytest.fixture(scope="module")
def vae():
  net = CausalVAE(features=6, latent_dim=3, width=8, dilations=(1,))
  shapes = jax.eval_shape(lambda: net.init(jax.random.key(0), X[:1], jnp.zeros((1, 6, 3))))
  return VaeCodec(net, untrained(shapes), MEAN, STD)


@pytest.fixture(scope="module")
def autoencoder():
  net = Autoencoder(features=6, latent_dim=3, width=8, dilations=(1,))
  return AutoencoderCodec(net, untrained(jax.eval_shape(lambda: net.init(jax.random.key(0), X))), MEAN, STD)


def test_a_codec_is_one_argument_of_a_compiled_function(vae):
  decode = jax.jit(jax.value_and_grad(lambda codec, z: (codec.decode(z) ** 2).sum()))
  z = np.ones((2, 6, 3), np.float32)
  (value, gradient), (moved, _) = decode(vae, z), decode(vae.replace(mean=MEAN + 1), z)
  assert abs(moved - value) > 1e-3 and decode._cache_size() == 1
  assert gradient.net == vae.net and np.abs(gradient.std).min() > 0  # the scale takes part, the network does not


def test_a_codec_comes_back_from_its_file(vae, tmp_path):
  checkpoint.save_params(tmp_path, vae.parts | {"prior": {"w": np.ones(2)}}, name=checkpoint.FROZEN)
  found = checkpoint.load_params(tmp_path, name=checkpoint.FROZEN)
  assert set(found) == {"tokenizer", "latent_mean", "latent_std", "prior"}
  chex.assert_trees_all_equal(VaeCodec.of(vae.net, found), vae)


def test_scaled_latents_are_those_of_the_encoder_moved_and_stretched(vae):
  plain, keys = vae.unscaled(), jax.random.split(jax.random.key(0), 2)
  means, drawn = encode(vae, X), sample(vae, X, keys)
  for scaled, unscaled in ((means, encode(plain, X)), (drawn, sample(plain, X, keys))):
    np.testing.assert_allclose(scaled * STD + MEAN, unscaled, atol=1e-5)
  assert np.abs(drawn - means).max() > 1e-2
  np.testing.assert_allclose(decode(vae, means), reconstruct(vae, X), atol=1e-4)
  np.testing.assert_allclose(decode(vae, drawn), reconstruct(vae, X, keys), atol=1e-4)


def test_a_stream_of_latents_decodes_as_the_whole(vae):
  z, state, parts = encode(vae, X), vae.init_decode_state(2), []
  step = jax.jit(VaeCodec.decode_step)
  for block in np.split(z, 3, axis=1):
    features, state = step(vae, block, state)
    parts.append(features)
  np.testing.assert_allclose(np.concatenate(parts, axis=1), decode(vae, z), atol=1e-5)


def test_fitted_latents_have_mean_0_and_variance_1(vae, autoencoder):
  """Over the whole latents of each clip: neither padding nor half a latent at the end counts."""
  whole = np.random.default_rng(1).normal(size=(16, 26, 6)).astype(np.float32)
  short = np.arange(16) % 2 == 0
  clips, real = [clip[:10] if cut else clip for clip, cut in zip(whole, short)], np.ones((16, 6), bool)
  real[short, 2:], whole[short, 10:] = False, 0
  whole = whole[:, :24]
  z = np.asarray(encode(autoencoder.fitted(clips, length=24), whole, real))[real]
  np.testing.assert_allclose([z.mean(0), z.std(0)], [[0] * 3, [1] * 3], atol=1e-4)
  fitted = vae.fitted(list(whole), length=24)
  drawn = [sample(fitted, whole, jax.random.split(jax.random.key(i), 16)) for i in range(8)]
  z = np.concatenate(drawn).reshape(-1, 3)
  np.testing.assert_allclose([z.mean(0), z.std(0)], [[0] * 3, [1] * 3], atol=0.15)


def test_padding_has_no_latents(autoencoder):
  real = padding_mask(jnp.array([6, 4]), 6)
  z = encode(autoencoder, X, real)
  assert z.shape == (2, 6, 3) and not z[1, 4:].any() and z[1, :4].all()
  assert autoencoder.real_frames(real).sum(-1).tolist() == [24, 16]
