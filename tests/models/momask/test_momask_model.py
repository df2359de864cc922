"""MoMask ready to use: the same motion alone or in a batch, edits keep what they are to keep, and what does not fit."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import motion_jax as mj
from motion_jax import fit as training
from motion_jax.models.momask import sampling
from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
from motion_jax.training.setup import untrained
from tests.conftest import load_config


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
  """Runs of two steps: RVQ-VAE, residual transformer and, on these, the masked transformer."""
  root = tmp_path_factory.mktemp("momask")
  training.run(load_config("momask_rvq", "tiny"), root / "rvq")
  for name in ("residual", "masked"):
    config = load_config(f"momask_{name}", "tiny").unlock()
    config.frozen.tokenizer = str(root / "rvq")
    if name == "masked":
      config.frozen.residual = str(root / "residual")
    training.run(config.lock(), root / name)
  return root


@pytest.mark.slow
def test_it_is_trained_loaded_sampled_and_edits(folder):
  model = mj.load(folder / "masked")
  both = model.generate(["a person walks", "a person waves"], [41, 60], seeds=[1, 2])
  assert [motion.num_frames for motion in both] == [40, 60]
  alone = model.generate("a person waves", 60, seeds=[2])[0]
  np.testing.assert_array_equal(alone.joints, both[1].joints)
  edited = model.edit(both[1], "a person runs", change=[(20, 31)], seed=3)
  assert edited.meta["made"] == [[20, 32]] and edited.num_frames == 60
  again = model.edit(both[1], "a person runs", change=[(20, 31)], seed=3)
  np.testing.assert_array_equal(edited.joints, again.joints)
  with pytest.raises(ValueError, match="everything is kept"):
    model.edit(both[1], "a person runs", keep=[(0, 60)])
  with pytest.raises(ValueError, match="got threshold 2, expected a number from 0 to 1"):
    model.generate("a person walks", 40, threshold=2)
  config = load_config("momask_masked", "tiny").unlock()
  config.frozen.update(tokenizer=str(folder / "rvq"), residual=str(folder / "residual"))
  config.quantizer.num_levels = 4
  with pytest.raises(ValueError, match="has 3 levels of 8 codes, config.quantizer says 4 of 8"):
    training.run(config.lock(), folder / "other")


def nets(num_codes=9, levels=3):
  fields = dict(num_codes=num_codes, code_dim=4, width=8, depth=1, num_heads=2, ff_width=8, text_dim=5)
  return MaskedCodeTransformer(**fields), ResidualCodeTransformer(num_levels=levels, **fields)


def weights(net, *inputs):
  return jax.device_put(untrained(jax.eval_shape(lambda: net.init(jax.random.key(0), *inputs))))


def test_an_edit_of_nothing_changes_nothing_and_padding_is_invisible():
  net, _ = nets()
  real = jnp.arange(8) < jnp.array([8, 5])[:, None]
  codes, text = jnp.arange(16).reshape(2, 8) % 9, jnp.ones((2, 5))
  params = weights(net, codes, text, real)
  choose = sampling.chooser(sampling.noise_of(jax.random.split(jax.random.key(1), 2), 8, 9, 0), 1.0, 0.5)
  fill = lambda editable, counts, real=real: sampling.decode_masked(
      net, params, codes, editable, real, counts, text, 4.0, choose)
  none = fill(jnp.zeros((2, 8), bool), np.ones((3, 2), int))
  assert not none.masked.any() and np.array_equal(none.codes[-1], codes)
  some = fill(real & (jnp.arange(8) > 2), np.array([[5, 2], [3, 1], [1, 1]]))
  assert np.array_equal(some.codes[-1][:, :3], codes[:, :3])
  assert (some.masked[1:] <= some.masked[:-1]).all() and some.masked.sum(-1).tolist() == [[5, 2], [3, 1], [1, 1]]
  # What lies behind the end of the second motion changes nothing of it.
  other = sampling.decode_masked(net, params, codes.at[1, 5:].set(0), real, real, np.array([[8, 5], [1, 1]]), text, 4.0,
                                 choose)
  same = sampling.decode_masked(net, params, codes, real, real, np.array([[8, 5], [1, 1]]), text, 4.0, choose)
  assert np.array_equal(other.codes[-1][:, :5], same.codes[-1][:, :5])


def test_the_padding_class_is_drawn_in_the_reference_and_not_here():
  """Parity: with equal logits a tenth of the reference's residual codes are the padding class."""
  _, net = nets()
  real, codes, text = jnp.ones((2, 8), bool), jnp.zeros((2, 8), int), jnp.ones((2, 5))
  history, level = jnp.zeros((2, 8, 4)), jnp.ones(2, int)
  params = jax.tree.map(jnp.zeros_like, weights(net, history, level, text, real))
  choose = sampling.chooser(sampling.noise_of(jax.random.split(jax.random.key(2), 2), 8, 10, 1), 1.0, 0.0)
  ours, _ = sampling.add_levels(net, params, codes, real, text, None, choose)
  theirs, _ = sampling.add_levels(net, params, codes, real, text, None, choose, padding_class=True)
  assert ours.shape == theirs.shape == (2, 8, 3)
  assert (ours >= 0).all() and (theirs[..., 1:] == -1).any()
