"""The denoiser is the reference's, sees no later block, and its pieces add up to the whole."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.diffusion import guidance, paths
from motion_jax.models.cmdm.weight_names import causal_dit_names
from motion_jax.nets import causal_dit
from motion_jax.nets.attention import rotary
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.layers import timestep_embedding
from motion_jax.nets.masks import block_causal_mask, padding_mask
from tests import fixtures
from tests.golden import check, golden, recordings
from tests.nets.naming import by_reference


def network(fixture, dtype, block=3):
  """Our module and parameters for a recorded small network."""
  sizes = fixture.config["dit"]
  dit = CausalDiT(latent_dim=sizes["input_dim"], width=sizes["latent_dim"], depth=sizes["num_layers"],
                  num_heads=sizes["num_heads"], ff_width=sizes["ff_size"], text_dim=sizes["clip_dim"], block=block,
                  dtype=dtype)
  params = from_torch(fixture.params, causal_dit_names(dit.depth))
  return dit, jax.tree.map(lambda a: jnp.asarray(a, dtype), params)


def captions(fixture, dtype):
  """The recorded captions, text_emb (B, S, E) and text_mask (B, S); behind the mask lies garbage, on purpose."""
  in_order = lambda item: (len(item[0]), item[0])  # c2 before c10
  stack = lambda prefix: np.stack([array for _, array in sorted(fixture.under(prefix).items(), key=in_order)])
  return jnp.asarray(stack("in/text/"), dtype), jnp.asarray(stack("in/text_mask/"))


def faint(params, factor=2.0 ** -10):
  """Scales the token layer and every query and key layer, so that the norms' epsilons show."""
  def scale(path, array):
    names = [key.key for key in path]
    return array * factor if "x_in" in names or names[-2] in "qk" else array
  return jax.tree_util.tree_map_with_path(scale, params)


@golden("causal_dit")
def run_causal_dit(fixture, dtype):
  text_emb, text_mask = captions(fixture, dtype)
  dit, params = network(fixture, dtype)
  x, t = (jnp.asarray(fixture[f"in/{name}"], dtype) for name in "xt")
  scale = fixture.config["scale"]
  made = {}
  whole, odd = fixture.config["length"], fixture.config["odd"]
  for name, block, length, lengths in (("block3", 3, whole, "lengths"), ("block1", 1, whole, "lengths"),
                                       ("full", 0, whole, "lengths"), ("odd", 3, odd, "odd_lengths")):
    attn_mask = block_causal_mask(length, block) & padding_mask(fixture[f"in/{lengths}"], length)[:, None, None, :]
    run = functools.partial(apply, dit, x=x[:, :length], t=t[:, :length], attn_mask=attn_mask, text_mask=text_mask)
    velocity, null = run(params, text_emb=text_emb), run(params, text_emb=text_emb * 0)
    made |= {f"{name}/velocity": velocity, f"{name}/guided": guidance.combine(velocity, null, scale)}
    if name == "block3":
      made |= {"block3/null": null, "faint/velocity": run(faint(params), text_emb=text_emb)}

  latent_mask = padding_mask(fixture["in/lengths"], whole)
  z1 = jnp.where(latent_mask[..., None], jnp.asarray(fixture["in/latents"], dtype), 0)
  noise, uniform = jnp.asarray(fixture["in/noise"], dtype), jnp.asarray(fixture["in/uniform"], dtype)

  @functools.partial(jax.jit, static_argnums=3)
  def loss(params, text, t, block):
    attn_mask = block_causal_mask(whole, block) & latent_mask[:, None, None, :]
    velocity = lambda x, t: apply(dit, params, x, t, text, attn_mask, text_mask)
    sums, weight = paths.forcing_loss(velocity, z1, latent_mask, t, noise)
    return sums["loss"] / weight

  t3 = jnp.repeat(uniform[:, ::3], 3, axis=1)[:, :whole]
  dropped = jnp.where(jnp.asarray(fixture["in/drop"])[:, None, None] > 0, 0, text_emb)
  made["loss_t"] = t3
  made["loss"], grads = jax.jit(jax.value_and_grad(loss), static_argnums=3)(params, text_emb, t3, 3)
  made |= {"loss_dropped": loss(params, dropped, t3, 3), "loss_block1": loss(params, text_emb, uniform, 1)}
  if dtype == jnp.float32:
    named = by_reference(grads["params"], causal_dit_names(dit.depth))
    made |= {f"grad/{name}": array for name, array in named.items()}
  return made


@golden("dit_tables")
def run_tables(fixture, dtype):
  positions, half = fixture.config["positions"], fixture.config["head_dim"] // 2
  pairs = jnp.tile(jnp.array([1.0, 0.0], dtype), half)  # turning the number 1 shows cosine and sine
  table = rotary(jnp.broadcast_to(pairs, (positions, 1, 2 * half)), jnp.arange(positions))[:, 0]
  t = jnp.asarray(fixture["in/t"], dtype)
  width = fixture.config["width"]
  dit = CausalDiT(latent_dim=4, width=width, depth=0, num_heads=1, ff_width=4, text_dim=4, dtype=dtype)
  state = {name.removeprefix("t_embedder/"): array for name, array in fixture.params.items()}
  params = from_torch(state, {"mlp.0": ("time_in", "dense"), "mlp.2": ("time_out", "dense")})
  return {"rope_cos": table[:, 0::2], "rope_sin": table[:, 1::2],
          "rotated": rotary(jnp.asarray(fixture["in/q"], dtype), jnp.arange(positions)),
          "time_numbers": timestep_embedding(t), "time_embedding": dit.apply(params, t, method="level")}


@pytest.mark.slow
@recordings("causal_dit", "dit_tables")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


# --- invariants of our own ---------------------------------------------------------------------------------------


def assert_close(made, expected, bound=2e-6):
  """Rounding of float32, relative to the largest value: random gates make outputs of size 30."""
  difference = np.abs(np.asarray(made) - np.asarray(expected)).max() / max(1, np.abs(expected).max())
  assert difference < bound, difference


@functools.cache
def small(seed=0, **fields):
  """A small denoiser whose layers are all random: zero gates would pass any test."""
  fields = dict(latent_dim=5, width=24, depth=2, num_heads=2, ff_width=48, text_dim=7, block=3) | fields
  dit = CausalDiT(**fields)
  shapes = jax.eval_shape(lambda: init(dit, jax.random.key(0), *inputs()))
  leaves, tree = jax.tree.flatten(shapes)
  draw = np.random.default_rng(seed)
  return dit, tree.unflatten([jnp.asarray(0.3 * draw.normal(size=a.shape) + (a.ndim == 1), a.dtype) for a in leaves])


def init(dit, rng, x, t, text, text_mask):
  return dit.init(rng, x, t, text, block_causal_mask(x.shape[1], 3), text_mask)


@functools.partial(jax.jit, static_argnums=0, static_argnames="method")
def apply(dit, *args, method="__call__", **named):
  """One compiled call: op by op, a busy machine spends minutes here."""
  return dit.apply(*args, method=method, **named)


def inputs(batch=2, length=9, words=4):
  draw = np.random.default_rng(5)
  return tuple(jnp.asarray(a, jnp.float32) for a in (
      draw.normal(size=(batch, length, 5)), draw.uniform(size=(batch, length)), draw.normal(size=(batch, words, 7)))
               ) + (jnp.ones((batch, words), bool),)


@pytest.mark.slow
def test_no_latent_sees_a_later_block():
  dit, params = small()
  x, t, text, text_mask = inputs()
  run = lambda x, t: apply(dit, params, x, t, text, block_causal_mask(9, 3), text_mask)
  whole = run(x, t)
  for j in range(9):
    for changed in (run(x.at[:, j].add(1.0), t), run(x, t.at[:, j].add(0.1))):
      touched = np.abs(changed - whole).max((0, 2)) > 0
      assert not touched[:j // 3 * 3].any()  # bit for bit
      assert touched[j // 3 * 3:].all()


@pytest.mark.slow
def test_padding_and_batch_mates_are_invisible():
  dit, params = small()
  x, t, text, text_mask = inputs()
  alone = apply(dit, params, x[:1, :7], t[:1, :7], text[:1, :3], block_causal_mask(7, 3), text_mask[:1, :3])
  mask = block_causal_mask(9, 3) & padding_mask(jnp.array([7, 9]), 9)[:, None, None, :]
  run = lambda x, text: apply(dit, params, x, t, text, mask, text_mask.at[0, 3].set(False))
  padded = run(x, text)
  assert_close(padded[:1, :7], alone)
  garbage = run(x.at[0, 7:].set(99.0).at[1].set(-3.0), text.at[0, 3].set(50.0).at[1].set(8.0))
  np.testing.assert_array_equal(garbage[:1, :7], padded[:1, :7])


@pytest.mark.slow
def test_one_time_per_block_is_one_per_latent():
  dit, params = small()
  x, _, text, text_mask = inputs()
  t = np.random.default_rng(3).uniform(size=(2, 3)).astype(np.float32)
  dit = dit.clone(predicts="eps", time_scale=10.0)  # a prediction that is turned into a velocity needs the times again
  run = lambda t: apply(dit, params, x, t, text, block_causal_mask(9, 3), text_mask)
  assert_close(run(t), run(np.repeat(t, 3, axis=1)))
  level = lambda dit, t: apply(dit, params, t, method="level")
  assert_close(level(dit, t), level(small()[0], 10 * t))
  with pytest.raises(ValueError, match="4 times for 9 latents"):
    dit.apply(params, x, np.zeros((2, 4)), text, block_causal_mask(9, 3), text_mask)


@pytest.mark.parametrize("name, wrong", [("t", (9,)), ("t", (3, 9)), ("attn_mask", (2, 9, 9)),
                                         ("attn_mask", (2, 1, 9, 8)), ("text_mask", (2, 5)), ("text_emb", (1, 4, 8))])
def test_arrays_that_do_not_belong_together_are_named(name, wrong, as_users_run):
  dit, params = small()
  x, t, text, text_mask = inputs()
  arrays = {"t": t, "text_emb": text, "attn_mask": block_causal_mask(9, 3), "text_mask": text_mask}
  arrays[name] = np.zeros(wrong, arrays[name].dtype)
  with pytest.raises(ValueError, match=rf"got {name}.* of shape \({', '.join(map(str, wrong))}"):
    dit.apply(params, x, *arrays.values())


@pytest.mark.parametrize("fields", [{}, *(pytest.param(fields, marks=pytest.mark.slow) for fields in (
    {"use_rope": False}, {"use_adaln": False}))])
def test_cached_keys_and_values_change_nothing(fields):
  """Clean blocks run once, later ones against what they left; positions count from the window's start."""
  dit, params = small(**fields)
  x, t, text, text_mask = inputs()
  t = t.at[:, :6].set(1.0)
  whole = apply(dit, params, x, t, text, block_causal_mask(9, 3), text_mask)
  words = apply(dit, params, text, text_mask, method="text_keys_values")
  modulation = apply(dit, params, t, method="modulation")
  window = lambda a, b, mask, past=None: apply(dit, params, x[:, a:b], t[:, a:b], modulation[:, :, a:b], words, mask,
                                               jnp.arange(b - a), past, method="window")
  first, new = window(0, 6, block_causal_mask(6, 3))
  past = apply(dit, params, new, jnp.arange(-6, 0), method="turn_keys")
  second, _ = window(6, 9, jnp.ones((1, 1, 3, 9), bool), past)
  assert_close(jnp.concatenate([first, second], axis=1), whole)
  assert float(jnp.abs(whole).max()) > 0.1
  if fields:  # the ablation is another network
    dit, params = small()
    assert np.abs(apply(dit, params, x, t, text, block_causal_mask(9, 3), text_mask) - whole).max() > 1e-2


@pytest.mark.parametrize("predicts", ["eps", "x1"])
def test_predictions_become_velocities(predicts):
  """A network that gives eps or x1 is the same network, its output turned by x = t x1 + (1 - t) eps."""
  x, t, text, text_mask = inputs()
  t = 0.1 + 0.8 * t
  dit, params = small()
  args = (params, x, t, text, block_causal_mask(9, 3), text_mask)
  plain, velocity = apply(dit, *args), apply(dit.clone(predicts=predicts), *args)
  late = t[..., None]
  assert_close(velocity, (x - plain) / late if predicts == "eps" else (plain - x) / (1 - late))
  for end in (0.0, 1.0):
    ends = apply(dit.clone(predicts=predicts), params, x, jnp.full_like(t, end), *args[3:])
    assert bool(jnp.isfinite(ends).all())


@pytest.mark.parametrize("name, count", [("S", 19_775_552), ("L", 129_091_648), ("XL", 304_599_104)])
def test_parameter_counts(name, count):
  """Measured on the reference, feed-forward 2 D (docs/papers/cmdm.md#causal-dit); test_pinned.py has M."""
  dit = CausalDiT(**causal_dit.size(name))
  shapes = jax.eval_shape(lambda: dit.init(jax.random.key(0), jnp.zeros((1, 3, 64)), jnp.zeros((1, 3)),
                                           jnp.zeros((1, 2, 768)), block_causal_mask(3, 3), jnp.ones((1, 2), bool)))
  assert sum(a.size for a in jax.tree.leaves(shapes)) == count


@pytest.mark.slow
def test_initialisation():
  """Xavier uniform, zero bias, time network normal 0.02, modulation and output zero: the first velocity is 0.

  Source: docs/papers/cmdm.md#causal-dit.
  """
  dit = CausalDiT(latent_dim=5, width=128, depth=1, num_heads=2, ff_width=256, text_dim=7)
  x, t, text, text_mask = inputs()
  params = jax.jit(init, static_argnums=0)(dit, jax.random.key(0), x, t, text, text_mask)["params"]
  kernel = params["block0"]["ff_in"]["kernel"]
  assert float(jnp.abs(kernel).max()) <= np.sqrt(6 / 384) and abs(float(kernel.std() / np.sqrt(2 / 384)) - 1) < 0.05
  assert abs(float(params["time_out"]["kernel"].std()) - 0.02) < 1e-3
  assert not params["block0"]["film"]["kernel"].any() and not params["out"]["kernel"].any()
  assert not params["block0"]["ff_in"]["bias"].any()
  assert not dit.apply({"params": params}, x, t, text, block_causal_mask(9, 3), text_mask).any()


def test_an_unknown_size_or_prediction_is_refused():
  with pytest.raises(ValueError, match="'XXL'.*S, M, L, XL"):
    causal_dit.size("XXL")

  with pytest.raises(ValueError, match="'v'.*velocity, eps, x1 or ddpm"):
    small(predicts="v")


@pytest.mark.parametrize("fields", [pytest.param({}, marks=pytest.mark.slow), pytest.param(
    dict(use_adaln=False, use_rope=False, remat=True), marks=pytest.mark.exhaustive)], ids=["as it is", "otherwise"])
def test_layers_in_one_loop_are_the_layers_one_by_one(fields):
  """The same parameters, the same output and gradients in float64; one layer is compiled instead of each."""
  with jax.enable_x64(True):
    draw = np.random.default_rng(0)
    x, text_emb, t = draw.normal(size=(2, 6, 4)), draw.normal(size=(2, 5, 8)), draw.uniform(size=(2, 2))
    made, sizes, text_mask = [], [], np.ones((2, 5), bool)
    for scan_layers in (False, True):
      dit = CausalDiT(latent_dim=4, width=16, depth=3, num_heads=2, ff_width=32, text_dim=8, dtype=jnp.float64,
                      scan_layers=scan_layers, **fields)
      shapes = jax.eval_shape(lambda dit=dit: dit.init(jax.random.key(0), x, t, text_emb, block_causal_mask(6, 3),
                                                       text_mask))
      draw = np.random.default_rng(1)
      params = jax.tree.map(lambda leaf, draw=draw: 0.3 * draw.normal(size=leaf.shape), shapes)
      run = lambda params, dit=dit: (apply(dit, params, x, t, text_emb, block_causal_mask(6, 3), text_mask) ** 2).sum()
      made.append(jax.jit(jax.value_and_grad(run))(params))
      sizes.append(str(jax.make_jaxpr(run)(params)).count("dot_general"))
    assert sizes[1] < 0.6 * sizes[0], sizes
    jax.tree.map(lambda one, other: np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12), *made)


@pytest.mark.slow
@pytest.mark.parametrize("scan_layers", [False, True])
def test_time_left_is_an_embedding_of_each_token(scan_layers):
  dit, params = small(time_left=True, scan_layers=scan_layers)
  rows = jax.random.normal(jax.random.key(1), params["params"]["time_left_rows"].shape)
  params = {"params": params["params"] | {"time_left_rows": rows}}
  x, t = jax.random.normal(jax.random.key(2), (2, 6, dit.latent_dim)), jnp.full((2, 6), 0.5)
  text = jax.random.normal(jax.random.key(3), (2, 4, dit.text_dim))
  run = lambda left: dit.apply(params, x, t, text, block_causal_mask(6, dit.block), jnp.ones((2, 4), bool), left=left)
  np.testing.assert_array_equal(run(None), run(jnp.full((2, 6), -1)))
  given = run(jnp.array([[6, 5, 4, 3, 2, 1], [1000, 999, 4, 3, 2, 1]]))
  assert (jnp.abs(given - run(None)).max((1, 2)) > 1e-3).all() and jnp.isfinite(given).all()
