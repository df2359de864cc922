"""A pipeline is its list of steps: one left out is not done, your own run, and a prompt is parsed once."""
import sys

import numpy as np
import pytest

from motion_jax.loading import load
from motion_studio import Pipeline, steps
from motion_studio.language import parse

FAST = dict(num_steps=3, lag=2)


@pytest.fixture(scope="module")
def model(tiny_run):
  return load(tiny_run)


def quiet(model, *args):
  pipeline = Pipeline(model, *args)
  pipeline.warns = False
  return pipeline


def test_one_prompt_is_a_motion_and_a_list_is_motions(model):
  pipeline = quiet(model)
  one, several = (pipeline(prompts, 24, seed=1, max_attempts=1, **FAST) for prompts in (
      "a person walks", ["a person walks", "a person waves"]))
  assert one.joints.shape == (24, 22, 3) and len(several) == 2
  np.testing.assert_allclose(one.joints, several[0].joints, atol=1e-5)


def test_sampling_alone_is_the_models_generate(model):
  for prompt in ("a person walks, then waves", "a person kicks twice"):
    made = quiet(model, [steps.Sample()])(prompt, 24, seed=1, **FAST)
    plain = model.generate(prompt, 24, seed=1, **FAST)[0]
    np.testing.assert_array_equal(made.joints, plain.joints)
    assert made.captions == plain.captions and made.meta == plain.meta


def test_a_function_of_a_job_is_a_step(model):
  def mirror(job):
    job.motions = [motion.replace(joints=motion.joints * [-1, 1, 1]) for motion in job.motions]

  plain, mirrored = (quiet(model, [steps.Sample(), *more])("a person walks", 24, seed=1, **FAST)
                     for more in ([], [mirror]))
  np.testing.assert_array_equal(mirrored.joints, plain.joints * [-1, 1, 1])


def test_attempts_stand_in_meta(model):
  made = quiet(model)("a person jumps", 24, seed=1, max_attempts=2, **FAST)
  attempts = made.meta["attempts"]
  assert 1 <= len(attempts) <= 2 and sum(one["kept"] for one in attempts) == 1
  assert attempts[0] | dict(violation_score=0, kept=0) == dict(
      number=1, seed=1, prompt="a person jumps", guidance_scale=model.sampling().guidance_scale, independent=False,
      violation_score=0, kept=0)
  for options in (dict(plan=False), dict(max_attempts=1)):
    assert "attempts" not in quiet(model)("a person jumps", 24, seed=1, **options, **FAST).meta


def test_wrong_arguments(model):
  with pytest.raises(TypeError, match="has no argument 'cfg'; did you mean guidance_scale?"):
    quiet(model)("a person walks", cfg=2)
  with pytest.raises(ValueError, match="got the prompt ''"):
    quiet(model)(["a person walks", ""])
  with pytest.raises(ValueError, match="has no 'edit'"):
    quiet(model).edit(None, "a person waves", "prefix")


def parses_while(act):
  """How often a sentence is parsed while act() runs."""
  count, code = 0, parse.__code__

  def profile(frame, event, _):
    nonlocal count
    count += event == "call" and frame.f_code is code

  sys.setprofile(profile)
  try:
    act()
  finally:
    sys.setprofile(None)
  return count


@pytest.mark.parametrize("prompt", [
    "a person walks in a circle", "a person walks forward while waving, then sits down and stays there",
    "a person kicks twice, then bows"])
def test_a_prompt_is_parsed_once(model, prompt):
  """For its segments, durations, requirements, checks, notes on paths, and all attempts."""
  pipeline = quiet(model)
  assert parses_while(lambda: pipeline(prompt, seed=1, max_attempts=1, **FAST)) == 1
  if "circle" not in prompt:  # which gets a side in further attempts, and so is another prompt
    assert parses_while(lambda: pipeline(prompt, 96, seed=1, max_attempts=3, **FAST)) == 1
  assert parses_while(lambda: pipeline.stream(prompt, seed=1, **FAST)) == 1
  plan = pipeline.plan(prompt)
  assert parses_while(lambda: pipeline(plan, 96, seed=1, max_attempts=1, **FAST)) == 0
