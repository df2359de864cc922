"""Motion of any length, number and kind comes of one step program, and is what the pure sampler makes."""
import jax
import numpy as np
import pytest

import motion_jax as mj
from motion_jax.models import cmdm

pytestmark = pytest.mark.slow
FAST = dict(num_steps=4, lag=2)


@pytest.fixture(scope="module")
def model(tiny_run):
  return mj.load(tiny_run)


def test_one_program_serves_all_lengths_and_kinds(model):
  """Other lengths, seeds, prompts, scales and schedules, several prompts, a stream and a continued motion."""
  advance = model.compiled.advance.jitted
  motion = model.generate("a person walks", num_frames=72, seed=0, **FAST)
  count = advance._cache_size()
  model.generate("a person waves", num_frames=120, seed=3, **FAST)
  model.generate("a person waves", num_frames=72, seed=3, num_steps=6, lag=3, guidance_scale=1.5)
  model.multi_prompt([("a person walks", 3.0), ("a person waves", 2.0)], seed=0, **FAST)
  next(model.stream("a person runs", seed=1, **FAST))
  model.extend(motion[0].joints, "a person sits", num_frames=48, seed=0, **FAST)
  assert advance._cache_size() == count
  model.generate(["a person walks"] * 5, num_frames=72, seed=0, **FAST)
  several = advance._cache_size()  # four side by side: a second program
  assert count < several <= 2 * count
  model.generate(["a person walks"] * 9, num_frames=84, seed=0, **FAST)
  assert advance._cache_size() == several


def test_a_motion_is_that_of_the_pure_sampler(model):
  alone = model.generate("a person waves", num_frames=84, seeds=[6], **FAST)
  plan, chosen, _, _ = model.plan_of(**FAST)
  emb, mask = model.encode_words(["a person waves"])
  pure = jax.jit(cmdm.generate, static_argnums=(0, 1, 2))(
      model.dit, plan, 7, model.params, model.codec, text_emb=emb, text_mask=mask, scale=chosen.guidance_scale,
      keys=jax.random.key(6)[None])
  np.testing.assert_allclose(model.stats.denormalize(np.asarray(pure))[0], alone[0].features, atol=2e-5)
