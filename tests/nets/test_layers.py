"""Layers that training takes often compute what plain ones do, and so do their gradients; dropout is the item's own."""
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.nets.layers import Dropout, broadcast_to_length

NUMBERS = np.random.default_rng(0).normal(size=(3, 4, 6))


def test_rows_are_repeated_and_their_gradients_added_up():
  weights = np.random.default_rng(2).normal(size=(3, 12, 6))
  one, other = (jax.jit(jax.value_and_grad(lambda x, of=of: (of(x) ** 2 * weights).sum()))(NUMBERS)
                for of in (lambda x: broadcast_to_length(x, 3), lambda x: jnp.repeat(x, 3, axis=1)))
  np.testing.assert_allclose(one[0], other[0], rtol=1e-6)
  np.testing.assert_allclose(one[1], other[1], atol=1e-5)


def test_dropout_is_the_items_own_and_keeps_the_mean():
  x = np.ones((4, 31, 33), np.float32)
  drop = jax.jit(lambda x, items: Dropout(0.2).apply({}, x, items, rngs={"dropout": jax.random.key(0)}))
  made = drop(x, jnp.arange(4))
  np.testing.assert_array_equal(drop(x, jnp.arange(2, 6))[:2], made[2:])
  assert {float(value) for value in np.unique(made)} == {0.0, 1.25}
  assert abs(float((np.asarray(made) == 0).mean()) - 0.2) < 0.02
  assert len({np.asarray(item).tobytes() for item in made}) == 4, "items lose different numbers"
  np.testing.assert_array_equal(Dropout(0.2).apply({}, x), x)
  np.testing.assert_array_equal(Dropout(0.0).apply({}, x, jnp.arange(4)), x)
