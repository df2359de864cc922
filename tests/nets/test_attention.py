"""Attention: rotary tables of the reference, relative positions, a cache that changes nothing."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.nets.attention import Attention, RMSNorm, rotary
from motion_jax.training.setup import untrained


def test_rms_norm_in_numpy():
  x = np.random.default_rng(0).normal(size=(2, 3, 8)).astype(np.float32)
  params = {"params": {"scale": jnp.linspace(0.5, 2, 8)}}
  expected = x / np.sqrt((x ** 2).mean(-1, keepdims=True) + 1e-6) * np.linspace(0.5, 2, 8)
  np.testing.assert_allclose(RMSNorm().apply(params, x), expected, atol=1e-6)


def test_rotary_turns_adjacent_pairs():
  """Channel pair (2 i, 2 i + 1) is a complex number times exp(i pos 10000^(-2 i / K)).

  Source: docs/papers/cmdm.md#causal-dit.
  """
  x = np.random.default_rng(1).normal(size=(5, 2, 8))
  turn = np.exp(1j * np.arange(5)[:, None] * 10_000.0 ** (-2 * np.arange(4) / 8))
  expected = (x[..., 0::2] + 1j * x[..., 1::2]) * turn[:, None]
  with jax.enable_x64(True):
    made = np.asarray(rotary(jnp.asarray(x), jnp.arange(5)))
  np.testing.assert_allclose(made[..., 0::2], expected.real, atol=1e-14)
  np.testing.assert_allclose(made[..., 1::2], expected.imag, atol=1e-14)


def test_scores_depend_on_differences_of_positions():
  q, k = (jax.random.normal(jax.random.key(i), (7, 2, 16)) for i in range(2))
  scores = lambda shift: jnp.einsum("qhd,khd->hqk", rotary(q, jnp.arange(7) + shift), rotary(k, jnp.arange(7) + shift))
  np.testing.assert_allclose(scores(0), scores(100), atol=1e-4)
  batched = rotary(jnp.stack([q, q]), jnp.stack([jnp.arange(7), jnp.arange(7) + 3]))
  np.testing.assert_array_equal(batched[1], rotary(q, jnp.arange(7) + 3))


def test_masked_keys_do_not_exist():
  attention = Attention(16, 2)
  x = jnp.asarray(np.random.default_rng(0).normal(size=(2, 6, 16)), jnp.float32)
  params = untrained(jax.eval_shape(attention.init, jax.random.key(1), x))
  mask = jnp.arange(6)[None, None, None, :] < 4
  run = jax.jit(lambda x: attention.apply(params, x, attn_mask=mask))
  np.testing.assert_array_equal(run(x)[:, :4], run(x.at[:, 4:].set(1e3))[:, :4])
  np.testing.assert_allclose(run(x)[:, :4], jax.jit(attention.apply)(params, x[:, :4]), atol=1e-6)
  # A row that may see nothing is finite: padding cannot spread NaN.
  blind = jax.jit(lambda x: attention.apply(params, x, attn_mask=jnp.zeros((1, 1, 6, 6), bool)))
  assert np.isfinite(blind(x)).all()


def test_bfloat16_stays_near():
  x = jnp.asarray(np.random.default_rng(0).normal(size=(1, 6, 16)), jnp.float32)
  params = untrained(jax.eval_shape(Attention(16, 2).init, jax.random.key(1), x))
  exact, rough = (jax.jit(lambda x, net=net: net.apply(params, x, positions=jnp.arange(6)))(x)
                  for net in (Attention(16, 2), Attention(16, 2, jnp.bfloat16)))
  assert rough.dtype == jnp.bfloat16
  assert float(jnp.abs(rough - exact).max()) < 0.05


def test_heads_divide_the_width():
  with pytest.raises(ValueError, match="width 16 for 3 heads"):
    Attention(16, 3).init(jax.random.key(0), jnp.zeros((1, 2, 16)))
