"""Motion of any length, number and kind comes of one step program, and is what the pure sampler makes."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import motion_jax as mj
from motion_jax.diffusion import samplers
from motion_jax.diffusion.schedules import staircase
from motion_jax.models import cmdm
from motion_jax.models.cmdm import streaming
from motion_jax.nets.masks import block_causal_mask
from tests.models.cmdm.test_multi_prompt import shaken

pytestmark = pytest.mark.slow
FAST = dict(num_steps=4, lag=2)


@pytest.fixture(scope="module")
def model(tiny_run):
  return shaken(mj.load(tiny_run))


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


def test_a_last_block_that_is_not_whole_is_the_same_on_every_path(model):
  """26 latents, of which the last block has two: alone, beside a longer motion, streamed, as several prompts, and by
  the plain loop over 26 latents, which has no third one."""
  prompt, options = "a person waves", dict(cleanup=False, **FAST)
  alone = model.generate(prompt, num_frames=104, seeds=[6], **options)[0]
  both = model.generate([prompt, "a person runs"], num_frames=[104, 160], seeds=[6, 7], **options)
  streamed = np.concatenate(list(model.stream(prompt, num_frames=104, seed=6, **FAST)))
  several = model.multi_prompt([(prompt, 104 / model.fps)], seed=6, **options)
  for joints in (both[0].joints[:104], streamed, several.joints):
    np.testing.assert_allclose(joints, alone.joints, atol=2e-5)
  extended = [model.extend(alone.joints, prompt, num_frames=count, seed=1, **FAST).joints for count in (44, 48)]
  np.testing.assert_array_equal(*(joints[:140] for joints in extended))  # three blocks, then one of two latents
  assert np.abs(extended[0][140:] - extended[1][140:148]).max() > 1e-5
  emb, mask = model.encode_words([prompt])
  noise = jnp.concatenate([streaming.block_noise(jax.random.key(6)[None], i, model.plan_of(**FAST)[0],
                                                 model.dit.latent_dim) for i in range(9)], axis=1)[:, :26]
  made = {}
  for schedule in ("fss", "full"):
    plan, chosen, _, _ = model.plan_of(schedule=schedule, **FAST)
    velocity = cmdm.plain_velocity(model.dit, model.params, emb, mask, block_causal_mask(26, plan.block),
                                   chosen.guidance_scale)
    latents = samplers.euler(velocity, noise, staircase(plan.num_steps, 26, plan.lag, plan.block))
    made[schedule] = model.stats.denormalize(np.asarray(model.codec.decode(latents)))[0]
  np.testing.assert_allclose(made["fss"], alone.features, atol=2e-5)
  full = model.generate(prompt, num_frames=104, seeds=[6], schedule="full", **options)[0]
  np.testing.assert_allclose(made["full"], full.features, atol=2e-5)
