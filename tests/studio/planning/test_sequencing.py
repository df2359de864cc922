"""A plan of several actions is one motion in which they are done; a plain one is the motion of its prompt alone."""
import json
import re
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from motion_jax.data.clip import Caption
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.loading import load
from motion_jax.models.keys import keys_of
from motion_jax.models.results import features_of
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax_studio import Pipeline, cli
from motion_jax_studio.language import parse
from motion_jax_studio.planning import assembly, durations, sequencing
from motion_jax_studio.planning.independent import SLACK
from motion_jax_studio.planning.job import Job
from motion_jax_studio.planning.planner import Planner
from motion_jax_studio.planning.standing import standing

FAST = dict(num_steps=3, lag=2)
ARMS = [14, 17, 19, 21, 13, 16, 18, 20]


class Lengths(Planner):
  """A planner that knows how long prompts take, and what clips say."""

  def __init__(self, model=None, frames=lambda prompt: 48, nearest=""):
    super().__init__(model or SimpleNamespace(max_seconds=3600.0))
    self.frames, self.nearest, self.calls = frames, nearest, []

  fps, frames_per_latent = 20.0, 4

  def natural_frames(self, prompt, min_seconds=0.0):
    return self.frames(prompt)

  def nearest_captions(self, prompt, num=1):
    return [(self.nearest, 1)]


class Recorded:
  """A model that passes its calls on, and keeps what was sampled."""

  def __init__(self, model, **changed):
    self._model, self._changed, self.sampled, self.sequenced = model, changed, [], []

  def __getattr__(self, name):
    return self._changed[name] if name in self._changed else getattr(self._model, name)

  def sample(self, prompts, frames, *more):
    self.sampled.append((list(prompts), list(frames)))
    return self._model.sample(prompts, frames, *more)

  def sample_segments(self, lists, *more):
    self.sequenced.append([[prompt for prompt, _ in row] for row in lists])
    return self._model.sample_segments(lists, *more)


@pytest.fixture(scope="module")
def model(tiny_run):
  return load(tiny_run)


@pytest.fixture(scope="module")
def pipeline(model):
  pipeline = Pipeline(model)
  pipeline.warns = False
  return pipeline


def sampled(model, prompts, frames, seed=1, **choices):
  """One pass, cleaned up."""
  return model.generate(prompts, frames, seed=seed, cleanup=True, **FAST | choices)


class TestOfAModel:

  def test_one_action_is_bit_for_bit_one_pass_of_its_prompt(self, model, pipeline):
    made = pipeline("a person walks up and down", 24, seed=3, max_attempts=1, **FAST)
    plain = sampled(model, "a person walks up and down", 24, 3)[0]
    np.testing.assert_array_equal(made.joints, plain.joints)
    names = [row["step"] for row in made.meta["steps"]]
    assert names == ["plan", "sample", "cleanup", "pose", "correct"] and made.meta["steps"][1:3] == plain.meta["steps"]
    assert made.meta | dict(steps=0) == plain.meta | dict(steps=0) and made.captions == plain.captions

  def test_actions_in_sequence_are_a_motion_of_several_prompts(self, model, pipeline):
    prompts = ["a person walks", "a person walks, then waves"]
    both = pipeline(prompts, seconds=[1.2, 3.6], seeds=[1, 2], max_attempts=1, **FAST)
    alone = sampled(model, prompts[0], 24)[0]
    assert np.abs(both[0].joints - alone.joints).max() < 1e-4 and both[0].captions == alone.captions
    _, counts = pipeline.schedule(pipeline.plan(prompts[1]), 72)
    rows = [(f"a person {what}", count / 20) for what, count in zip(("walks", "waves"), counts)]
    whole = model.multi_prompt(rows, seed=2, cleanup=True, ease=True, **FAST)
    assert np.abs(both[1].joints - whole.joints).max() < 1e-4 and both[1].captions == whole.captions
    assert both[1].num_frames == 72 == sum(counts) and both[1].meta["prompt"] == prompts[1]
    assert both[1].meta["understood"].startswith("walks (")
    assert both.joints.shape[:2] == both.frame_mask.shape == (2, 72)
    assert [motion.id for motion in both] == ["motion_0", "motion_1"] and both[1].meta["seed"] == 2

  def test_layers_above_a_held_pose_are_sampled_for_its_time_and_have_its_caption(self, model):
    recorded = Recorded(model)
    made = Pipeline(recorded)("a person sits down and waves", 96, seed=1, max_attempts=1, **FAST)
    assert made.num_frames == 96 and [one.text for one in made.captions] == ["a person sits down", "a person waves"]
    (prompts, frames), counts = recorded.sampled[-1], made.meta["understood"]
    assert prompts == ["a person waves"] and 40 < frames[0] < 80 and counts.startswith("sits down (")
    assert "holds still + waves (" in counts and made.captions[-1].end == 96 / model.fps

  @pytest.mark.slow
  def test_segments_sampled_independently_are_the_same_alone_and_in_a_batch(self, model):
    prompts = ["a person walks, then waves", "a person waves, then walks and then bows"]
    keys = jax.random.split(jax.random.key(4), 2)

    def make(some, model=model):
      planner = Planner(model)
      job = Job(planner, [prompts[i] for i in some], [72] * len(some), keys[np.array(some)], [None] * len(some), FAST,
                [[]] * len(some), cleanup=True, plans=[planner.plan(prompts[i]) for i in some])
      return sequencing.sample(job, independent=True)

    both, alone = make([0, 1]), make([1])[0]
    assert [motion.meta["way"] for motion in both] == ["joined"] * 2 and both[0].num_frames == 72
    assert np.abs(both[1].joints - alone.joints).max() < 1e-4 and both[1].captions == alone.captions
    assert [len(motion.captions) for motion in both] == [2, 3] and both[1].captions[-1].end == 72 / model.fps
    np.testing.assert_allclose(both[1].features, features_of(model, both[1].joints), atol=1e-5)
    # An action that is repeated stays in sequence.
    prompts[0] = "a person walks for a second, then walks for a second"
    assert [motion.meta["way"] for motion in make([0, 1])] == ["stream", "joined"]
    # Nor is a segment longer than the model's motions, whatever else is in the batch.
    prompts[0] = "a person walks, then waves"
    counts = durations.segment_frames(Planner(model), prompts[1], parse(prompts[1]), 72)
    shorter = Recorded(model, max_seconds=(max(counts) + SLACK) / model.fps)
    assert [motion.meta["way"] for motion in make([0, 1], shorter)] == ["stream", "joined"]
    # Of an action above another one as many takes are made, too.
    prompts[0] = "a person walks while waving"
    make([0], recorded := Recorded(model))
    assert recorded.sampled[-1][0] == ["a person waves"] * 3

  def test_simultaneous_actions_share_a_body(self, model, pipeline):
    made = pipeline("a person waves while walking", 36, seed=5, max_attempts=1, **FAST)
    walk = sampled(model, "a person walks", 36, 5)[0]
    rest = [j for j in range(22) if j not in ARMS]
    assert np.abs(made.joints[:, rest] - walk.joints[:, rest]).max() < 1e-5
    assert np.abs(made.joints[:, ARMS] - walk.joints[:, ARMS]).max() > 1e-3
    assert made.captions == (Caption("a person walks and waves"),) and made.features.shape == (36, 263)

  def test_time_left_after_an_action_that_ends_is_a_pause(self, model):
    prompts, planner = ["a man bows", "a person walks"], Lengths(model)

    def make(prompts, frames, plans):
      keys, seeds = keys_of(None, [5, 1][:len(prompts)], len(prompts))
      return sequencing.sample(Job(planner, prompts, [frames] * len(prompts), keys, seeds, FAST, [[]] * len(prompts),
                                   plans=plans))

    bow, walk = make(prompts, 96, [planner.plan(prompt) for prompt in prompts])
    assert [c.text for c in bow.captions] == ["a man bows", "a man stands still"] and bow.num_frames == 96
    first = round(bow.captions[1].start * 20)
    assert 30 < first < 60 and np.abs(bow.joints[first:] - bow.joints[-1]).max() < 1e-6
    assert bow.meta["prompt"] == "a man bows" and "stands still" in bow.meta["understood"]
    assert len(walk.captions) == 1 and "understood" not in walk.meta  # a walk continues
    for frames, plan in ((60, planner.plan("a man bows")), (96, None)):  # too little time is left; no plan
      made, = make(["a man bows"], frames, [plan])
      assert made.captions == (Caption("a man bows"),) and made.num_frames == frames

  @pytest.mark.slow
  def test_the_command_prints_the_plan(self, model, tiny_run, tmp_path, capsys):
    run = ["generate", "a person walks, then waves", "--seconds", "2.4", "--num-steps", "2", "--model", str(tiny_run),
           "--max-attempts", "1", "--out", str(tmp_path / "m.npz")]
    assert cli.main(run) == 0
    said = capsys.readouterr().out
    assert "understood as: walks | waves\n" in said and "1 motion of 2.4 s" in said
    (parts,) = re.findall(r"generated as: walks .(.*) s. . waves .(.*) s.\n", said)
    spans = [(start, end) for _, start, end in json.loads(str(np.load(tmp_path / "m.npz")["captions"]))]
    assert [f"{end - start:.1f}" for start, end in spans] == list(parts)  # as the file has them

  def test_lengths_that_cannot_be(self, pipeline):
    for given, wrong in ((dict(num_frames=4), "got a length of 4 frames for 2 actions"),
                         (dict(seconds=float("nan")), "got a length of nan frames"),
                         (dict(seconds=1e9), "expected 8 to 72,000: 0.4 to 3,600 s"),
                         (dict(num_frames=8, seconds=3), "give one")):
      with pytest.raises(ValueError, match=wrong):
        pipeline("a person walks, then waves", seed=1, **given)
    with pytest.raises(ValueError, match="expected at most 3,600"):
      pipeline("a person jumps 9999 times, then waves", seed=1)


def test_seconds_that_a_sentence_says_are_kept_where_a_length_is_given():
  """The others share what is left; where nothing would be, or all say theirs, all are shared."""
  within = durations.fit_to
  assert within([40, 100, 50], [True, False, False], 130, 4) == [40, 60, 30]
  assert within([40, 100], [True, False], 42, 4) == durations.shared([40, 100], 42, 4)
  assert within([40, 60], [True, True], 50, 4) == [20, 30] and within([40, 60], [False, False], 50, 4) == [20, 30]


def test_lengths_are_shared_in_proportion():
  assert durations.shared([100, 50], 60, 4) == [40, 20]
  assert durations.shared([1, 1, 98], 20, 4) == [4, 4, 12]
  assert durations.shared([100], 60, 4) == [60]


@pytest.mark.parametrize("prompt, then", [
    ("a person sits down", "holds still"), ("a man kneels", "holds still"), ("a person bows", "stands still"),
    ("a person walks", None)])
def test_a_segment_with_more_time_than_it_takes_keeps_its_pose_or_stands(prompt, then):
  plan, counts = durations.with_pauses(Lengths(), [(prompt, 160)])
  assert [part.words for part in plan.segments] == [prompt, *([then] if then else [])] and sum(counts) == 160
  assert not then or plan.segments[1].is_pause and counts[0] == 48


def test_clips_with_as_many_repetitions_give_the_length():
  frames = lambda nearest: durations.usual_frames(
      Lengths(frames=lambda prompt: 130 if "times" in prompt else 60, nearest=nearest),
      parse("a person bows three times"))[0]
  assert [frames(one) for one in ("someone bows three times", "someone bows", "someone bows twice")] == [130, 180, 180]


def test_counted_kicks_and_squats_are_sampled_one_by_one():
  """Each a prompt of its own, together one segment; jumps only where repetitions are sampled independently."""
  repeated = lambda text, count, one_by_one=False: sequencing.repeated(
      parse(text).segments[0].action, count, 4, one_by_one)
  assert repeated("a person kicks twice", 190) == [("a person kicks", 95)] * 2
  assert repeated("someone does three squats", 100) == [("someone squats", 33), ("someone squats", 34),
                                                        ("someone squats", 33)]
  assert repeated("a person jumps twice", 100) == [("a person jumps twice", 100)]
  assert repeated("a person jumps twice", 100, True) == [("a person jumps", 50)] * 2
  assert repeated("a person walks twice", 100, True) == [("a person walks twice", 100)]
  assert repeated("a person kicks twice", 6) == [("a person kicks twice", 6)]  # no time for two
  ends = [2.0, 4.0, 5.0]
  base = SimpleNamespace(num_frames=100, fps=20.0, captions=[
      SimpleNamespace(start=a, end=b) for a, b in zip([0.0, *ends], ends)])
  assert sequencing.spans_of(base, [2, 1]) == [(0, 80), (80, 100)]


def test_counted_kicks_and_squats_take_some_three_seconds():
  """However long their clips are: three at most, and 2.4 at least."""
  planner = Lengths(frames=lambda prompt: 40 if "foot" in prompt else 140)
  frames = lambda text: durations.usual_frames(planner, parse(text))
  assert frames("a person kicks twice") == [120] and frames("someone does three squats") == [180]
  assert frames("a person kicks twice with the left foot") == [96]


def test_no_segment_is_longer_than_the_longest_motion_of_its_model():
  planner = Lengths(SimpleNamespace(max_seconds=9.8), frames=lambda prompt: 140)
  assert durations.usual_frames(planner, parse("a person spins four times, then bows")) == [196, 140]
  given = durations.usual_frames(planner, parse("a person walks for 20 seconds, then bows"))
  assert given == [400, 140]  # which the model refuses


def test_a_way_back_takes_as_long_as_the_way():
  planner = Lengths(frames=lambda prompt: 60 if "turn" in prompt else 140)
  plan = parse("a person walks for 4 seconds, turns around and walks back")
  assert durations.usual_frames(planner, plan) == [80, 60, 80]


def test_postures_take_their_time_and_gestures_three_rounds():
  planner = Lengths(frames=lambda prompt: 140)
  frames = lambda text: durations.usual_frames(planner, standing(parse(text), lambda one: False, lambda one: False))
  assert frames("a person puts the left hand on the hip") == [50] and frames("a person circles the left arm") == [108]


def test_getting_down_into_a_held_pose_takes_its_time():
  planner = Lengths(frames=lambda prompt: 20 if "sits" in prompt else 100)
  frames = lambda text: durations.usual_frames(planner, parse(text))
  assert frames("a person sits down, stays there and gets up") == [56, 40, 100]
  assert frames("a person sits down and waves") == [56, 100] and frames("a person kneels and waves") == [100, 100]
  assert frames("a person walks, then sits down") == [100, 20]
  assert frames("a person sits for 5 seconds, then gets up") == [56, 100, 100]


def test_who_holds_a_pose_holds_it_where_it_is():
  """Seated while sitting, the hand in the air where it is highest; with seconds given it comes down after them."""
  k = np.arange(60)
  joints = np.repeat(synthetic_joints("walk", 60, np.random.default_rng(0))[:1], 60, axis=0)
  joints[:, 20, 1] += 0.8 * np.exp(-((k - 15) / 5) ** 2)
  joints[:, 21, 1] += 0.9 * np.exp(-((k - 45) / 5) ** 2)  # the other hand, which no word names
  shown = lambda text, lengths, spans, arms=(): assembly.assemble(
      joints, (segments := parse(text).segments), spans, lengths, arms or [[]] * len(segments), HUMANML3D)
  for words, last in (("", 0.8), (" for two seconds", 0.0)):
    made, spans = shown(f"a person raises the left hand and holds it up{words}", [60, 40], [(0, 60)])
    (_, first), (start, past) = spans
    assert len(made) == 100 and first == start <= 20
    assert (made[start + 2:past, 20, 1] - joints[0, 20, 1] > 0.75).all() and past - start >= 30
    assert made[-1, 20, 1] - joints[0, 20, 1] == pytest.approx(last, abs=0.06)
  joints[:, :, 1] -= 0.35 * np.clip((k - 20) / 10, 0, 1)[:, None] * np.clip((55 - k) / 10, 0, 1)[:, None]
  made, spans = shown("a person sits down, stays there and stands up", [40, 40, 20], [(0, 40), (40, 60)])
  start, past = spans[1]
  assert len(made) == 100 and (made[start + 2:past - 2, 0, 1] < joints[0, 0, 1] - 0.3).all() and past - start > 30
  assert made[-1, 0, 1] > joints[0, 0, 1] - 0.05
  # Two poses that are kept one behind the other each have their time.
  made, spans = shown("a person sits down, stays there for two seconds, then holds still for one second", [60, 40, 20],
                      [(0, 60)])
  assert len(made) == 120 and spans[-1][1] == 120 and spans[1][1] - spans[1][0] >= 40
  # A body that is low from the first frame on has sat down all the same, and its caption has time.
  joints = joints[30:31].repeat(40, axis=0)
  made, spans = shown("a person sits down and stays there", [40, 40], [(0, 40)])
  assert 0 == spans[0][0] < spans[0][1] == spans[1][0] < spans[1][1] == len(made)


def test_arms_act_above_a_pose_that_is_held():
  k = np.arange(60)
  stands = np.repeat(synthetic_joints("walk", 60, np.random.default_rng(0))[:1], 60, axis=0)
  base, waves = stands[:40].copy(), stands.copy()
  base[:, :, 1] -= 0.35 * (np.clip((k - 5) / 10, 0, 1) * np.clip((35 - k) / 10, 0, 1))[:40, None]  # down and up again
  waves[:, 20, 1] += 0.8 * np.exp(-((k - 15) / 5) ** 2)
  upper = [3, 6, 9, 12, 15, *ARMS]  # leans, and the arm goes up all the same
  lean, hips = rot.about_axis(np.array(0.8), "x")[None, None], base[:, :1]
  base[:, upper] = hips + rot.rotate(lean, base[:, upper] - hips)
  forearm = waves[15, 20] - waves[15, 18]
  highest = forearm[1] / np.linalg.norm(forearm) * np.linalg.norm(base[0, 20] - base[0, 18])
  for words, length in (("", 100), (", then stays there", 140), (" for two seconds", 140)):
    segments = parse(f"a person sits down and raises the left hand{words}").segments
    lengths, arms = [40, 60, 40][:len(segments)], [[(action, waves) for action in one.simultaneous] for one in segments]
    made, spans = assembly.assemble(base, segments, [(0, 40)], lengths, arms, HUMANML3D)
    (_, first), *_, (_, past) = spans
    assert len(made) == length == sum(lengths)
    assert past == length or "seconds" in words and past < length  # the hand comes down behind it
    assert (made[first + 2:, 0, 1] < stands[0, 0, 1] - 0.3).all()
    up = made[:, 20, 1] - made[:, 18, 1]  # of the wrist over the elbow
    assert up[first:].max() == pytest.approx(highest, abs=0.01) and (up[-1] > 0.15) == (", then" in words)
