"""Both transformers are the references' and look where their masks let them."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.models.cdamd.weight_names import mardm_names, masked_transformer_names
from motion_jax.nets.masked_transformer import GatedTransformer, MaskedTransformer, size
from motion_jax.nets.masks import LATENT_MASKS, latent_mask, padding_mask
from motion_jax.training.setup import untrained
from tests import fixtures
from tests.golden import check, golden, recordings

MODES = {"eval": "causal", "train": "dccm", "trainbcm": "bcm"}
PRIORS = {"none": lambda codes: None, "one": lambda codes: codes[..., 0], "one3": lambda codes: codes[..., :1],
          "two": lambda codes: codes[..., :2], "four": lambda codes: codes}


def sizes_of(fixture, params):
  """Fields of a recorded transformer; what the arguments leave to defaults is read off its arrays."""
  recorded = fixture.meta["arguments"]
  fields = dict(latent_dim=recorded["ae_dim"], width=recorded["latent_dim"], depth=recorded["num_layers"],
                num_heads=recorded["num_heads"], ff_width=recorded["ff_size"], text_dim=recorded["clip_dim"])
  if "token_emb.weight" in params:
    fields |= dict(num_codes=len(params["token_emb.weight"]), num_levels=len(params["codebook_type_emb.weight"]),
                   max_length=params["seqTransEncoder.pos_emb"].shape[1])
  return fields


def cast(params, dtype):
  return jax.tree.map(lambda a: jnp.asarray(a, dtype), params)


@functools.partial(jax.jit, static_argnums=0, static_argnames="method")
def apply(net, params, *args, **named):
  """One compiled call: op by op, a busy machine spends minutes here."""
  return net.apply(params, *args, **named)


@golden("transformer", bounds={"": (3e-5, 1e-10)})
def run_transformer(fixture, dtype):
  net = MaskedTransformer(**sizes_of(fixture, fixture.params), dtype=dtype)
  params = cast(from_torch(fixture.params, masked_transformer_names(net.depth)), dtype)
  x, text = (jnp.asarray(fixture[f"in/{name}"], dtype) for name in ("latents", "text"))
  real = padding_mask(fixture["in/lengths"], x.shape[1])
  made = {}
  for name, recorded in expected(fixture, dtype).items():
    mode, prior, caption = name.split("_")
    attn_mask = latent_mask(MODES[mode], real & ~fixture["in/masked"], real)
    words = (text if caption == "yes" else text * 0)[:, None]
    y = apply(net, params, x, words, attn_mask, PRIORS[prior](fixture["in/codes"]))
    made[name] = valid_rows(y, recorded, real)
  return made


def expected(fixture, dtype):
  return fixture.under("out64/" if dtype == jnp.float64 else "out/")


def valid_rows(y, recorded, real):
  """Rows of padding carry no meaning and need not agree."""
  return np.where(np.asarray(real)[..., None], y, recorded)


@golden("mardm_transformer", bounds={"": (1e-5, 1e-10)})
def run_mardm_transformer(fixture, dtype):
  net = GatedTransformer(**sizes_of(fixture, fixture.params), dtype=dtype)
  params = cast(from_torch(fixture.params, mardm_names(net.depth)), dtype)
  x, text = (jnp.asarray(fixture[f"in/{name}"], dtype) for name in ("latents", "text"))
  real = padding_mask(fixture["in/lengths"], x.shape[1])
  attn_mask = latent_mask("bidirectional", real, real)
  recorded = expected(fixture, dtype)
  return {name: valid_rows(apply(net, params, x, (text * factor)[:, None], attn_mask), recorded[name], real)
          for name, factor in (("yes", 1), ("null", 0))}


@pytest.mark.slow
@recordings("mardm_transformer", "transformer")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cdamd/{name}.npz"), [precision]).failures


# --- invariants of our own ---------------------------------------------------------------------------------------


def inputs(batch=2, length=7):
  draw = np.random.default_rng(5)
  return (jnp.asarray(draw.normal(size=(batch, length, 5)), jnp.float32),
          jnp.asarray(draw.normal(size=(batch, 1, 6)), jnp.float32), draw.integers(0, 9, (batch, length, 2)))


def no_mask(length):
  return jnp.ones((1, 1, length, length), bool)


@functools.cache
def small(kind=MaskedTransformer):
  """A small transformer whose layers are all random: zero gates would pass any test."""
  net = kind(latent_dim=5, width=16, depth=2, num_heads=2, ff_width=24, text_dim=6, dropout=0.5)
  x, text, codes = inputs()
  shapes = jax.eval_shape(lambda: net.init(jax.random.key(0), x, text, no_mask(7),
                                           codes if kind is MaskedTransformer else None))
  leaves, tree = jax.tree.flatten(shapes)
  draw = np.random.default_rng(0)
  return net, tree.unflatten([jnp.asarray(0.3 * draw.normal(size=a.shape), a.dtype) for a in leaves])


@pytest.mark.slow
def test_a_dropped_prior_is_no_prior_and_one_level_has_no_row_of_its_own():
  net, params = small()
  x, text, codes = inputs()
  run = lambda **named: apply(net, params, x, text, no_mask(7), **named)
  dropped = run(codes=codes, prior_mask=jnp.array([False, True]))
  np.testing.assert_allclose(dropped[0], run()[0], atol=1e-5)
  np.testing.assert_allclose(dropped[1], run(codes=codes)[1], atol=1e-5)
  assert float(jnp.abs(run(codes=codes)[0] - dropped[0]).max()) > 1e-3
  prior = jax.jit(lambda codes: net.apply(params, codes, method="prior"))
  own = params["params"]
  np.testing.assert_allclose(prior(codes[..., 0]), own["code_table"][codes[..., 0]], rtol=1e-6)
  np.testing.assert_allclose(prior(codes), (own["code_table"][codes] + own["level_table"][:2]).mean(2), rtol=1e-5)


def test_levels_may_have_tables_of_their_own():
  """Then a code means something else on another level, and what levels say is added.

  Source: docs/papers/cdamd.md#transformer.
  """
  net = MaskedTransformer(latent_dim=5, width=16, depth=1, num_heads=2, ff_width=24, text_dim=6, num_codes=9,
                          num_levels=3, separate_levels=True)
  x, text, codes = inputs()
  params = jax.tree.map(jnp.asarray, untrained(jax.eval_shape(net.init, jax.random.key(0), x, text, no_mask(7), codes)))
  table = params["params"]["code_table"]
  assert table.shape == (3, 9, 16) and "level_table" not in params["params"]
  prior = jax.jit(lambda codes: net.apply(params, codes, method="prior"))
  np.testing.assert_allclose(prior(codes), table[0][codes[..., 0]] + table[1][codes[..., 1]], rtol=1e-6)
  np.testing.assert_array_equal(prior(codes[..., 0]), table[0][codes[..., 0]])


@pytest.mark.parametrize("kind", sorted(LATENT_MASKS))
def test_latents_look_where_the_mask_lets_them(kind):
  """Two layers reach as far as the mask times itself; a changed latent or code touches these rows and no others."""
  net, params = small()
  x, text, codes = inputs(batch=1)
  known, real = jnp.array([[1, 0, 1, 0, 1, 0, 0]], bool), padding_mask(jnp.array([6]), 7)
  attn_mask = latent_mask(kind, known, real)
  one = np.asarray(jnp.broadcast_to(attn_mask, (1, 1, 7, 7)))[0, 0] | np.eye(7, dtype=bool)
  reach = one @ one
  whole = apply(net, params, x, text, attn_mask, codes)
  for j in range(6):
    here = (np.arange(7) == j)[:, None]
    for changed in ((x + here, codes), (x, codes + here)):
      touched = np.abs(apply(net, params, changed[0], text, attn_mask, changed[1]) - whole).max((0, 2)) > 0
      np.testing.assert_array_equal(touched[:6], reach[:6, j])  # bit for bit


@pytest.mark.slow
def test_words_beyond_one_are_seen_unless_padding():
  net, params = small()
  x, text, _ = inputs()
  words = jnp.concatenate([text, 2 * text], axis=1)
  run = lambda words, text_mask: apply(net, params, x, words, no_mask(7), text_mask=text_mask)
  one = run(words, jnp.array([[True, False]] * 2))
  np.testing.assert_allclose(one, apply(net, params, x, text, no_mask(7)), atol=1e-5)
  assert float(jnp.abs(run(words, jnp.ones((2, 2), bool)) - one).max()) > 1e-3
  # In the pieces that the sampler uses, too.
  state = apply(net, params, words, method="text_state")
  pieces = apply(net, params, x, state, no_mask(7), jnp.array([[True, False]] * 2), method="window")[0]
  np.testing.assert_allclose(pieces, one, atol=1e-5)
  scaled = apply(net.clone(text_scale=2.0), params, x, text / 2, no_mask(7))
  np.testing.assert_allclose(scaled, one, atol=1e-5)


def test_what_does_not_fit_is_refused():
  x, text, codes = inputs(length=9)
  net = small()[0].clone(max_length=8)
  with pytest.raises(ValueError, match="9 latents.*positions for 8"):
    jax.eval_shape(lambda: net.init(jax.random.key(0), x, text, no_mask(9)))
  with pytest.raises(ValueError, match="'huge'.*readme, large, options"):
    size("huge")
  net, params = small(GatedTransformer)
  with pytest.raises(ValueError, match="no prior"):
    net.apply(params, x, text, no_mask(9), codes)
