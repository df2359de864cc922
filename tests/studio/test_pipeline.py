"""A pipeline is its list of steps: one left out is not done, your own run, and a prompt is parsed once."""
import numpy as np
import pytest

from motion_jax.loading import load
from motion_studio import Pipeline, steps
from motion_studio.planning.planner import Planner

FAST = dict(num_steps=3, lag=2)


@pytest.fixture(scope="module")
def model(tiny_run):
  return load(tiny_run)


def quiet(model, *args):
  pipeline = Pipeline(model, *args)
  pipeline.warns = False
  return pipeline


def test_sampling_alone_is_the_models_generate_one_motion_of_a_prompt_and_several_of_a_list(model):
  sample = quiet(model, [steps.Sample()])
  prompts = ["a person walks, then waves", "a person kicks twice"]
  one, several = (sample(given, 24, seeds=seeds, **FAST) for given, seeds in ((prompts[0], [1]), (prompts, [1, 2])))
  plain = model.generate(prompts[0], 24, seed=1, **FAST)[0]
  np.testing.assert_array_equal(one.joints, plain.joints)
  assert one.captions == plain.captions and one.meta == plain.meta
  np.testing.assert_allclose(several[0].joints, plain.joints, atol=1e-5)
  assert len(several) == 2 and several[1].meta["prompt"] == prompts[1]
  raw = quiet(model)(prompts[0], 24, seed=1, plan=False, cleanup=False, **FAST)
  np.testing.assert_array_equal(raw.joints, plain.joints)


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


class Counting(Planner):
  """Counts the prompts that it parses."""
  count = 0

  def plan(self, prompt):
    self.count += 1
    return super().plan(prompt)


def test_a_prompt_is_parsed_once(model):
  """For its segments, durations, requirements, checks, notes on paths, and all attempts."""
  pipeline, prompt = quiet(model), "a person jumps"
  pipeline.planner = planner = Counting(model)
  pipeline(prompt, 24, seed=1, max_attempts=2, **FAST)
  assert planner.count == 1
  pipeline.stream(prompt, seed=1, **FAST)
  assert planner.count == 2
  pipeline(planner.plan(prompt), 24, seed=1, max_attempts=1, **FAST)
  assert planner.count == 3
