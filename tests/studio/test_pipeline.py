"""A pipeline is its list of steps: one left out is not done, your own run, and a prompt is parsed once."""
import json

import numpy as np
import pytest

from motion_jax.control import RootPath
from motion_jax.loading import load
from motion_jax.motion.step_records import change_between
from motion_jax.utils.errors import InputError
from motion_jax_studio import Pipeline, steps
from motion_jax_studio.pipeline import STEPS
from motion_jax_studio.planning.planner import Planner
from motion_jax_studio.step_names import EDIT, GENERATE, MULTI_PROMPT, left_out

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


def test_each_step_records_what_a_comparison_of_joints_measures(model):
  """Joints before and after each step are kept and compared here."""
  seen = {}

  def watched(step):
    def run(job):
      before = job.motions and job.motions[0].joints
      step(job)
      seen[steps.name_of(step)] = before, job.motions and job.motions[0]
    run.name = steps.name_of(step)
    return run

  prompt, path = "a person puts the hands on the hips", RootPath([[0, 0], [0, 1]])
  every = dict(num_frames=48, seed=1, max_attempts=1, **FAST)
  unchecked = [watched(step) for step in STEPS if step != steps.Check()]
  made = quiet(model, unchecked)(f"{prompt}, then walks", control=[path], **every)
  records = {row["step"]: row for row in made.meta["steps"]}
  assert [row["step"] for row in made.meta["steps"] if row["did"] != "pauses inserted"] == [
      "plan", "sample", "cleanup", "pose", "correct", "constrain"]
  assert json.loads(json.dumps(made.meta["steps"])) == made.meta["steps"]
  changed = lambda row: {key: row[key] for key in ("frames", "cm", "degrees", "num_frames") if key in row}
  before, after = seen["pose"]
  assert after.meta["steps"][-1] == records["pose"] and records["pose"]["cm"] > 5
  assert changed(records["pose"]) == change_between(before, after.joints)
  before, after = seen["constrain"]
  assert changed(records["constrain"]) == change_between(before, after.joints)  # it is placed where it begins
  raw = quiet(model)(prompt, **every, without="cleanup,pose,correct,check")
  clean = quiet(model)(prompt, **every, without="pose,correct,check")
  assert changed(clean.meta["steps"][-1]) == change_between(raw.joints, clean.joints) != {}


def test_without_any_step_it_is_the_networks_own_motion(model):
  prompt = "a person puts the left hand on the head, then walks"
  bare = quiet(model)(prompt, 24, seed=1, without=GENERATE, **FAST)
  np.testing.assert_array_equal(bare.joints, model.generate(prompt, 24, seed=1, **FAST)[0].joints)
  assert [row["step"] for row in bare.meta["steps"]] == ["sample"]
  assert {*GENERATE, "sample"} == {steps.name_of(step) for step in STEPS}
  rows = [("a person walks", 1.0), ("a person waves", 1.0)]
  several = quiet(model).multi_prompt(rows, seed=1, without=MULTI_PROMPT, rest=True, **FAST)
  assert {row["step"] for row in several.meta["steps"]} == {"sample"}
  longer = quiet(model).extend(bare, "a person waves", 24, seed=1, without="plan, Clean-Up", **FAST)
  assert [row["step"] for row in longer.meta["steps"]] == ["sample"]
  cleaned = quiet(model).extend(bare, "a person waves", 24, seed=1, **FAST).meta["steps"]
  assert [row["step"] for row in cleaned] == ["plan", "sample", "cleanup"]
  assert all(first >= 24 for row in cleaned for first, _ in row.get("frames", ()))


@pytest.mark.parametrize("without, says", [
    ("corect", "'corect'.*plan, warn, cleanup, pose, correct, check, constrain$"), (["pose", "sample"], "'sample'"),
    ([3], "'3'")])
def test_a_step_that_does_not_exist_names_those_that_do(model, without, says):
  with pytest.raises(InputError, match=says):
    quiet(model)("a person walks", 24, without=without)
  with pytest.raises(InputError, match="'constrain'.*plan, warn, cleanup$"):
    quiet(model).extend(None, "a person walks", without="constrain")
  with pytest.raises(InputError, match="'pose'.*plan, warn, cleanup, correct, check$"):
    left_out("pose", EDIT)


def test_attempts_stand_in_meta(model):
  made = quiet(model)("a person jumps", 24, seed=1, max_attempts=2, **FAST)
  attempts = made.meta["attempts"]
  assert 1 <= len(attempts) <= 2 and sum(one["kept"] for one in attempts) == 1
  assert attempts[0] | dict(violation_score=0, kept=0) == dict(
      number=1, seed=1, prompt="a person jumps", guidance_scale=model.sampling().guidance_scale, independent=False,
      violation_score=0, kept=0)
  scores = [one["violation_score"] for one in attempts]
  assert made.meta["steps"][-1]["step"] == "check" and made.meta["steps"][-1]["score"] == [scores[0], min(scores)]
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
