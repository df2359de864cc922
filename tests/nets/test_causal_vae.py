"""The causal VAE is the reference's, sees no future, and streams exactly."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import cmdm
from motion_jax.convert import causal_vae_names, from_torch
from motion_jax.nets.causal_vae import CausalVAE, sample_latent
from tests.fixtures import load
from tests.golden import params_of


def _network(name, dtype):
  fixture = load(f"cmdm/{name}.npz")
  sizes = {"mac_vae": (263, 16, 32, 24), "mac_vae_long": (12, 4, 16, 6), "mac_vae_loss": (23, 6, 12, 10)}[name]
  vae = CausalVAE(*sizes[:3], teacher_dim=sizes[3], dtype=dtype)
  params = from_torch(params_of(fixture), causal_vae_names(teacher=True))
  return fixture, vae, jax.tree.map(lambda a: jnp.asarray(a, dtype), params)


@pytest.mark.parametrize("name", ["mac_vae", "mac_vae_long"])
@pytest.mark.parametrize("wide", [False, True], ids=["float32", "float64"])
def test_golden(name, wide):
  with jax.enable_x64(wide):
    dtype, key, bound = (jnp.float64, "out64", 1e-10) if wide else (jnp.float32, "out", 5e-6)
    fixture, vae, params = _network(name, dtype)
    whole, short = (fixture[f"{key}/{part}/x_rec"].shape[1] for part in ("whole", "short"))
    for part, frames in (("whole", fixture["in/x"].shape[1]), ("short", fixture["in/x"].shape[1])):
      frames = frames if part == "whole" else {"mac_vae": 50, "mac_vae_long": 203}[name]
      x, noise = jnp.asarray(fixture["in/x"][:, :frames], dtype), jnp.asarray(fixture["in/eps"][:, :frames // 4], dtype)
      made = dict(zip(("x_rec", "mu", "logvar"), vae.apply(params, x, noise)))
      made["projection"] = vae.apply(params, sample_latent(made["mu"], made["logvar"], noise), method="project")
      for output, value in made.items():
        expected = fixture[f"{key}/{part}/{output}"]
        assert np.abs(value - expected).max() / max(1, np.abs(expected).max()) < bound, (part, output)
    assert whole == fixture["in/x"].shape[1] and short < whole


def test_loss_terms_are_the_references():
  with jax.enable_x64(True):
    fixture, vae, params = _network("mac_vae_loss", jnp.float64)
    x, noise = jnp.asarray(fixture["in/x"], jnp.float64), jnp.asarray(fixture["in/eps"], jnp.float64)
    terms = cmdm.tokenizer_terms(vae, params, x, noise, float(fixture["in/kl_weight"]), 0.05)
    for ours, theirs in (("rec", "loss_rec"), ("root", "loss_root"), ("kl", "loss_kl"), ("loss", "loss_total")):
      assert np.allclose(terms[ours], fixture[f"out64/none/{theirs}"], rtol=1e-6), ours
    target = jnp.asarray(fixture["in/direct/x"], jnp.float64)
    for i, scale in enumerate(fixture["in/direct/scale"].astype(np.float64)):
      made = target + scale * jnp.asarray(fixture["in/direct/noise"], jnp.float64)
      assert np.allclose(cmdm.gaussian_nll(made, target), fixture["out64/direct/rec"][i], rtol=1e-10)
      assert np.allclose(cmdm.gaussian_nll(made[..., :4], target[..., :4]), fixture["out64/direct/root"][i], rtol=1e-10)
    logvar = jnp.clip(jnp.asarray(fixture["in/direct/logvar"], jnp.float64), -30, 20)
    kl = cmdm.kl_to_standard_normal(jnp.asarray(fixture["in/direct/mu"], jnp.float64), logvar)
    assert np.allclose(kl, fixture["out64/direct/kl"], rtol=1e-10)


def _small():
  vae = CausalVAE(features=7, latent_dim=3, width=8)
  x = jax.random.normal(jax.random.key(0), (2, 200, 7))
  return vae, vae.init(jax.random.key(1), x, jnp.zeros((2, 50, 3))), x


def test_no_latent_sees_a_later_frame_and_no_frame_a_later_latent():
  vae, params, x = _small()
  encode = jax.jit(lambda x: vae.apply(params, x, method="encode")[0])
  decode = jax.jit(lambda z: vae.apply(params, z, method="decode"))
  z = encode(x)
  for frame in (0, 3, 4, 101, 199):
    changed = np.abs(encode(x.at[:, frame].add(10.0)) - z).max((0, 2))
    assert np.flatnonzero(changed)[0] == frame // 4
  y = decode(z)
  for latent in (0, 1, 30, 49):
    changed = np.abs(decode(z.at[:, latent].add(10.0)) - y).max((0, 2))
    assert np.flatnonzero(changed)[0] == 4 * latent


def test_receptive_fields():
  """176 frames for the encoder, 45 latents for the decoder (facts: cmdm 2.1)."""
  vae, params, _ = _small()
  x = jnp.zeros((1, 240, 7))
  encode = lambda x: vae.apply(params, x, method="encode")[0][0, -1].sum()
  reached = np.flatnonzero(np.abs(jax.grad(encode)(x)[0]).max(-1))
  assert reached[0] >= 240 - 176
  z = jax.random.normal(jax.random.key(2), (1, 60, 3))
  reached = np.flatnonzero(np.abs(jax.grad(lambda z: vae.apply(params, z, method="decode")[0, -4].sum())(z)[0]).max(-1))
  assert reached[0] >= 60 - 45


@pytest.mark.parametrize("chunks", [(1,) * 20, (3,) * 7, (7, 1, 12), (20,)])
def test_streaming_is_offline(chunks):
  vae, params, x = _small()
  z = vae.apply(params, x[:, :80], method="encode")[0]
  y = vae.apply(params, z, method="decode")
  for source, whole, init, step, unit in ((x, z, "init_encode_state", "encode_step", 4),
                                          (z, y, "init_decode_state", "decode_step", 1)):
    state, parts, at = vae.apply(params, 2, method=init), [], 0
    for chunk in chunks:
      part, state = vae.apply(params, source[:, at * unit:(at + chunk) * unit], state, method=step)
      parts.append(part[0] if step == "encode_step" else part)
      at += chunk
    made = np.concatenate(parts, axis=1)
    assert np.abs(made[:, :whole.shape[1]] - whole[:, :made.shape[1]]).max() < 1e-5


def test_parameter_counts():
  count = lambda **sizes: sum(a.size for a in jax.tree.leaves(jax.eval_shape(
      lambda: CausalVAE(teacher_dim=256, **sizes).init(
          jax.random.key(0), jnp.zeros((1, 64, sizes.get("features", 263))), jnp.zeros((1, 16, 64))))))
  assert count() == 76_312_199 and count(features=67) == 75_107_779


def test_too_few_frames_are_told():
  vae, params, x = _small()
  with pytest.raises(ValueError, match="one latent needs 4"):
    vae.apply(params, x[:, :3], method="encode")
