"""Plans in streams, timelines and continued motions, sampled in one run; pauses, and prompts that wait."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.loading import load
from motion_jax_studio import Pipeline
from motion_jax_studio.language import parse
from motion_jax_studio.planning.segments import prompts_in_sequence
from tests.models.cmdm.test_multi_prompt import shaken
from tests.studio.planning.test_sequencing import Lengths

FAST = dict(num_steps=6, lag=2)


@pytest.fixture(scope="module")
def model(tiny_run):
  return shaken(load(tiny_run))


def pipeline_of(model, frames=None):
  """A pipeline; frames: the usual length of every prompt."""
  pipeline = Pipeline(model)
  pipeline.warns = False
  if frames is not None:
    pipeline.planner = Lengths(model, lambda prompt: frames)
  return pipeline


def test_a_plan_is_said_action_by_action(model):
  """Live and in a timeline: the actions of the plan, each for its usual time."""
  prompt, pipeline = "a person walks, then waves", pipeline_of(model, 60)
  stream = pipeline.stream(prompt, seed=2, cleanup=False, **FAST)
  assert stream.script == [(0, "a person walks"), (60, "a person waves")] and stream.num_frames is None
  assert len(next(stream)) == len(next(stream)) == 12
  first = stream.say("a person jumps, then stands still")  # replaces what waits
  assert first <= 60 and [text for _, text in stream.script] == [
      "a person walks", "a person jumps", "a person stands still"]
  assert pipeline.stream(prompt, seed=2, plan=False, **FAST).script == [(0, prompt)]
  both = pipeline.multi_prompt([(prompt, 4.8), ("a person runs", 1.2)], seed=2, cleanup=False, **FAST)
  assert [one.text for one in both.captions] == ["a person walks", "a person waves", "a person runs"]
  assert both.num_frames == 120 and both.captions[-1].start == 4.8 and 1 < both.captions[1].start < 4


@pytest.mark.slow
def test_a_motion_is_continued_action_by_action(model):
  walk = synthetic_clips(0, 1, num_frames=50)[0]
  longer = pipeline_of(model).extend(walk, "a person waves, then sits down", seconds=3, seed=1, **FAST)
  np.testing.assert_array_equal(longer.joints[:50], walk.joints)
  assert [one.text for one in longer.captions[-2:]] == ["a person waves", "a person sits down"]
  assert longer.num_frames == 110


def test_actions_share_their_time_and_simultaneous_ones_a_prompt(model):
  for prompt, total, prompts in (
      ("someone walks forward, then sits down", 100, ["someone walks forward", "someone sits down"]),
      ("a man walks while waving, then sits down", 100, ["a man walks and waves", "a man sits down"]),
      ("she sits down, stays there and waves", 100, ["she sits down", "she sits down and waves"]),
      ("a person walks while waving", 100, ["a person walks while waving"]),
      ("someone takes two bows", 100, ["someone bows twice"]),
      ("a person walks, then waves", 24, ["a person walks", "a person waves"]),
      ("a person walks, then waves", 23, ["a person walks, then waves"])):  # no time for both
    rows = prompts_in_sequence(Lengths(model, lambda prompt: 60), parse(prompt), total)
    assert [text for text, _ in rows] == prompts and sum(count for _, count in rows) == total, prompt


@pytest.mark.parametrize("prompt, rows", [
    ("a person sits down", [("a person sits down", 60), ("a person is sitting on a chair", None)]),
    ("someone walks, then lies down", [("someone walks", 60), ("someone lies down", 60),
                                       ("someone is lying on the floor", None)]),
    ("Kneel!", [("Kneel!", 60), ("a person is down on the knees", None)]),
    ("she sits down, stays there and waves", [
        ("she sits down", 60), ("she is sitting on a chair", 40), ("she is sitting on a chair and waves", 60)]),
    ("a man sits down, stays seated, then stands up", [
        ("a man sits down", 60), ("a man is sitting on a chair", 40), ("a man stands up", 60)]),
    ("a person sits on the floor", [("a person sits on the floor", None)]),
    ("a person walks", [("a person walks", None)])])
def test_a_stream_holds_a_low_pose_by_a_prompt_of_the_pose(model, monkeypatch, prompt, rows):
  monkeypatch.setattr(type(model.captions), "unknown_words", lambda captions, text: [])
  planner = Lengths(model, lambda prompt: 60)
  in_sequence = prompts_in_sequence(planner, parse(prompt), is_endless=True)
  assert [text for text, _ in in_sequence] == [text for text, _ in rows] and in_sequence[-1][1] == rows[-1][1]
  monkeypatch.setattr(type(model.captions), "unknown_words", lambda captions, text: ["chair"])
  assert all(" is " not in text for text, _ in prompts_in_sequence(planner, parse(prompt), is_endless=True))


def test_pauses_and_prompts_that_wait(model):
  pipeline, prompts = pipeline_of(model, 36), [("a person bows", 3.6), ("a person walks", 1.2)]
  plain, rest = (pipeline.multi_prompt(prompts, seed=5, rest=rest, **FAST) for rest in (False, True))
  assert plain.num_frames == rest.num_frames == 96
  assert [c.text for c in rest.captions] == ["a person bows", "a person stands still", "a person walks"]
  assert plain.captions[-1].start == 3.6 and abs(rest.captions[-1].start - 3.6) < 0.45  # where it stands best
  held = pipeline.multi_prompt([("a person kicks", 0.6), ("a person walks", 1.2)], seed=5, hold_until_done=True, **FAST)
  assert [c.start for c in held.captions] == [0.0, 1.8]

  def streamed(prompt, after, **choices):
    stream = pipeline.stream(prompt, seed=0, num_frames=60, cleanup=False, **FAST, **choices)
    first = next(stream)
    stream.say("a person sits", after)
    return np.concatenate([first, *stream])

  waits, later = streamed("a person bows", 0.6, hold_until_done=True), streamed("a person bows", 1.2)
  np.testing.assert_array_equal(waits, later)  # a block was returned already
  fork = pipeline.stream("a person bows", seed=0, hold_until_done=True, **FAST).fork()
  fork.say("a person jumps, then waves")
  assert [text for _, text in fork.script][1:] == ["a person jumps", "a person waves"] and fork.script[1][0] == 36
  np.testing.assert_array_equal(streamed("a person walks", 0.6, hold_until_done=True), streamed("a person walks", 0.6))
  assert np.abs(waits - streamed("a person bows", 0.6)).max() > 1e-4


@pytest.mark.slow
def test_prompts_that_are_sampled_independently_and_joined(model):
  """Each ends up to 14 frames from where it should."""
  pipeline, prompts = pipeline_of(model), [("a person walks", 2.0), ("a person waves", 1.0), ("a person walks", 1.5)]
  made = pipeline.multi_prompt(prompts, seed=5, way="joined", **FAST)
  assert made.num_frames == 90 and made.meta["way"] == "joined"
  assert [caption.text for caption in made.captions] == [prompt for prompt, _ in prompts]
  for caption, start in zip(made.captions[1:], (2.0, 3.0)):
    assert abs(caption.start - start) <= 0.75
  assert pipeline.multi_prompt(prompts, seed=5, **FAST).meta["way"] == "stream"
  with pytest.raises(ValueError, match="got way 'apart', .* knows stream, chain, joined"):
    pipeline.multi_prompt(prompts, way="apart")
