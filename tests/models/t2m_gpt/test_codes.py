"""T2M-GPT's codes: a motion ends by itself or where it is to end, alone or in a batch; clips as rows of codes."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.latents import RvqCodec
from motion_jax.models.shared.autoencoders import autoencoder_shapes
from motion_jax.models.t2m_gpt import items, sampling
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.token_gpt import CodeGPT
from motion_jax.training.setup import untrained

NET = CodeGPT(num_codes=6, width=8, depth=2, num_heads=2, ff_width=8, text_dim=5, max_length=12)
TEXT = np.random.default_rng(0).normal(size=(3, 5)).astype(np.float32)


@pytest.fixture(scope="module")
def params():
  return jax.device_put(untrained(jax.eval_shape(
      lambda: NET.init(jax.random.key(0), jnp.zeros((1, 1), int), TEXT[:1]))))


def test_the_cached_step_gives_the_logits_of_a_whole_pass(params):
  codes = np.random.default_rng(1).integers(0, 6, (3, 11))
  whole, cache = jax.jit(NET.apply)(params, codes, TEXT), NET.init_cache(3)
  step = jax.jit(functools.partial(NET.apply, method="step"))
  for place in range(12):
    logits, cache = step(params, codes[:, max(place - 1, 0)], place, TEXT, cache)
    np.testing.assert_allclose(logits, whole[:, place], atol=2e-5)


def test_lengths_are_kept_and_batch_mates_change_nothing(params):
  keys = jax.random.split(jax.random.key(1), 3)

  @jax.jit
  def run(text, keys, fewest, most):
    return sampling.sample(NET, params, text, sampling.categorical(keys), fewest, most)

  fixed = np.array([4, 11, 1])
  codes = run(TEXT, keys, fixed, fixed)
  assert codes.shape == (3, 11) and (codes >= 0).sum(-1).tolist() == fixed.tolist()
  free = np.asarray(run(TEXT, keys, np.ones(3, int), np.full(3, 11)))
  lengths = (free >= 0).sum(-1)
  assert (lengths >= 1).all() and all((row[:n] >= 0).all() and (row[n:] == -1).all() for row, n in zip(free, lengths))
  turned = np.array([2, 0, 1])
  np.testing.assert_array_equal(run(TEXT[turned], keys[turned], np.ones(3, int), np.full(3, 11)), free[turned])


def test_rows_of_codes():
  codes = [np.arange(n) for n in (1, 3, 9)]
  data = items.CodeItems(codes, [["a"], ["b", "c"], ["d"]], length=7, end=20, shorten_rate=1.0)
  batch = data.batch(3, 0, 0)
  for row, count, caption in zip(batch["codes"], batch["num_codes"], batch["caption"]):
    # Parity: the reference drops the only code of a clip, too; here a clip keeps one.
    assert count == {"a": 1, "b": 2, "c": 2, "d": 6}[caption]
    assert row[count] == 20 and (row[count + 1:] == 21).all() and (np.diff(row[:count]) == 1).all()
  assert np.array_equal(data.batch(3, 0, 0, slice(1, 2))["codes"], batch["codes"][1:2])
  with pytest.raises(ValueError, match="none of 1 clips has a whole code and a caption"):
    items.CodeItems([np.arange(3)], [[]], 7, 20)


def test_clips_are_drawn_as_often_as_they_weigh():
  """Weights are those of all clips, also of one that has no caption and so is never drawn."""
  data = items.CodeItems([np.arange(4)] * 3, [[], ["b"], ["c"]], length=7, end=20, weights=np.array([1.0, 3.0, 1.0]))
  drawn = [caption for step in range(20) for caption in data.batch(16, 0, step)["caption"]]
  assert abs(np.mean([caption == "b" for caption in drawn]) - 0.75) < 4 * np.sqrt(0.75 * 0.25 / 320)


def test_a_clip_has_the_codes_that_it_has_alone():
  """Cut to whole codes, none of them of padding or of its neighbours; where it is cut depends on the seed."""
  net = Autoencoder(features=3, latent_dim=2, width=4, num_halvings=2, dilations=(1,))
  quantizer = type("Quantizer", (), {"num_levels": 1, "num_codes": 16})
  codec = RvqCodec(net, jax.device_put(untrained(autoencoder_shapes(net, quantizer))))
  draw = np.random.default_rng(0)
  clips = [draw.normal(size=(length, 3)).astype(np.float32) for length in (16, 32, 23)]
  alone = jax.jit(lambda x: codec.encode(x[None])[0][0, :, 0])
  cuts = [np.asarray(alone(clips[2][first:first + 20])).tolist() for first in range(4)]
  starts = set()
  for seed in (0, 1):
    made = items.encode_clips(codec, clips, seed, batch_size=2)
    assert [len(codes) for codes in made] == [4, 8, 5]
    for clip, codes in zip(clips[:2], made):
      np.testing.assert_array_equal(alone(clip), codes)
    starts.add(cuts.index(made[2].tolist()))
  assert len(starts) == 2
