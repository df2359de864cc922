"""Motions that violate what their prompts require are sampled again; the best attempt is kept, and all are recorded."""
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.models.results import Motion
from motion_jax.motion.representations import get_layout
from motion_jax_studio.language import parse
from motion_jax_studio.language.plain_words import in_plain_words
from motion_jax_studio.planning.job import Job
from motion_jax_studio.resampling import resampled

JUMPS = "a person jumps"


def joints_of(action):
  return synthetic_joints(action, 80, np.random.default_rng(0)).astype(np.float32)


class Sampler:
  """Samples a jump where jumps(prompt) says so, else a walk, and keeps the jobs; guidance is 2 unless given."""

  def __init__(self, jumps=lambda prompt: False, guidance_scale=2.0, joints=None):
    self.jumps, self.jobs, self.independent, self.joints = jumps, [], [], joints
    self.model = SimpleNamespace(
        sampling=lambda **given: SimpleNamespace(guidance_scale=guidance_scale), stats=SimpleNamespace(
            layout=get_layout("full")), config=SimpleNamespace(data=SimpleNamespace(mode="benchmark")), fps=20.0)
    self.planner = SimpleNamespace(model=self.model, fps=20.0, plan=parse, in_plain_words=in_plain_words,
                                   with_postures=lambda plan: plan)

  def __call__(self, job):
    self.jobs.append(job)
    self.independent.append(job.independent)
    return [Motion(joints_of("jump" if self.jumps(prompt) else "walk") if self.joints is None else self.joints, 20.0)
            for prompt in job.prompts]

  def best(self, prompts, max_attempts=4, warns=False, keys=None, **sampling):
    """The best motions of a job whose first ones are sampled, too."""
    keys = jax.random.split(jax.random.key(0), len(prompts)) if keys is None else keys
    job = Job(self.planner, prompts, [None] * len(prompts), keys, list(range(len(prompts))), sampling,
              [[]] * len(prompts), warns=warns, plans=[parse(prompt) for prompt in prompts])
    job.motions = self(job)
    return resampled(job, self, max_attempts)

  @property
  def prompts(self):
    return [prompt for job in self.jobs for prompt in job.prompts]


def third_time():
  count = {}

  def jumps(prompt):
    count[prompt] = count.get(prompt, 0) + 1
    return count[prompt] == 3 and "jumps" in prompt
  return jumps


def test_only_what_violates_a_requirement_is_sampled_again_by_a_key_of_its_own():
  sampler, prompts = Sampler(third_time()), ["a person walks", JUMPS, "someone jumps"]
  made = sampler.best(prompts)
  assert sampler.prompts == prompts + prompts[1:] * 2
  keys = [tuple(jax.random.key_data(key).tolist()) for job in sampler.jobs for key in job.keys]
  assert len(set(keys)) == len(keys)
  attempts = [motion.meta["attempts"] for motion in made]
  assert [len(one) for one in attempts] == [1, 3, 3] and [one[-1]["kept"] for one in attempts] == [True] * 3
  alone = Sampler(third_time())  # the same keys
  alone.best(prompts[1:2], keys=jax.random.split(jax.random.key(0), 3)[1:2])
  assert [tuple(jax.random.key_data(job.keys[0]).tolist()) for job in alone.jobs] == [keys[1], keys[3], keys[5]]


def test_of_equals_the_first_is_kept_and_all_attempts_are_recorded():
  made, = Sampler().best([JUMPS], 3)
  own = dict(seed=0, prompt=JUMPS, violation_score=1.0)
  assert made.meta["attempts"] == [
      dict(number=1, guidance_scale=2.0, independent=False, kept=True, **own),
      dict(number=2, guidance_scale=4.0, independent=False, kept=False, **own),
      dict(number=3, guidance_scale=4.0, independent=True, kept=False, **own)]
  assert made.meta["unmet"] == ["no jump seen"] and made.meta["prompt"] == JUMPS


def test_only_a_circle_without_a_side_gets_one_in_further_attempts():
  either, clockwise = "he walks in a circle", "he walks in a clockwise circle"
  for prompt, again in ((either, [f"{either} to the left", f"{either} to the right"]), (clockwise, [clockwise] * 2)):
    sampler = Sampler()
    made, = sampler.best([prompt], 3)
    assert sampler.prompts == [prompt, *again]
    assert [one["prompt"] for one in made.meta["attempts"]] == sampler.prompts


def test_further_attempts_have_twice_the_guidance():
  """Except where a scale is given, and in a student, which has no guidance of its own."""
  scales = lambda sampler, **given: (sampler.best([JUMPS], 3, **given), [
      job.sampling.get("guidance_scale") for job in sampler.jobs])[1]
  assert scales(Sampler(), num_steps=3) == [None, 4.0, 4.0]
  assert scales(Sampler(), guidance_scale=1.5) == [1.5] * 3
  assert scales(Sampler(guidance_scale=1.0)) == [None] * 3


def test_a_motion_that_is_only_too_fast_has_half_the_guidance():
  """And never less than 1."""
  runs = joints_of("walk") + np.linspace(0, 40, 80, dtype=np.float32)[:, None, None] * np.array([0, 0, 1], np.float32)
  prompts = ["a person runs", "a person runs and kicks"]  # ten metres a second
  for scale, louder in ((2.0, 4.0), (1.5, 3.0)):
    sampler = Sampler(guidance_scale=scale, joints=runs)
    sampler.best(prompts, 2)
    assert [(job.prompts, job.sampling.get("guidance_scale")) for job in sampler.jobs] == [
        (prompts, None), (prompts[1:], louder), (prompts[:1], 1.0)]


def test_what_all_attempts_violate_is_reported_where_warnings_are_read():
  prompts = ["a person walks", JUMPS, "someone jumps and kicks"]
  sampler = Sampler(lambda prompt: prompt == JUMPS)
  with pytest.warns(UserWarning, match="3 attempts, no jump seen, no kick seen") as warned:
    made = sampler.best(prompts, 3, warns=True)
  assert len(warned) == 1 and prompts[2] in str(warned[0].message)
  assert ["unmet" in motion.meta for motion in made] == [False, False, True]
  assert made[2].meta["unmet"] == ["no jump seen", "no kick seen"] and len(made[2].meta["attempts"]) == 3
