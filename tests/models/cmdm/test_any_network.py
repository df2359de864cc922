"""The cached sampler takes any network of the Protocol: here one layer of attention without captions."""
import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn

from motion_jax.diffusion import samplers
from motion_jax.diffusion.schedules import staircase
from motion_jax.models.cmdm import streaming
from motion_jax.nets.masks import sliding_mask
from motion_jax.training.setup import untrained
from tests.models.cmdm.test_streaming import noise_of


class Toy(nn.Module):
  """One layer of self-attention, conditioned on the time alone; no positions, no captions."""
  latent_dim: int = 2
  width: int = 8
  num_heads: int = 2
  depth: int = 1
  dtype: type = jnp.float32

  def setup(self):
    self.projections = nn.Dense(3 * self.width)
    self.out = nn.Dense(self.latent_dim)

  def stack_layers(self, params):
    return params

  def modulation(self, t):
    return t[None, :, None]

  def turn_keys(self, cache, positions):
    return cache

  def window(self, x, t, modulation, text, attn_mask, positions, past=None, control=None):
    heads = lambda a: a.reshape(*a.shape[:2], self.num_heads, -1)
    query, *new = map(heads, jnp.split(self.projections(x) + modulation[0], 3, axis=-1))
    keys, values = new if past is None else (
        jnp.concatenate([of_layer[0], one], axis=1) for of_layer, one in zip(past, new))
    y = nn.dot_product_attention(query, keys, values, mask=attn_mask)
    return self.out(y.reshape(*x.shape[:2], -1)), tuple(one[None] for one in new)

  def velocity(self, x, t, attn_mask):
    return self.window(x, t, self.modulation(t)[:, None], None, attn_mask, None)[0]


BLOCKS, BLOCK, LAG = 8, 2, 3  # the lag does not divide the steps
PLAN = streaming.make_plan(4, LAG, BLOCK, 4 * BLOCK, BLOCKS, guided=False)
KEYS = jax.random.key_data(jax.random.split(jax.random.key(1), 3))


def network():
  toy = Toy()
  return toy, untrained(jax.eval_shape(lambda: toy.init(
      jax.random.key(0), jnp.zeros((1, 16, 2)), jnp.zeros(16), jnp.ones((1, 1, 16, 16), bool), method="velocity")))


def plain(toy, params, length):
  """The plain loop over this number of latents, which need not be whole blocks."""
  mask = np.asarray(sliding_mask(length, BLOCK, PLAN.context))
  noise = noise_of(KEYS, PLAN, BLOCKS, 2)[:, :length]
  return noise, jax.jit(lambda noise: samplers.euler(
      lambda x, t: toy.apply(params, x, t, mask, method="velocity"), noise, staircase(4, length, LAG, BLOCK)))(noise)


def test_a_network_without_captions_is_sampled_as_by_the_plain_loop():
  """Past the end of the cache, too: the context is four blocks, the motion eight."""
  toy, params = network()
  made = jax.jit(lambda params: streaming.bind(toy, PLAN, params, keys=KEYS).sample(BLOCKS))(params)
  noise, expected = plain(toy, params, BLOCKS * BLOCK)
  assert made.shape == (3, BLOCKS * BLOCK, 2) and np.abs(expected - noise).max() > 0.1
  np.testing.assert_allclose(made, expected, atol=1e-5)


def test_latents_that_fill_up_the_last_block_are_not_seen():
  """Motions of 3, 15 and 16 latents in one batch are those that the plain loop makes of just as many."""
  toy, params = network()
  lengths = np.array([3, 15, 16])
  sample = jax.jit(lambda params, lengths: streaming.bind(toy, PLAN, params, keys=KEYS, lengths=lengths).sample(BLOCKS))
  made, filled = sample(params, lengths), sample(params, np.full(3, 16))
  for row, length in enumerate(lengths[:2]):
    np.testing.assert_allclose(made[row, :length], plain(toy, params, int(length))[1][row], atol=1e-5)
    assert np.abs(made - filled)[row, length // 2 * 2:length].max() > 1e-3  # the last block is another one
  np.testing.assert_array_equal(made[2], filled[2])
