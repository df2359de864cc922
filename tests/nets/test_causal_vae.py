"""The causal VAE is the reference's, sees no future, and streams exactly."""
import flax
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


def _jitted(vae):
  """apply(params, *arrays, method=name), compiled: op by op a stack of convolutions takes a minute."""
  return jax.jit(vae.apply, static_argnames="method")


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
    y, mean, logvar = vae.apply(params, x, noise[:, :x.shape[1] // 4])
    z = sample_latent(mean, logvar, noise[:, :x.shape[1] // 4])
    return {"mu": mean, "z": z, "logvar": logvar, "x_rec": y, "projection": vae.apply(params, z, method="project")}

  lengths = {"whole": x.shape[1], "short": fixture.config["short"]}
  lengths |= {f"prefix/{frames}": frames for frames in fixture.config["prefixes"]}
  return {f"{part}/{name}": value for part, frames in lengths.items() for name, value in run(x[:, :frames]).items()}


def _gradients(grads, vae, depth):
  """Gradients under the reference's names: the conversion, run on indices, tells where each number went."""
  table = causal_vae_names(depth=depth, teacher_to_latent=vae.teacher_to_latent)
  flat, made = flax.traverse_util.flatten_dict(grads, sep="/"), {}
  turn = {"conv": lambda w: w.transpose(2, 1, 0), "pointwise": lambda w: w.T[..., None], "dense": lambda w: w.T}
  for theirs, (ours, kind) in table.items():
    made[f"{theirs}.weight"] = turn[kind](flat[f"params/{ours}/kernel"])
    made[f"{theirs}.bias"] = flat[f"params/{ours}/bias"]
  return made


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
      made |= {f"grad/{theirs}": array for theirs, array in _gradients(grads, vae, sizes["depth"]).items()}
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


@recordings("mac_vae", "mac_vae_long", "mac_vae_loss", "mac_vae_loss_reversed")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


def _small():
  vae = CausalVAE(features=7, latent_dim=3, width=8)
  x = jnp.asarray(np.random.default_rng(0).normal(size=(2, 200, 7)), jnp.float32)
  return vae, untrained(jax.eval_shape(vae.init, jax.random.key(1), x, jnp.zeros((2, 50, 3)))), x


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
  """176 frames for the encoder, 45 latents for the decoder (docs/papers/cmdm.md#tokenizer)."""
  vae, params, _ = _small()
  draw = np.random.default_rng(2).normal
  x = jnp.asarray(draw(size=(1, 240, 7)), jnp.float32)
  encode = lambda x: vae.apply(params, x, method="encode")[0][0, -1].sum()
  reached = np.flatnonzero(np.abs(jax.jit(jax.grad(encode))(x)[0]).max(-1))
  assert reached[0] == 240 - 176
  z = jnp.asarray(draw(size=(1, 60, 3)), jnp.float32)
  decode = lambda z: vae.apply(params, z, method="decode")[0, -4].sum()
  reached = np.flatnonzero(np.abs(jax.jit(jax.grad(decode))(z)[0]).max(-1))
  assert reached[0] == 60 - 45


@pytest.mark.parametrize("chunks", [
    (7, 1, 12), *(pytest.param(sizes, marks=pytest.mark.slow) for sizes in ((1,) * 20, (3,) * 6 + (2,)))])
def test_streaming_is_offline(chunks):
  vae, params, x = _small()
  apply = _jitted(vae)
  z = apply(params, x[:, :80], method="encode")[0]
  y = apply(params, z, method="decode")
  for source, whole, init, step, unit in ((x, z, "init_encode_state", "encode_step", 4),
                                          (z, y, "init_decode_state", "decode_step", 1)):
    state, parts, at = vae.apply(params, 2, method=init), [], 0
    for chunk in chunks:
      part, state = apply(params, source[:, at * unit:(at + chunk) * unit], state, method=step)
      parts.append(part[0] if step == "encode_step" else part)
      at += chunk
    made = np.concatenate(parts, axis=1)
    assert np.abs(made[:, :whole.shape[1]] - whole[:, :made.shape[1]]).max() < 1e-5


def test_parameter_counts():
  count = lambda **sizes: sum(a.size for a in jax.tree.leaves(jax.eval_shape(
      lambda: CausalVAE(teacher_dim=256, **sizes).init(
          jax.random.key(0), jnp.zeros((1, 64, sizes.get("features", 263))), jnp.zeros((1, 16, 64))))))
  assert count() == 76_312_199 and count(features=67) == 75_107_779


def test_a_log_variance_stays_in_its_bounds():
  """Wide enough to do nothing to a sound network; a wild one is kept from infinities.

  Source: docs/papers/cmdm.md#tokenizer.
  """
  mean, logvar = _mean_logvar(jnp.array([[1.0, -500, 80, -80], [2.0, 3, 4, -5]]))
  assert mean.tolist() == [[1, -500], [2, 3]] and logvar.tolist() == [[20, -30], [4, -5]]


def test_too_few_frames_are_told():
  vae, params, x = _small()
  with pytest.raises(ValueError, match="one latent needs 4"):
    vae.apply(params, x[:, :3], method="encode")
