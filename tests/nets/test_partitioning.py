"""Axes of parameters have names for sharding, and parameters stay plain arrays."""
import jax
import jax.numpy as jnp
import pytest

from motion_jax.models.cdamd import stages
from motion_jax.nets import CausalDiT, Dense
from motion_jax.nets.partitioning import axes_of
from tests.conftest import load_config


def _denoiser():
  dit = CausalDiT(latent_dim=4, width=16, depth=1, num_heads=2, ff_width=24, text_dim=8, control=5)
  return dit.init, (jax.random.key(0), jnp.zeros((1, 3, 4)), jnp.zeros((1, 3)), jnp.zeros((1, 1, 8)),
                    jnp.ones((1, 1, 3, 3), bool), jnp.ones((1, 1), bool))


def _generator():
  net = stages.make_generator(load_config("cdamd_generator", "tiny").model)
  x, text_emb = jnp.zeros((1, 1, net.transformer.latent_dim)), jnp.zeros((1, 1, net.transformer.text_dim))
  return net.init, (jax.random.key(0), x, text_emb, jnp.ones((1, 1, 1, 1), bool), jnp.zeros(()))


@pytest.mark.parametrize("make", [_denoiser, _generator])
def test_every_axis_of_a_large_network_has_a_name_that_fits_its_size(make):
  """One name is one size in one network, but for "mlp", "film" and "heads", of which there may be several."""
  init, args = make()
  shapes = jax.eval_shape(init, *args)
  names = axes_of(init, *args)
  is_names = lambda node: isinstance(node, tuple)
  assert jax.tree.structure(shapes) == jax.tree.structure(names, is_leaf=is_names)
  sizes = {}
  for (path, shape), axes in zip(jax.tree.leaves_with_path(shapes), jax.tree.leaves(names, is_leaf=is_names)):
    assert len(shape.shape) == len(axes), path
    assert any(axes) or shape.ndim != 2 or path[-2].key == "time", (path, axes)  # every kernel is shardable
    for name, size in zip(axes, shape.shape):
      sizes.setdefault(name, set()).add(size)
  assert sizes["embed"] == sizes["heads"] == {16} and len(sizes) > 4


def test_parameters_that_are_stacked_later_have_layers_in_front():
  dense = Dense(5, ("embed", "mlp"))

  def init(rng):
    params = dense.init(rng, jnp.zeros((1, 3)))["params"]
    return jax.tree.map(lambda a: jnp.stack([a, a]), params) | {"scale": jnp.zeros((2, 3))}

  assert axes_of(init, jax.random.key(0)) == {"kernel": ("layers", "embed", "mlp"), "bias": ("layers", "mlp"),
                                              "scale": (None, None)}
