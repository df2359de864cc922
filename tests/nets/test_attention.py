"""Attention: rotary tables of the reference, relative positions, a cache that changes nothing."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export

from motion_jax.nets.attention import Attention, RMSNorm, dot_product_attention, rotary
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


# Calls of cuDNN, which jax.export does not promise to keep compatible between versions.
CUDNN = [f"__cudnn$fmhaScaleBiasSoftmax{suffix}" for suffix in ("", "Backward")]


def rows(length, seed, width=16, dtype=jnp.bfloat16):
  return jax.random.normal(jax.random.key(seed), (2, length, 3, width), dtype)


@pytest.mark.parametrize("lengths", [(6, 8), (5, 7), (5, 8), (6, 7)])
def test_fused_attention_is_the_plain_one_where_there_is_no_such_kernel(lengths, traced_cudnn):
  """Odd lengths are padded for the kernel: no row sees the padding, and it is cut off again."""
  (q, k, v), mask = (rows(lengths[0], 0), rows(lengths[1], 1), rows(lengths[1], 2)), jnp.arange(lengths[1]) < 5
  mask = jnp.broadcast_to(mask, (2, 1, 1, lengths[1])).at[1, ..., 0].set(False)
  for attn_mask in (None, mask):
    plain, fused = (dot_product_attention(q, k, v, attn_mask, implementation=name) for name in ("xla", "cudnn"))
    np.testing.assert_allclose(fused.astype(jnp.float32), plain.astype(jnp.float32), atol=0.01)
    assert fused.shape == plain.shape and fused.dtype == plain.dtype


def test_without_cudnn_the_program_is_the_plain_one():
  q = rows(5, 0)
  np.testing.assert_array_equal(dot_product_attention(q, q, q, implementation="cudnn"), dot_product_attention(q, q, q))


@pytest.mark.parametrize("dtype, width, fused", [("bfloat16", 16, True), ("bfloat16", 128, True),
                                                 ("float32", 16, False), ("bfloat16", 12, False),
                                                 ("bfloat16", 256, False)])
def test_the_kernel_is_in_programs_for_cuda_alone(dtype, width, fused, traced_cudnn):
  q, k = rows(5, 0, width, dtype), rows(8, 1, width, dtype)
  mask = jnp.ones((2, 1, 1, 8), bool)

  def gradient(q, k):
    return jax.grad(lambda q: dot_product_attention(q, k, k, mask, implementation="cudnn").sum().astype(jnp.float32))(q)

  for platform in ("cuda", "tpu", "cpu"):
    program = export.export(jax.jit(gradient), platforms=[platform], disabled_checks=[
        export.DisabledSafetyCheck.custom_call(name) for name in CUDNN])(q, k).mlir_module()
    assert ("__cudnn$fmha" in program) == (fused and platform == "cuda")


def test_an_unknown_implementation_is_named():
  with pytest.raises(ValueError, match="attention 'flash', expected one of xla, cudnn"):
    dot_product_attention(*[rows(2, 0)] * 3, implementation="flash")
