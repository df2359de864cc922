"""Attention: rotary tables in closed form, masked keys, the fused kernel's numbers and where it is used."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export

from motion_jax.nets.attention import Attention, dot_product_attention
from motion_jax.training.setup import untrained


def test_masked_keys_do_not_exist():
  attention = Attention(16, 2)
  x = np.random.default_rng(0).normal(size=(2, 6, 16)).astype(np.float32)
  params = untrained(jax.eval_shape(attention.init, jax.random.key(1), x))
  run = jax.jit(lambda x, mask: attention.apply(params, x, attn_mask=mask))
  shown = np.broadcast_to(np.arange(6) < 4, (1, 1, 6, 6))
  made = run(x, shown)
  np.testing.assert_array_equal(made[:, :4], run(np.where(np.arange(6)[:, None] < 4, x, 1e3), shown)[:, :4])
  np.testing.assert_allclose(made[:, :4], run(x[:, :4], np.ones((1, 1, 4, 4), bool)), atol=1e-6)
  assert np.isfinite(run(x, np.zeros((1, 1, 6, 6), bool))).all()  # padding cannot spread NaN


# Calls of cuDNN, which jax.export does not promise to keep compatible between versions.
CUDNN = [f"__cudnn$fmhaScaleBiasSoftmax{suffix}" for suffix in ("", "Backward")]


def rows(length, seed, width=16, dtype=jnp.bfloat16):
  return np.random.default_rng(seed).normal(size=(2, length, 3, width)).astype(dtype)


attend = jax.jit(dot_product_attention, static_argnames="implementation")


@pytest.mark.parametrize("lengths, masked", [((6, 8), True), ((5, 7), True), ((5, 7), False)])
def test_fused_attention_is_the_plain_one_where_there_is_no_such_kernel(lengths, masked, traced_cudnn):
  """Odd lengths are padded for the kernel: no row sees the padding, and it is cut off again."""
  q, k, v = rows(lengths[0], 0), rows(lengths[1], 1), rows(lengths[1], 2)
  mask = np.broadcast_to(np.arange(lengths[1]) < 5, (2, 1, 1, lengths[1])).copy()
  mask[1, ..., 0] = False
  plain, fused = (attend(q, k, v, mask if masked else None, implementation=name) for name in ("xla", "cudnn"))
  np.testing.assert_allclose(fused.astype(np.float32), plain.astype(np.float32), atol=0.01)
  assert fused.shape == plain.shape and fused.dtype == plain.dtype


def test_without_cudnn_the_program_is_the_plain_one():
  q = rows(5, 0)
  np.testing.assert_array_equal(attend(q, q, q, implementation="cudnn"), attend(q, q, q))


@pytest.mark.parametrize("dtype, width, fused", [("bfloat16", 128, True), ("float32", 16, False),
                                                 ("bfloat16", 12, False), ("bfloat16", 136, False)])
def test_the_kernel_is_in_programs_for_cuda_alone(dtype, width, fused, traced_cudnn):
  q, k = rows(5, 0, width, dtype), rows(8, 1, width, dtype)
  mask = jnp.ones((2, 1, 1, 8), bool)

  def gradient(q, k):
    return jax.grad(lambda q: dot_product_attention(q, k, k, mask, implementation="cudnn").sum().astype(jnp.float32))(q)

  for platform in ("cuda", "cpu") if fused else ("cuda",):
    program = export.export(jax.jit(gradient), platforms=[platform], disabled_checks=[
        export.DisabledSafetyCheck.custom_call(name) for name in CUDNN])(q, k).mlir_module()
    assert ("__cudnn$fmha" in program) == (fused and platform == "cuda")


def test_what_attention_cannot_be_is_refused():
  with pytest.raises(ValueError, match="width 16 for 3 heads"):
    Attention(16, 3).init(jax.random.key(0), jnp.zeros((1, 2, 16)))
  with pytest.raises(ValueError, match="attention 'flash', expected one of xla, cudnn"):
    dot_product_attention(*[rows(2, 0)] * 3, implementation="flash")
