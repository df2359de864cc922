"""A sentence of several actions is one motion in which they are done; one action is what it was."""
import json
import re
from types import SimpleNamespace

import jax
import numpy as np
import pytest

from motion_jax.data.clip import Caption
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.loading import load
from motion_jax.models.results import features_of
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D
from motion_studio import cli
from motion_studio.language.sentences import understand
from motion_studio.planning import independent as apart
from motion_studio.planning import sequencing as composed

pytestmark = pytest.mark.filterwarnings("ignore:. attempts, ")
FAST = dict(num_steps=3, lag=2)
ARMS = [14, 17, 19, 21, 13, 16, 18, 20]


@pytest.fixture(scope="module")
def model(tiny_run):
  return load(tiny_run)


@pytest.mark.filterwarnings("ignore:the model does not know")
class TestComposed:

  def test_one_action_is_bit_for_bit_what_its_words_alone_are(self, model):
    for prompt in ("a person walks", "a person walks up and down"):
      one, literal = (model.generate(prompt, 24, seeds=[3], literal=literal, **FAST) for literal in (False, True))
      np.testing.assert_array_equal(one.features, literal.features)
      assert one[0].meta == literal[0].meta

  def test_actions_in_a_row_are_a_motion_of_several_prompts(self, model):
    prompts = ["a person walks", "a person walks, then waves"]
    both = model.generate(prompts, seconds=[1.2, 3.6], seeds=[1, 2], **FAST)
    alone = model.generate(prompts[0], 24, seeds=[1], **FAST)[0]
    assert np.abs(both[0].joints - alone.joints).max() < 1e-4 and both[0].captions == alone.captions
    counts = composed.lengths_of(model, prompts[1:], [model.understand(prompts[1])], 72, None)[0]
    said = [(f"a person {what}", count / 20) for what, count in zip(("walks", "waves"), counts)]
    tour = model.multi_prompt(said, seed=2, ease=True, **FAST)
    assert np.abs(both[1].joints - tour.joints).max() < 1e-4 and both[1].captions == tour.captions
    assert both[1].num_frames == 72 == sum(counts) and both[1].meta["prompt"] == prompts[1]
    assert both[1].meta["understood"].startswith("walks (")
    assert both.joints.shape[:2] == both.frame_mask.shape == (2, 72)
    assert [motion.id for motion in both] == ["motion_0", "motion_1"] and both[1].meta["seed"] == 2

  def test_what_arms_do_above_a_held_pose_is_made_for_its_time_and_has_its_caption(self, model, monkeypatch):
    asked, sample = [], model.sample
    monkeypatch.setattr(model, "sample", lambda prompts, frames, *rest: asked.append((prompts, frames)) or sample(
        prompts, frames, *rest))
    made = model.generate("a person sits down and waves", 96, seeds=[1], **FAST)[0]
    assert made.num_frames == 96 and [one.text for one in made.captions] == ["a person sits down", "a person waves"]
    (prompts, frames), counts = asked[-1], made.meta["understood"]
    assert prompts == ["a person waves"] and 40 < frames[0] < 80 and counts.startswith("sits down (")
    assert "holds still + waves (" in counts and made.captions[-1].end == 96 / model.fps

  def test_actions_made_apart_are_joined_the_same_alone_and_in_a_batch(self, model, monkeypatch):
    prompts = ["a person walks, then waves", "a person waves, then walks and then bows"]
    keys = jax.random.split(jax.random.key(4), 2)
    make = lambda some: composed._generated(model, [prompts[i] for i in some], 72, None, keys[np.array(some)],
                                            [None] * len(some), True, False, FAST, apart=True)
    both, alone = make([0, 1]), make([1])[0]
    assert [motion.meta["way"] for motion in both] == ["joined"] * 2 and both.joints.shape[1] == 72
    assert np.abs(both[1].joints - alone.joints).max() < 1e-4 and both[1].captions == alone.captions
    assert [len(motion.captions) for motion in both] == [2, 3] and both[1].captions[-1].end == 72 / model.fps
    np.testing.assert_allclose(both[1].features, features_of(model, both[1].joints), atol=1e-5)
    # One action after itself stays in a row, but for one that is done so many times.
    for prompt, way in (("a person walks, then walks slowly", "joined"), ("a person kicks twice", "joined"),
                        ("a person walks for a second, then walks for a second", "stream")):
      prompts[0] = prompt
      assert [motion.meta["way"] for motion in make([0, 1])] == [way, "joined"], prompt
    # A part that would be longer than the model makes any is not made apart, whatever the others of the batch are.
    prompts[0] = "a person walks, then waves"
    monkeypatch.setattr(type(model), "max_seconds", (max(composed.lengths_of(
        model, prompts[1:], [model.understand(prompts[1])], 72, None)[0]) + apart.SLACK) / model.fps)
    assert [motion.meta["way"] for motion in make([0, 1])] == ["stream", "joined"]

  @pytest.mark.slow
  def test_a_key_is_folded_with_the_place_of_each_prompt(self, model):
    prompts = ["a person walks, then waves", "a person waves"]
    made = model.generate(prompts, 36, rng=jax.random.key(4), **FAST)
    literal = model.generate(prompts, 36, rng=jax.random.key(4), literal=True, **FAST)
    assert np.abs(made[1].joints - literal[1].joints).max() < 1e-4
    assert len(made[0].captions) == 2 and literal[0].captions == (Caption(prompts[0]),)
    assert "understood" in made[0].meta and "understood" not in literal[0].meta

  def test_two_actions_at_once_share_a_body(self, model):
    made = model.generate("a person waves while walking", 36, seeds=[5], **FAST)[0]
    walk = model.generate("a person walks", 36, seeds=[5], **FAST)[0]
    rest = [j for j in range(22) if j not in ARMS]
    assert np.abs(made.joints[:, rest] - walk.joints[:, rest]).max() < 1e-5
    assert np.abs(made.joints[:, ARMS] - walk.joints[:, ARMS]).max() > 1e-3
    assert made.captions == (Caption("a person walks and waves"),) and made.features.shape == (36, 263)

  def test_who_stops_stands_still(self, model):
    made = model.generate("a person walks for two seconds, then stops", seeds=[5], **FAST)[0]
    assert made.num_frames == 80 and [c.text for c in made.captions] == ["a person walks", "a person stands still"]
    first = round(made.captions[1].start * 20)
    assert 10 < first < 50 and np.abs(made.joints[first:] - made.joints[-1]).max() < 1e-6

  def test_an_action_that_is_over_ends_in_standing_still(self, model, monkeypatch):
    monkeypatch.setattr(model, "natural_frames", lambda prompt: 48)
    bow, walk = model.generate(["a man bows", "a person walks"], 96, seeds=[5, 1], **FAST)
    assert [c.text for c in bow.captions] == ["a man bows", "a man stands still"] and bow.num_frames == 96
    first = round(bow.captions[1].start * 20)
    assert 30 < first < 60 and np.abs(bow.joints[first:] - bow.joints[-1]).max() < 1e-6
    assert bow.meta["prompt"] == "a man bows" and "stands still" in bow.meta["understood"]
    assert len(walk.captions) == 1 and "understood" not in walk.meta  # who walks goes on
    for frames, literal in ((60, False), (96, True)):  # too little time is left; said to the model as it is
      made = model.generate("a man bows", frames, seeds=[5], literal=literal, **FAST)[0]
      assert made.captions == (Caption("a man bows"),) and made.num_frames == frames

  def test_how_often_is_said_to_the_model(self, model, monkeypatch):
    said, real = [], model.in_a_row
    monkeypatch.setattr(model, "in_a_row", lambda lists, *more, **how: said.append(lists) or real(lists, *more, **how))
    made = model.generate("a person walks, then bows twice", 48, seeds=[5], **FAST)[0]
    assert [[prompt for prompt, _ in row] for row in said[0]] == [["a person walks", "a person bows twice"]]
    assert made.captions[1].text == "a person bows twice"

  def test_what_clips_show_so_often_takes_as_long_as_they_do(self, model, monkeypatch):
    monkeypatch.setattr(model, "natural_frames", lambda prompt: 130 if "times" in prompt else 60)
    frames = lambda text: composed.usual_frames(model, model.understand(text))[0]
    for nearest, expected in (("someone bows three times", 130), ("someone bows", 180), ("someone bows twice", 180)):
      monkeypatch.setattr(model, "nearest_captions", lambda prompt, num=1, nearest=nearest: [(nearest, 1)])
      assert frames("a person bows three times") == expected

  def test_the_command_says_what_it_understood(self, model, tiny_run, tmp_path, capsys):
    run = ["generate", "a person walks, then waves", "--seconds", "2.4", "--num-steps", "2", "--model", str(tiny_run),
           "--out", str(tmp_path / "m.npz")]
    assert cli.main(run) == 0
    said = capsys.readouterr().out
    assert "understood as: walks | waves\n" in said and "1 motion of 2.4 s" in said
    (parts,) = re.findall(r"made as: walks .(.*) s. . waves .(.*) s.\n", said)
    spans = [(start, end) for _, start, end in json.loads(str(np.load(tmp_path / "m.npz")["captions"]))]
    assert [f"{end - start:.1f}" for start, end in spans] == list(parts)  # as the file has them
    assert cli.main([*run, "--no-plan"]) == 0
    assert "understood" not in capsys.readouterr().out

  def test_lengths_that_cannot_be(self, model):
    for given, wrong in ((dict(num_frames=4), "got a length of 4 frames for 2 actions"),
                         (dict(seconds=float("nan")), "got a length of nan frames"),
                         (dict(seconds=1e9), "expected 8 to 72000"), (dict(num_frames=8, seconds=3), "give one")):
      with pytest.raises(ValueError, match=wrong):
        model.generate("a person walks, then waves", seeds=[1], **given)
    with pytest.raises(ValueError, match="expected at most 3,600"):
      model.generate("a person jumps 9999 times, then waves", seeds=[1])


def test_seconds_that_a_sentence_says_are_kept_where_a_length_is_asked():
  """The others share what is left; where nothing would be, or all say theirs, all are shared."""
  within = composed._within
  assert within([40, 100, 50], [True, False, False], 130, 4) == [40, 60, 30]
  assert within([40, 100], [True, False], 42, 4) == composed.shared([40, 100], 42, 4)
  assert within([40, 60], [True, True], 50, 4) == [20, 30] and within([40, 60], [False, False], 50, 4) == [20, 30]


def test_lengths_are_shared_in_proportion():
  assert composed.shared([100, 50], 60, 4) == [40, 20]
  assert composed.shared([1, 1, 98], 20, 4) == [4, 4, 12]
  assert composed.shared([100], 60, 4) == [60]


def test_kicks_and_squats_that_are_counted_are_made_one_by_one():
  """Each a prompt of its own, and one segment together; jumps are counted in words, but where each is made apart."""
  model = SimpleNamespace(frames_per_latent=4, fps=20.0)
  rounds = lambda text, count, apart=False: composed._rounds(model, understand(text).segments[0].action, count, apart)
  assert rounds("a person kicks twice", 190) == [("a person kicks", 95)] * 2
  assert rounds("someone does three squats", 100) == [("someone squats", 33), ("someone squats", 34),
                                                      ("someone squats", 33)]
  assert rounds("a person jumps twice", 100) == [("a person jumps twice", 100)]
  assert rounds("a person jumps twice", 100, apart=True) == [("a person jumps", 50)] * 2
  assert rounds("a person walks twice", 100, apart=True) == [("a person walks twice", 100)]
  assert rounds("a person kicks twice", 6) == [("a person kicks twice", 6)]  # no time for two
  ends = [2.0, 4.0, 5.0]
  base = SimpleNamespace(num_frames=100, captions=[SimpleNamespace(start=a, end=b) for a, b in zip([0.0, *ends], ends)])
  assert composed._spans(model, base, [2, 1]) == [(0, 80), (80, 100)]


def test_kicks_and_squats_that_are_counted_take_some_three_seconds():
  """However long their own clips are: three at the most, and 2.4 at the least."""
  model = SimpleNamespace(frames_per_latent=4, fps=20.0, natural_frames=lambda prompt: 40 if "foot" in prompt else 140)
  frames = lambda text: composed.usual_frames(model, understand(text))
  assert frames("a person kicks twice") == [120] and frames("someone does three squats") == [180]
  assert frames("a person kicks twice with the left foot") == [96]


def test_who_stays_down_has_time_to_get_there():
  model = SimpleNamespace(frames_per_latent=4, fps=20.0, natural_frames=lambda prompt: 20 if "sits" in prompt else 100)
  frames = lambda text: composed.usual_frames(model, understand(text))
  assert frames("a person sits down, stays there and gets up") == [56, 40, 100]
  assert frames("a person sits down and waves") == [56, 100] and frames("a person kneels and waves") == [100, 100]
  assert frames("a person walks, then sits down") == [100, 20]
  assert frames("a person sits for 5 seconds, then gets up") == [56, 100, 100]


def test_who_holds_a_pose_holds_it_where_it_is():
  """Seated while sitting, the hand in the air where it is highest; said for so many seconds, it comes down then."""
  k = np.arange(60)
  joints = np.repeat(synthetic_joints("walk", 60, np.random.default_rng(0))[:1], 60, axis=0)
  joints[:, 20, 1] += 0.8 * np.exp(-((k - 15) / 5) ** 2)
  shown = lambda text, lengths, spans, arms=(): composed._put_together(
      joints, (segments := understand(text).segments), spans, lengths, arms or [[]] * len(segments), HUMANML3D)
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


def test_arms_act_above_a_pose_that_is_held_and_nobody_gets_up_for_it():
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
    segments = understand(f"a person sits down and raises the left hand{words}").segments
    lengths, arms = [40, 60, 40][:len(segments)], [[(action, waves) for action in one.also] for one in segments]
    made, spans = composed._put_together(base, segments, [(0, 40)], lengths, arms, HUMANML3D)
    (_, first), *_, (_, past) = spans
    assert len(made) == length == sum(lengths)
    assert past == length or "seconds" in words and past < length  # the hand comes down behind it
    assert (made[first + 2:, 0, 1] < stands[0, 0, 1] - 0.3).all()
    up = made[:, 20, 1] - made[:, 18, 1]  # of the wrist over the elbow
    assert up[first:].max() == pytest.approx(highest, abs=0.01) and (up[-1] > 0.15) == (", then" in words)
