"""Of what is made of each action apart the one that shows it best is taken, of one done twice two different ones."""
import jax
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.loading import load
from motion_jax.models.results import Motion
from motion_jax.motion.skeleton import KIT
from motion_studio.checks import requirements as looking
from motion_studio.planning import independent as apart
from motion_studio.planning import sequencing as composed

FAST = dict(num_steps=3, lag=2)


def _motion(action, seed=0):
  return Motion(synthetic_joints(action, 80, np.random.default_rng(seed)).astype(np.float32), 20.0)


def test_the_part_that_shows_its_action_is_taken_and_of_equals_the_first():
  walk, jump, again, wave = _motion("walk"), _motion("jump"), _motion("jump", 1), _motion("wave_left")
  assert looking.violation_score(again.joints, looking.once(looking.requirements_of("a person jumps"))) == 0
  tried = [[walk, jump, again], [walk, wave, walk]]
  found = apart.best_parts(tried, [("a person jumps", 80), ("a person waves the left hand", 80)], 20.0)
  assert found[0] is jump and found[1] is wave
  assert apart.best_parts([[jump, walk]], [("a person walks", 80)], 20.0)[0] is jump  # nothing to be seen in words
  assert apart.best_parts([[walk, jump]], [("a person jumps", 80)], 20.0, KIT)[0] is walk  # a body nobody looks at


def test_of_an_action_done_several_times_each_part_is_another_while_there_are_good_ones():
  walk, jump, again = _motion("walk"), _motion("jump"), _motion("jump", 1)
  twice = [("a person jumps", 80)] * 2
  assert [m is n for m, n in zip(apart.best_parts([[walk, jump], [again, walk]], twice, 20.0), [jump, again])] == [
      True, True]
  assert all(one is jump for one in apart.best_parts([[walk, jump], [walk, walk]], twice, 20.0))
  both = Motion(np.concatenate([jump.joints, jump.joints]), 20.0)  # jumps once too often, but not in its own time
  assert apart.best_parts([[walk, both]], [("a person jumps", 80)], 20.0)[0] is both
  assert apart.best_parts([[both, jump]], [("a person jumps", 160)], 20.0)[0] is jump


@pytest.fixture(scope="module")
def model(tiny_run):
  return load(tiny_run)


@pytest.mark.filterwarnings("ignore:the model does not know")
class TestOfAModel:

  def test_a_single_try_is_what_the_first_of_several_is(self, model, monkeypatch):
    lists, keys = [[("a person kicks", 24), ("a person bows", 24)]], jax.random.split(jax.random.key(3), 1)
    make = lambda tries: apart.made_apart(model, lists, keys, [None], True, FAST, tries=tries)[0].joints
    monkeypatch.setattr(apart, "best_parts", lambda tried, *_: [own[0] for own in tried])
    np.testing.assert_allclose(make(1), make(3), atol=1e-4)
    monkeypatch.setattr(apart, "best_parts", lambda tried, *_: [own[-1] for own in tried])
    assert np.abs(make(1) - make(3)).max() > 1e-2

  def test_what_a_caption_of_training_counts_is_parted_when_it_is_made_apart(self, model, monkeypatch):
    """Known words go to the network as they are; where they do not do it, each is made by itself."""
    monkeypatch.setattr(type(model), "understand", lambda self, prompt: composed.understand(prompt, lambda text: True))
    keys = jax.random.split(jax.random.key(3), 1)
    made = lambda prompt, apart: composed._generated(model, [prompt], 60, None, keys, [None], True, False, FAST,
                                                     apart=apart)[0]
    assert made("a person jumps twice", False).meta.get("way") == made("a person walks twice", True).meta.get("way")
    parted = made("a person jumps twice", True)
    assert parted.meta["way"] == "joined" and [one.text for one in parted.captions] == ["a person jumps twice"]
