"""Several prompts in one motion, offline and live, and motions that go on from a given one."""
import jax
import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.data.mirror import mirror_legs
from motion_jax.loading import load
from motion_jax.models.results import features_of
from motion_jax.models.shared.script import borders
from motion_jax.motion import rotations as rot
from motion_jax.motion.blending import laid_over
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax_studio.cli.prompts import read_sequences

FAST = dict(num_steps=6, lag=2)
PROMPTS = [("a person walks", 1.2), ("a person waves", 1.3), ("a person sits", 0.7)]


@pytest.fixture(scope="module")
def model(tiny_run):
  return shaken(load(tiny_run))


def shaken(model):
  """The same model with random weights: gates that begin at 0 would let any mistake pass."""
  leaves, tree = jax.tree.flatten(model.params)
  keys = jax.random.split(jax.random.key(3), len(leaves))
  model.params = tree.unflatten([a + 0.2 * jax.random.normal(key, a.shape) for key, a in zip(keys, leaves)])
  return model


@pytest.fixture(scope="module")
def walk():
  return synthetic_clips(0, 1, num_frames=50)[0]


def test_borders_are_on_blocks_and_the_end_is_as_asked():
  assert borders([24, 26, 14], 12) == ([2, 2, 2], 64)  # ends at 24, 50 (nearest: 48), 64 (cut from 72)
  assert borders([4, 4, 40], 12) == ([1, 1, 2], 48)    # no segment is shorter than a block
  assert borders([4, 4, 4], 12) == ([1, 1, 1], 36)
  assert borders([100], 12) == ([9], 100)
  assert borders([40, 60], 40) == ([1, 2], 100) and borders([10, 10], 40) == ([1, 1], 80)


@pytest.mark.slow
def test_several_prompts_are_one_motion_and_a_stream_says_the_same(model):
  whole = model.multi_prompt(PROMPTS, seed=2, **FAST)
  assert whole.num_frames == 64 and whole.features.shape == (64, 263)
  assert whole.captions == (Caption("a person walks", 0.0, 1.2), Caption("a person waves", 1.2, 2.4),
                            Caption("a person sits", 2.4, 3.2))
  assert whole.meta["way"] == "stream" and whole.meta["seed"] == 2
  stream = model.stream("a person walks", seed=2, num_frames=64, **FAST)
  stream.say("a person waves", after=1.2)
  stream.say("a person sits", after=2.4)
  assert np.abs(np.concatenate(list(stream)) - whole.joints).max() < 1e-4
  # More prompts than a window has places for.
  short = [(f"a person {word}", 0.6) for word in ("walks", "waves", "sits", "runs", "jumps", "turns")]
  stream = model.stream("a person walks", seed=2, num_frames=72, **FAST)
  for block, (prompt, _) in enumerate(short):
    stream.say(prompt, after=0.6 * block)
  assert np.abs(np.concatenate(list(stream)) - model.multi_prompt(short, seed=2, **FAST).joints).max() < 1e-4
  other = model.multi_prompt([PROMPTS[0], ("a person runs", 1.3), PROMPTS[2]], seed=2, **FAST).joints
  assert np.abs(other[:24] - whole.joints[:24]).max() < 1e-5  # what comes later is not known before
  assert np.abs(other[24:50] - whole.joints[24:50]).max() > 1e-4


@pytest.mark.slow
def test_without_memory_the_words_before_are_forgotten(model):
  """Far behind the border, where the decoder has forgotten them too, it is the same motion whatever came before; also
  where all latents are cleaned together. test_streaming.py has the memory of frame-wise sampling."""
  walks, runs = (model.multi_prompt([(first, 1.2), ("a person waves", 6.0)], seed=2, num_steps=6, schedule="full",
                                    memory=0).features for first in ("a person walks", "a person runs"))
  assert np.abs(walks[-24:] - runs[-24:]).max() < 1e-5 and np.abs(walks[:24] - runs[:24]).max() > 1e-4


@pytest.mark.slow
def test_one_level_makes_long_motions_in_windows_of_training(model, monkeypatch):
  """Of 48 latents, the first half of each known: no latent has a place or a neighbour that training did not show."""
  lengths, segment = [], model.compiled.chain_segment
  watched = lambda plan, length, *args, **given: lengths.append((length, given["past"].shape[1])) or segment(
      plan, length, *args, **given)
  monkeypatch.setattr(model, "compiled", model.compiled._replace(chain_segment=watched))
  story = [("a person walks", 5.0), ("a person waves", 6.0), ("a person sits", 4.0)]
  make = lambda seeds, *stories: model.multi_prompts(stories, seeds=seeds, num_steps=4, schedule="full")
  alone = make([2], story)[0]
  assert lengths == [(48, 0), (48, 24), (48, 24)] and alone.num_frames == 300
  both = make([1, 2], [("a person runs", 10.0)], story)
  assert np.abs(both[1].joints - alone.joints).max() < 1e-4
  other = make([2], [*story[:2], ("a person runs", 4.0)])[0].joints
  assert np.abs(other[-70:] - alone.joints[-70:]).max() > 1e-4 and np.abs(other[:190] - alone.joints[:190]).max() < 1e-5
  with pytest.raises(ValueError, match="goes with euler alone"):
    model.multi_prompt(story, seed=0, num_steps=4, schedule="full", solver="heun")


@pytest.mark.slow
def test_a_motion_of_several_prompts_does_not_know_its_batch_mates(model):
  alone = model.multi_prompt(PROMPTS, seed=5, **FAST)
  both = model.multi_prompts([[("a person runs", 4.0)], PROMPTS], seeds=[1, 5], **FAST)
  assert both.joints.shape[1] == 80 and both.frame_mask.sum(1).tolist() == [80, 64]
  assert np.abs(both[1].joints - alone.joints).max() < 1e-4
  run = model.generate("a person runs", num_frames=80, seeds=[1], **FAST)[0]
  assert np.abs(both[0].joints - run.joints).max() < 1e-4 and both[0].captions == run.captions


@pytest.mark.slow
def test_the_released_way_chains_segments(model):
  """A motion does not know its batch-mates; negative prompts move those alone that name a side."""
  prompts = [("a person walks", 0.65), ("a person waves", 1.0)]
  make = lambda seed, scale: model.multi_prompts(
      [[("a person kicks with the left foot", 2.0)], prompts], seeds=[seed, 5], way="chain",
      negative_prompts=mirror_legs, contrast_scale=scale, **FAST)
  both, other, moved = make(1, 0.0), make(2, 0.0), make(1, 2.0)
  assert both[0].num_frames == 40 and both[1].num_frames == 32
  assert both[1].captions[1].start == pytest.approx(0.6)  # 13 frames are 3 latents
  assert all(np.abs(both[1].joints - changed[1].joints).max() < 1e-4 for changed in (other, moved))
  assert all(np.abs(both[0].joints - changed[0].joints).max() > 1e-3 for changed in (other, moved))


@pytest.mark.slow
def test_words_of_a_stream_change_when_they_are_said(model):
  """Said after n blocks: the blocks that are under way keep their words, unless `after` is shorter."""
  run = lambda after, prompt: _told(model, after, prompt)
  plain, late, soon = run(None, "a person walks"), run(None, "a person jumps"), run(0, "a person jumps")
  assert np.abs(plain[:60] - late[:60]).max() < 1e-6     # 3 given, 2 under way
  assert np.abs(plain[60:] - late[60:]).max() > 1e-5
  assert np.abs(plain[:36] - soon[:36]).max() < 1e-6 and np.abs(plain[36:60] - soon[36:60]).max() > 1e-5


def _told(model, after, prompt):
  stream, parts = model.stream("a person walks", seed=0, num_frames=96, **FAST), []
  for part in stream:
    parts.append(part)
    if len(parts) == 3:
      assert stream.delay == pytest.approx(1.2) and stream.block_seconds == pytest.approx(0.6)
      assert stream.fork().say(prompt, not_before=61) == 72  # whole blocks
      stream.say(prompt, after)
  return np.concatenate(parts)


@pytest.mark.slow
def test_a_stream_takes_any_number_of_words(model):
  stream = model.stream("a person walks", seed=0, **FAST)
  for i in range(5):  # more within one window than there is room for at first
    stream.say(f"a person jumps {'very ' * i}high", after=0.6 * (i + 1))
  parts = [next(stream) for _ in range(7)]
  assert np.isfinite(parts).all()
  for words, arguments in (("say what", ("",)), ("after -1", ("a person walks", -1)), ("after nan", ("walks", np.nan))):
    with pytest.raises(ValueError, match=words):
      stream.say(*arguments)


@pytest.mark.slow
def test_a_motion_goes_on(model, walk):
  longer = model.extend(walk, "a person waves", seconds=2, seed=1, **FAST)
  assert longer.num_frames == 90 and longer.meta["past_frames"] == 50
  np.testing.assert_array_equal(longer.joints[:50], walk.joints)
  assert longer.captions[-1] == Caption("a person waves", 2.5, 4.5)
  # The first new frame is where the last old one would have gone; from then on no joint leaps.
  assert np.abs(longer.joints[50] - longer.joints[49]).max() < 0.1
  again = model.extend(walk.joints, [("a person waves", 1.2), ("a person sits", 0.8)], seeds=[1], **FAST)
  assert np.abs(again.joints[:74] - longer.joints[:74]).max() < 0.05 and again.num_frames == 90
  assert [round(c.start, 2) for c in again.captions[-2:]] == [2.5, 3.7]
  chained = model.extend(walk, "a person waves", seconds=2, seed=1, way="chain", **FAST)
  np.testing.assert_array_equal(chained.joints[:50], walk.joints)
  assert chained.num_frames == 90 and np.abs(chained.joints - longer.joints).max() > 1e-4
  features = features_of(model, walk.joints)  # as they are edited: not normalized
  of_features = model.extend(features, "a person waves", seconds=2, seed=1, **FAST)
  np.testing.assert_allclose(of_features.joints[:50], model.stats.layout.to_joints(features), atol=1e-5)
  with pytest.raises(ValueError, match=r"an array of shape \(5, 3\) as the motion, expected a Clip"):
    model.extend(np.zeros((5, 3)), "a person waves", seed=1)


@pytest.mark.slow
def test_other_bodies_and_rates_are_fitted(model, walk, tmp_path):
  big = Clip(np.repeat(walk.joints * 1.2, 2, axis=0), fps=40, id="big")
  longer = model.extend(big, "a person walks", num_frames=12, seed=0, cleanup=True, **FAST)
  assert longer.fps == 20 and longer.num_frames == 62
  np.testing.assert_allclose(longer.joints[:50], big.joints[::2], atol=1e-5)  # in its place, on its own bones
  lengths = bone_lengths(longer.joints.astype(np.float64), HUMANML3D)[:, 1:]
  assert np.abs(lengths / lengths[0] - 1).max() < 0.01
  export.save(walk, tmp_path / "walk.bvh")
  from_file = model.extend(export.load(tmp_path / "walk.bvh"), "a person walks", num_frames=12, seed=0, **FAST)
  assert from_file.num_frames == 62


def test_a_generated_body_is_laid_over_the_given_one():
  """The same motion, turned and moved, comes back to its place; a different one goes on without a leap."""
  joints = synthetic_clips(1, 1, num_frames=60)[0].joints.astype(np.float64)
  turn = rot.about_axis(np.array(1.1), "y")
  shadow = rot.rotate(turn[None, None], joints) + [3.0, 0.1, -2.0]
  np.testing.assert_allclose(laid_over(shadow, joints[:40], 40), joints[40:], atol=1e-9)
  wrong = shadow + 0.05 * np.sin(np.arange(66).reshape(22, 3))
  after = laid_over(wrong, joints[:40], 40)
  assert np.abs(after[0] - joints[40]).max() < 0.01 and np.abs(after[15:] - joints[55:]).max() < 0.12


@pytest.mark.parametrize("run, words", [
    (lambda m, w: m.multi_prompt(["walks", "sits"]), "list of"), (lambda m, w: m.multi_prompt([("", 2)]), "say what"),
    (lambda m, w: m.multi_prompt([("walks", 0)]), "length of 0"),
    (lambda m, w: m.multi_prompt([("walks", 1)], way="x"), "way 'x'"),
    (lambda m, w: m.multi_prompt([("walks", 2000)] * 2), "4000 s"),
    (lambda m, w: m.multi_prompt([("walks", 1)], way="chain", solver="heun"), "heun"),
    (lambda m, w: m.extend(w, "walks", way="x"), "way 'x'"),
    (lambda m, w: m.extend(w, "walks", seconds=1, num_past=0), "num_past 0"),
    (lambda m, w: m.extend(w, "walks", seconds=1, schedule="full"), "fss"),
    (lambda m, w: m.extend(w.replace(joints=w.joints[:2]), "walks", seconds=1), "2 frames"),
    (lambda m, w: m.stream("walks", context=7), "blocks of 3"),
])
def test_bad_sequences_are_refused(model, walk, run, words):
  with pytest.raises(ValueError, match=words):
    run(model, walk)


# --- from the command line ---------------------------------------------------------------------------------------


def test_sequences_are_read_from_words_and_files(tmp_path):
  assert read_sequences("a person walks: 4 | sits down |waves:2.5s") == [
      [("a person walks", 4.0), ("sits down", None), ("waves", 2.5)]]
  assert read_sequences("says: hello") == [[("says: hello", None)]]
  (tmp_path / "t.txt").write_text("walks # 0 # 4 # legs\nwaves # 2 # 4 # left arm\n\nsits # 0 # 3 # legs\n")
  assert read_sequences(str(tmp_path / "t.txt")) == [[("walks", 2.0), ("walks and waves", 2.0)], [("sits", 3.0)]]
