"""The causal VAE is the reference's, sees no future, and streams exactly."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.models import cmdm
from motion_jax.models.cmdm.weight_names import causal_vae_names
from motion_jax.nets.causal_vae import CausalVAE, _mean_logvar, sample_latent
from motion_jax.training.setup import untrained
from tests import fixtures
from tests.golden import check, golden, recordings
from tests.nets.naming import by_reference


def network(fixture, dtype, prefix=""):
  """Our module and parameters for a recorded small network; prefix: where several share a file."""
  sizes = fixture.config["vae"]
  # Parity: a stack's dilations fall in the encoder as well as in the decoder.
  dilations = tuple(sizes["dilation_growth_rate"] ** i for i in reversed(range(sizes["depth"])))
  back = not sizes["reverse_proj"]
  vae = CausalVAE(sizes["input_width"], sizes["output_emb_width"], sizes["width"], dilations=dilations,
                  teacher_dim=sizes["aux_feature_dim"], teacher_to_latent=back, dtype=dtype)
  state = {name[len(prefix):]: array for name, array in fixture.params.items() if name.startswith(prefix)}
  params = from_torch(state, causal_vae_names(depth=sizes["depth"], teacher_to_latent=back))
  return vae, jax.tree.map(lambda a: jnp.asarray(a, dtype), params)


@golden("mac_vae")
@golden("mac_vae_long")
def run_mac_vae(fixture, dtype):
  vae, params = network(fixture, dtype)
  x, noise = (jnp.asarray(fixture[f"in/{name}"], dtype) for name in ("x", "eps"))

  @jax.jit
  def run(x):
    y, mean, logvar = vae.apply(params, x, noise[:, :x.shape[1] // vae.frames_per_latent])
    z = sample_latent(mean, logvar, noise[:, :mean.shape[1]])
    return {"mu": mean, "z": z, "logvar": logvar, "x_rec": y, "projection": vae.apply(params, z, method="project")}

  lengths = {"whole": x.shape[1], "short": fixture.config["short"]}
  lengths |= {f"prefix/{frames}": frames for frames in fixture.config["prefixes"]}
  return {f"{part}/{name}": value for part, frames in lengths.items() for name, value in run(x[:, :frames]).items()}


@golden("mac_vae_loss")
@golden("mac_vae_loss_reversed")
def run_mac_vae_loss(fixture, dtype):
  vae, params = network(fixture, dtype)
  sizes = fixture.config["vae"]
  x, noise = (jnp.asarray(fixture[f"in/{name}"], dtype) for name in ("x", "eps"))
  kl_weight = jnp.asarray(fixture["in/kl_weight"], dtype)

  def run(name, teacher, adaptive):
    guide = None
    if teacher is not None:
      frames = jnp.swapaxes(jnp.asarray(fixture[f"in/{teacher}"], dtype), 0, 1)
      guide = cmdm.pool_teacher(frames, noise.shape[1])

    def loss(params):
      terms = cmdm.tokenizer_terms(vae, params, x, noise, kl_weight, sizes["root_loss_weight"],
                                   root_columns=slice(0, 4), teacher=guide,
                                   align_weight=sizes["vf_weight"], adaptive=adaptive)
      return terms["loss"], terms

    (_, terms), grads = jax.jit(jax.value_and_grad(loss, has_aux=True))(params)
    made = {"loss_total": terms["loss"], **{f"loss_{part}": terms[part] for part in ("rec", "kl", "root")}}
    made["loss_align_weighted"] = jnp.zeros((), dtype)
    if guide is not None:
      made |= {"loss_mcos": terms["mcos"], "loss_mdms": terms["mdms"], "loss_align": terms["align"],
               "loss_align_weighted": terms["align_weight"] * terms["align"]}
      if adaptive:
        made |= {"grad_norm_rec": terms["grad_rec"], "grad_norm_align": terms["grad_align"],
                 "align_weight": terms["align_weight"]}
    if name == "main":
      table = causal_vae_names(depth=sizes["depth"], teacher_to_latent=vae.teacher_to_latent)
      made |= {f"grad/{theirs}": array for theirs, array in by_reference(grads["params"], table).items()}
    return {f"{name}/{output}": value for output, value in made.items()}

  made = run("main", "teacher", True) | run("none", None, True) | run("fixed", "teacher", False)
  if "in/aligned_teacher" in fixture.arrays:
    made |= run("aligned", "aligned_teacher", True)
  target, noise, mean, logvar = (jnp.asarray(fixture[f"in/direct/{name}"], dtype)
                                 for name in ("x", "noise", "mu", "logvar"))
  outputs = [target + scale * noise for scale in jnp.asarray(fixture["in/direct/scale"], dtype)]
  made["direct/rec"] = jnp.stack([cmdm.gaussian_nll(y, target) for y in outputs])
  made["direct/root"] = jnp.stack([cmdm.gaussian_nll(y[..., :4], target[..., :4]) for y in outputs])
  made["direct/kl"] = cmdm.kl_to_standard_normal(mean, jnp.clip(logvar, -30, 20))
  return made


@pytest.mark.slow
@recordings("mac_vae", "mac_vae_loss")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


@pytest.mark.exhaustive
@recordings("mac_vae_long", "mac_vae_loss_reversed")
def test_golden_of_a_long_motion_and_the_other_projection(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


VAE = CausalVAE(features=7, latent_dim=3, width=8)
apply = jax.jit(VAE.apply, static_argnames="method")  # op by op a stack of convolutions takes a minute


@functools.cache
def _small(frames=200):
  """-> (parameters, features (2, frames, 7))."""
  x = np.random.default_rng(0).normal(size=(2, frames, 7)).astype(np.float32)
  return untrained(jax.eval_shape(VAE.init, jax.random.key(1), x, jnp.zeros((2, frames // 4, 3)))), x


def _moved(x, at):
  """x with another row."""
  return x + 10 * (np.arange(x.shape[1]) == at)[:, None].astype(np.float32)


def test_no_latent_sees_a_later_frame_and_no_frame_a_later_latent():
  """They see 176 frames and 45 latents back (docs/papers/cmdm.md#tokenizer)."""
  params, x = _small(240)
  encode = lambda x: np.asarray(apply(params, x, method="encode")[0])
  z = encode(x)
  for frame in (0, 3, 4, 63, 64, 239):
    changed = np.flatnonzero(np.abs(encode(_moved(x, frame)) - z).max((0, 2)))
    assert changed[0] == frame // 4 and (changed[-1] == 59) == (frame >= 240 - 176)
  decode = lambda z: np.asarray(apply(params, z, method="decode"))
  y = decode(z)
  for latent in (0, 1, 14, 15, 59):
    changed = np.flatnonzero(np.abs(decode(_moved(z, latent)) - y).max((0, 2)))
    assert changed[0] == 4 * latent and (changed[-1] >= 240 - 4) == (latent >= 60 - 45)


@pytest.mark.slow
def test_streaming_is_offline():
  """Chunks of any size, one latent among them."""
  params, x = _small(240)
  z = apply(params, x, method="encode")[0]
  y = apply(params, z, method="decode")
  for source, whole, init, step, unit in ((x, z, "init_encode_state", "encode_step", 4),
                                          (z, y, "init_decode_state", "decode_step", 1)):
    state, parts, at = VAE.apply(params, 2, method=init), [], 0
    for chunk in (7, 1, 52):
      part, state = apply(params, source[:, at * unit:(at + chunk) * unit], state, method=step)
      parts.append(part[0] if step == "encode_step" else part)
      at += chunk
    made = np.concatenate(parts, axis=1)
    assert made.shape == whole.shape and np.abs(made - whole).max() < 1e-5


def test_a_log_variance_stays_in_its_bounds():
  """Wide enough to do nothing to a sound network; a wild one is kept from infinities.

  Source: docs/papers/cmdm.md#tokenizer.
  """
  mean, logvar = _mean_logvar(jnp.array([[1.0, -500, 80, -80], [2.0, 3, 4, -5]]))
  assert mean.tolist() == [[1, -500], [2, 3]] and logvar.tolist() == [[20, -30], [4, -5]]


def test_too_few_frames_are_refused():
  with pytest.raises(ValueError, match="one latent needs 4"):
    jax.eval_shape(lambda: VAE.init(jax.random.key(0), jnp.zeros((1, 3, 7)), jnp.zeros((1, 0, 3))))
