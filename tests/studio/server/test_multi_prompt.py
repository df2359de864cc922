"""A story is sampled again from where it changed, and what stands before is the same bit for bit."""
import numpy as np
import pytest

from motion_jax.motion.cleanup import LOOK_AHEAD
from motion_jax_studio.server.multi_prompt import MultiPromptCache

WALK, WAVE, JUMP = "a person walks", "a person waves", "a person jumps"


@pytest.fixture(scope="module")
def pipeline(library):
  return library.pipeline("tiny", "multi_prompt")


def lag_of(pipeline):
  """The studio's own: two steps of the sampler for each block, one block under way."""
  return pipeline.model.sampling().num_steps // 2


def make(stories, pipeline, segments, cleanup=False, seed=5, lag=None):
  return stories.make(pipeline, segments, seed, cleanup, {"lag": lag or lag_of(pipeline)})


def test_a_story_is_the_models_multi_prompt(pipeline):
  segments = [(WALK, 50), (WAVE, 40), (JUMP, 30)]
  made, reused, _ = make(MultiPromptCache(), pipeline, segments)
  rows = [(prompt, frames / pipeline.model.fps) for prompt, frames in segments]
  asked = pipeline.multi_prompt(rows, seed=5, cleanup=False, lag=lag_of(pipeline))
  assert made.captions == asked.captions and reused == 0 and made.joints.shape == asked.joints.shape
  assert np.abs(made.joints - asked.joints).max() < 1e-3
  assert made.meta["seed"] == 5 and made.meta["model"] == pipeline.model.id


@pytest.mark.parametrize("changed, border, cleanup", [
    ([(WALK, 60), (JUMP, 60), (JUMP, 60)], 60, True),         # words in the middle
    ([(WALK, 60), (WAVE, 84), (JUMP, 60)], 120, False),       # a length: what came behind comes later
    ([(WALK, 60), (WAVE, 60), (JUMP, 60), (WALK, 40)], 180, True)])  # one more
def test_what_stands_before_a_change_is_the_same_bit_for_bit(pipeline, changed, border, cleanup):
  """And the rest is what a studio makes that never saw the story before."""
  stories = MultiPromptCache()
  first, _, _ = make(stories, pipeline, [(WALK, 60), (WAVE, 60), (JUMP, 60)], cleanup)
  second, reused, same = make(stories, pipeline, changed, cleanup)
  fresh, _, _ = make(MultiPromptCache(), pipeline, changed, cleanup)
  assert (second.joints == fresh.joints).all() and second.num_frames == sum(frames for _, frames in changed)
  kept = max(border - (LOOK_AHEAD if cleanup else 0), 0)
  assert (second.joints[:kept] == first.joints[:kept]).all() and same >= kept
  shared = min(first.num_frames, second.num_frames)
  if shared > border:  # and what stands behind it is another motion, so that the words did change something
    assert np.abs(second.joints[border:shared] - first.joints[border:shared]).max() > 1e-3
  assert reused <= border and (reused > 0) == (border > 24)
  again, all_of_it, _ = make(stories, pipeline, changed, cleanup)
  assert (again.joints == second.joints).all() and all_of_it >= reused


def test_other_seeds_choices_and_old_takes_are_kept_apart(pipeline):
  stories, story = MultiPromptCache(), [(WALK, 60), (WAVE, 24)]
  make(stories, pipeline, story)
  for other in ({"seed": 6}, {"cleanup": True}, {"lag": 2}):
    assert make(stories, pipeline, story, **other)[1] == 0, other
  assert make(stories, pipeline, story)[1] > 0
  for seed in range(7, 13):
    make(stories, pipeline, [(WALK, 24)], seed=seed)
  assert len(stories._takes) == 6
  stories = MultiPromptCache(max_copies=1)
  make(stories, pipeline, [(WALK, 24)], seed=12)
  make(stories, pipeline, [(WALK, 24), (WAVE, 24)], seed=13)
  assert len(stories._takes) == 1


@pytest.mark.slow
def test_a_stream_shows_its_next_seconds(pipeline):
  """In a notebook: the viewer of any motion, with the words that were said; asked again, the seconds after."""
  live, plain = (pipeline.stream(WALK, seed=1, lag=lag_of(pipeline)) for _ in range(2))
  first = live.show(2)
  assert live.say(JUMP) == live.begun
  second = live.show(3)
  frames = np.concatenate([next(plain) for _ in range(9)])
  assert first.num_frames >= 40 and (first.joints == frames[:first.num_frames]).all()
  assert [caption.text for caption in first.captions] == [WALK]
  assert [caption.text for caption in second.captions] == [WALK, JUMP]
  border, again = second.captions[0].end * 20, frames[first.num_frames:]
  same = int(border) - LOOK_AHEAD
  assert same > 0 and (second.joints[:same] == again[:same]).all() and second.captions[1].end * 20 == second.num_frames
  assert "<iframe" in first._repr_html_() and "\x00" not in first._repr_html_()
  ends = pipeline.stream(WALK, seed=1, lag=lag_of(pipeline), num_frames=24)
  assert ends.show(60).num_frames == 24
  with pytest.raises(ValueError, match="has ended"):
    ends.show()
