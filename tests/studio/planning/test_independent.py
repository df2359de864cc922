"""Of independent takes of each segment the best is used, and different ones for two segments of one prompt."""
import jax
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.loading import load
from motion_jax.models.results import Motion
from motion_jax.motion.skeleton import KIT
from motion_jax_studio.checks.violations import violation_score
from motion_jax_studio.language import parse
from motion_jax_studio.language.requirements import exactly_once
from motion_jax_studio.planning import sequencing
from motion_jax_studio.planning.independent import best_takes
from motion_jax_studio.planning.job import Job
from motion_jax_studio.planning.planner import Planner

FAST = dict(num_steps=3, lag=2)
REQUIRED = {prompt: parse(prompt).requirements for prompt in (
    "a person jumps", "a person waves the left hand", "a person walks")}


def _motion(action, seed=0):
  return Motion(synthetic_joints(action, 80, np.random.default_rng(seed)).astype(np.float32), 20.0)


def test_the_part_that_shows_its_action_is_taken_and_of_equals_the_first():
  walk, jump, again, wave = _motion("walk"), _motion("jump"), _motion("jump", 1), _motion("wave_left")
  assert violation_score(again.joints, exactly_once(REQUIRED["a person jumps"])) == 0
  tried = [[walk, jump, again], [walk, wave, walk]]
  found = best_takes(tried, [("a person jumps", 80), ("a person waves the left hand", 80)], REQUIRED, 20.0)
  assert found[0] is jump and found[1] is wave
  assert best_takes([[jump, walk]], [("a person walks", 80)], REQUIRED, 20.0)[0] is jump  # nothing to be seen in words
  assert best_takes([[walk, jump]], [("a person jumps", 80)], REQUIRED, 20.0, KIT)[0] is walk  # a body nobody looks at


def test_of_an_action_done_several_times_each_part_is_another_while_there_are_good_ones():
  walk, jump, again = _motion("walk"), _motion("jump"), _motion("jump", 1)
  twice = [("a person jumps", 80)] * 2
  assert [m is n for m, n in zip(best_takes([[walk, jump], [again, walk]], twice, REQUIRED, 20.0), [jump, again])] == [
      True, True]
  assert all(one is jump for one in best_takes([[walk, jump], [walk, walk]], twice, REQUIRED, 20.0))
  both = Motion(np.concatenate([jump.joints, jump.joints]), 20.0)  # jumps once too often, but not in its own time
  assert best_takes([[walk, both]], [("a person jumps", 80)], REQUIRED, 20.0)[0] is both
  assert best_takes([[both, jump]], [("a person jumps", 160)], REQUIRED, 20.0)[0] is jump


@pytest.fixture(scope="module")
def model(tiny_run):
  return load(tiny_run)


class TestOfAModel:

  @pytest.mark.slow
  def test_a_caption_that_counts_is_split_when_sampled_independently(self, model):
    """Known words are one prompt; where they do not show it, every repetition is sampled by itself."""
    keys, planner = jax.random.split(jax.random.key(3), 1), Planner(model)

    def made(prompt, independent):
      plan = parse(prompt, lambda text: True)
      job = Job(planner, [prompt], [60], keys, [None], FAST, [[]], cleanup=True, plans=[plan])
      return sequencing.sample(job, independent)[0]

    assert made("a person jumps twice", False).meta.get("way") == made("a person walks twice", True).meta.get("way")
    split = made("a person jumps twice", True)
    assert split.meta["way"] == "joined" and [one.text for one in split.captions] == ["a person jumps twice"]
