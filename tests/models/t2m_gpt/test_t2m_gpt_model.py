"""T2M-GPT ready to use: it ends by itself or where it is to end, alone or in a batch; its rows of codes."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import motion_jax as mj
from motion_jax import fit as training
from motion_jax.models.t2m_gpt import items, sampling
from motion_jax.nets.token_gpt import CodeGPT
from motion_jax.training.setup import untrained
from tests.conftest import load_config


@pytest.mark.slow
def test_it_is_trained_loaded_and_sampled(tmp_path):
  training.run(load_config("t2m_gpt_vq", "tiny"), tmp_path / "vq")
  config = load_config("t2m_gpt_gpt", "tiny").unlock()
  config.frozen.tokenizer = str(tmp_path / "vq")
  training.run(config.lock(), tmp_path / "gpt")
  model = mj.load(tmp_path / "gpt")
  both = model.generate(["a person walks", "a person waves"], [41, 60], seeds=[1, 2])
  assert [motion.num_frames for motion in both] == [40, 60]
  np.testing.assert_allclose(model.generate("a person waves", 60, seeds=[2])[0].joints, both[1].joints, atol=1e-5)
  own = model.generate(["a person walks", "a person waves"], seeds=[3, 4])
  assert all(motion.num_frames % 4 == 0 and 4 <= motion.num_frames <= 200 for motion in own)
  greedy = [model.generate("a person walks", seed=seed, draw="greedy")[0].joints for seed in (1, 2)]
  np.testing.assert_array_equal(*greedy)
  with pytest.raises(ValueError, match="got guidance_scale 2, expected"):
    model.generate("a person walks", guidance_scale=2)
  with pytest.raises(AttributeError, match="has no 'edit'"):
    model.edit  # noqa: B018


def test_lengths_are_kept_and_batch_mates_change_nothing():
  net = CodeGPT(num_codes=6, width=8, depth=2, num_heads=2, ff_width=8, text_dim=5, max_length=12)
  text = jax.random.normal(jax.random.key(0), (3, 5))
  params = jax.device_put(untrained(jax.eval_shape(
      lambda: net.init(jax.random.key(0), jnp.zeros((1, 1), int), text[:1]))))
  keys = jax.random.split(jax.random.key(1), 3)

  @jax.jit
  def run(text, keys, fewest, most):
    return sampling.sample(net, params, text, sampling.categorical(keys), fewest, most)

  fixed = jnp.array([4, 11, 1])
  codes = run(text, keys, fixed, fixed)
  assert codes.shape == (3, 11) and (codes >= 0).sum(-1).tolist() == fixed.tolist()
  free = run(text, keys, jnp.ones(3, int), jnp.full(3, 11))
  lengths = (free >= 0).sum(-1)
  assert (lengths >= 1).all() and all((row[:n] >= 0).all() and (row[n:] == -1).all() for row, n in zip(free, lengths))
  for i in range(3):
    assert np.array_equal(run(text[i:i + 1], keys[i:i + 1], jnp.ones(1, int), jnp.full(1, 11))[0], free[i])


def test_rows_of_codes():
  codes = [np.arange(n) for n in (1, 3, 9)]
  data = items.CodeItems(codes, [["a"], ["b", "c"], ["d"]], length=7, end=20, shorten_rate=1.0)
  batch = data.batch(3, 0, 0)
  for row, count, caption in zip(batch["codes"], batch["num_codes"], batch["caption"]):
    # Parity: the reference drops the only code of a clip, too; here a clip keeps one.
    assert count == {"a": 1, "b": 2, "c": 2, "d": 6}[caption]
    assert row[count] == 20 and (row[count + 1:] == 21).all() and (np.diff(row[:count]) == 1).all()
  assert np.array_equal(data.batch(3, 0, 0, slice(1, 2))["codes"], batch["codes"][1:2])
  assert len(items.without_one(codes[0], "head")) == 0
  with pytest.raises(ValueError, match="none of 1 clips has a whole code and a caption"):
    items.CodeItems([np.arange(3)], [[]], 7, 20)
