"""Layers that training takes often compute what plain ones do, and so do their gradients; dropout is the item's own."""
import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.nets.layers import Dense, Dropout, broadcast_to_length

NUMBERS = jax.random.normal(jax.random.key(0), (3, 4, 6))


@pytest.mark.parametrize("x", [NUMBERS, NUMBERS[0]], ids=["rows of items", "rows"])
def test_a_dense_layer_is_flax_own(x):
  """The same names, the same numbers to the last bit; gradients agree, also of a sum over a batch of them."""
  ours, theirs = Dense(5), nn.Dense(5)
  params = theirs.init(jax.random.key(1), x)
  np.testing.assert_array_equal(ours.apply(params, x), theirs.apply(params, x))
  loss = lambda net: lambda params, x: (net.apply(params, x) ** 2 * jnp.arange(1.0, 6.0)).sum()
  with jax.enable_x64(True):
    params, x = jax.tree.map(lambda a: jnp.asarray(a, jnp.float64), (params, x))
    grads = [jax.grad(loss(net), (0, 1))(params, x) for net in (ours.clone(dtype=float), theirs.clone(dtype=float))]
    for one, other in zip(*map(jax.tree.leaves, grads), strict=True):
      assert one.dtype == jnp.float64
      np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize("count", [1, 3])
def test_rows_are_repeated_and_their_gradients_added_up(count):
  weights = jax.random.normal(jax.random.key(2), (3, 4 * count, 6))
  one, other = (jax.value_and_grad(lambda x, of=of: (of(x) ** 2 * weights).sum())(NUMBERS)
                for of in (lambda x: broadcast_to_length(x, count), lambda x: jnp.repeat(x, count, axis=1)))
  np.testing.assert_array_equal(one[0], other[0])
  np.testing.assert_allclose(one[1], other[1], atol=1e-5)


def test_dropout_is_the_items_own_and_keeps_the_mean():
  x = jnp.ones((4, 31, 33))
  drop = jax.jit(lambda x, items: Dropout(0.2).apply({}, x, items, rngs={"dropout": jax.random.key(0)}))
  made = drop(x, jnp.arange(4))
  np.testing.assert_array_equal(drop(x[2:], jnp.arange(2, 4)), made[2:])
  assert {float(value) for value in np.unique(made)} == {0.0, 1.25}
  assert abs(float((made == 0).mean()) - 0.2) < 0.02
  assert len({np.asarray(item).tobytes() for item in made}) == 4, "items lose different numbers"
  np.testing.assert_array_equal(Dropout(0.2).apply({}, x), x)
  np.testing.assert_array_equal(Dropout(0.0).apply({}, x, jnp.arange(4)), x)
