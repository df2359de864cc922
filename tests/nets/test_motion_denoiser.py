"""MDM's network is the reference's in all its kinds, and its GRU runs over time, unlike the reference's."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.diffusion import guidance
from motion_jax.models.mdm.weight_names import mdm_names
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.motion_denoiser import MotionDenoiser
from motion_jax.nets.post_norm import sinusoid_table
from tests import fixtures
from tests.golden import Fixture, check, golden, recordings


def network(fixture, dtype, kind="encoder", **fields):
  """-> (net, params, table of names) of a recorded network; all sizes are those of its tensors."""
  sizes, state = fixture.meta["arguments"], fixture.params
  prefix = "gru/" if kind == "gru" else ""
  state = {name.removeprefix(prefix): array for name, array in state.items() if name.startswith("gru/") == bool(prefix)}
  goals = "embed_target_cond.mlp.0.weight" in state
  if "embed_action.action_embedding" in state:  # a one-hot vector of the action is the text of an action model
    state["embed_text.weight"] = state.pop("embed_action.action_embedding").T
    state["embed_text.bias"] = np.zeros(len(state["embed_text.weight"]), np.float32)
  width, text_dim = state["embed_text.weight"].shape
  table = mdm_names(sizes["num_layers"], kind, goals)
  net = MotionDenoiser(state["output_process.poseFinal.weight"].shape[0], width, sizes["num_layers"],
                       sizes["num_heads"], sizes["ff_size"], text_dim, kind, num_goals=8 if goals else 0, dtype=dtype,
                       **fields)
  params = from_torch(state, table)
  return net, jax.tree.map(lambda a: jnp.asarray(a, dtype), params), table


def motion(array, dtype):
  """(..., J, F, T) as the reference has it -> (..., T, J * F)."""
  return jnp.moveaxis(jnp.asarray(array, dtype), -1, -3).reshape(*array.shape[:-3], array.shape[-1], -1)


def theirs(x, num_joints=None):
  """(..., T, F) -> (..., J, F / J, T)."""
  joints = num_joints or x.shape[-1]
  return jnp.moveaxis(x.reshape(*x.shape[:-1], joints, -1), -3, -1)


def words(fixture, dtype):
  """(text_emb (B, S, E), text_mask (B, S) or None)."""
  if "in/words" in fixture.arrays:
    return (jnp.asarray(fixture["in/words"], dtype).swapaxes(0, 1), ~jnp.asarray(fixture["in/word_padding"]))
  return jnp.asarray(fixture["in/text"], dtype).swapaxes(0, 1), None


ENCODER = {"guided": (1e-4, 1e-10), "": (2e-5, 1e-10)}


@golden("mdm_encoder", bounds={"pe": (6e-5, 1e-10), **ENCODER})
def run_mdm_encoder(fixture, dtype):
  net, params, _ = network(fixture, dtype)
  x, t, (text, _) = motion(fixture["in/x"], dtype), jnp.asarray(fixture["in/t"]), words(fixture, dtype)
  real = padding_mask(jnp.asarray(fixture["in/lengths"]), x.shape[1])
  run = jax.jit(lambda text, mask: net.apply(params, x, t, text, frame_mask=mask))
  plain, without = run(text, None), run(0 * text, None)
  dropped = jnp.asarray(fixture["in/drop_u"])[:, None, None] < 0.1
  table = sinusoid_table(1000, net.width)
  made = {"plain": plain, "uncond": without, "masked": run(text, real), "dropped": run(
      jnp.where(dropped, 0, text), None),
          "guided": guidance.combine(plain, without, jnp.asarray(fixture["in/scale"], dtype)[:, None, None])}
  return {name: theirs(value) for name, value in made.items()} | {
      "time_embedding": net.apply(params, t, method="time")[None],
      "text_embedding": net.apply(params, text, method="text").swapaxes(0, 1),
      "pe": table[:len(fixture["out/pe"])], "pe_t": table[np.asarray(t)]}


@golden("mdm_decoder_words", bounds={"guided": (1e-4, 1e-10), "": (3e-5, 1e-10)})
def run_mdm_decoder_words(fixture, dtype):
  net, params, _ = network(fixture, dtype, "decoder")
  x, t, (text, text_mask) = motion(fixture["in/x"], dtype), jnp.asarray(fixture["in/t"]), words(fixture, dtype)
  real = padding_mask(jnp.asarray(fixture["in/lengths"]), x.shape[1])
  run = jax.jit(lambda text, mask: net.apply(params, x, t, text, text_mask, mask))
  plain, without = run(text, None), run(0 * text, None)
  made = {"plain": plain, "uncond": without, "masked": run(text, real),
          "guided": guidance.combine(plain, without, jnp.asarray(fixture["in/scale"], dtype)[:, None, None])}
  return {name: theirs(value) for name, value in made.items()}


@golden("mdm_decoder_pooled", bounds={"": (2e-5, 1e-10)})
def run_mdm_decoder_pooled(fixture, dtype):
  x, t, (text, _) = motion(fixture["in/x"], dtype), jnp.asarray(fixture["in/t"]), words(fixture, dtype)
  real = padding_mask(jnp.asarray(fixture["in/lengths"]), x.shape[1])
  made = {}
  for name, token in (("plain", False), ("token", True)):
    net, params, _ = network(fixture, dtype, "decoder", time_token=token)
    run = jax.jit(lambda mask, net=net, params=params: net.apply(params, x, t, text, frame_mask=mask))
    made |= {name: run(None), "token_masked" if token else "masked": run(real)}
  made["gru/plain"] = gru_over_the_batch(*network(fixture, dtype, "gru")[:2], x, t, text)
  return {name: theirs(value) for name, value in made.items()}


def gru_over_the_batch(net, params, x, t, text):
  """What the reference's GRU does: the items of a batch are its steps, and each frame is a sequence of its own."""
  bound = net.bind(params)
  token = (bound.time(t)[:, None] + bound.text(text)[:, :1])
  y = bound.x_in(jnp.concatenate([x, jnp.broadcast_to(token, (*x.shape[:2], net.width))], axis=-1))
  y = (y + jnp.asarray(sinusoid_table(*y.shape[1:]), y.dtype)).swapaxes(0, 1)
  for layer in bound.layers:
    y = layer(y, jnp.zeros((len(y), net.width), y.dtype))
  return bound.out(y.swapaxes(0, 1))


NAMES = ("mdm_encoder", "mdm_decoder_words", "mdm_decoder_pooled")


@pytest.mark.slow
@recordings(*NAMES)
def test_golden(name, precision):
  assert not check(fixtures.path(f"mdm/{name}.npz"), [precision]).failures


@pytest.mark.slow
def test_the_gru_runs_over_time():
  """Parity: the reference's runs over the batch, so a motion depends on those before it in the batch."""
  fixture = Fixture(fixtures.path("mdm/mdm_decoder_pooled.npz"))
  net, params, _ = network(fixture, jnp.float32, "gru")
  x, t, (text, _) = motion(fixture["in/x"], jnp.float32), jnp.asarray(fixture["in/t"]), words(fixture, jnp.float32)
  run = jax.jit(lambda x: net.apply(params, x, t, text))
  made = run(x)
  np.testing.assert_allclose(run(x.at[0].add(1.0))[1:], made[1:], atol=1e-6)
  np.testing.assert_array_equal(run(x.at[:, -1].add(1.0))[:, :-1], made[:, :-1])


def test_an_unknown_kind_is_an_error():
  net = MotionDenoiser(6, 8, 1, 2, 16, 4, "conv")
  with pytest.raises(ValueError, match="expected one of encoder, decoder, gru"):
    net.init(jax.random.key(0), jnp.zeros((1, 2, 6)), jnp.zeros(1, int), jnp.zeros((1, 1, 4)))
