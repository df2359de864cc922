"""A generator's run folder is all it takes: prompts become motions, motions come back with new parts."""
import dataclasses
import json
import shutil

import jax
import numpy as np
import pytest

from motion_jax import fit as training
from motion_jax.data.datasets.synthetic import synthetic_clips, synthetic_joints
from motion_jax.loading import load
from motion_jax.models.results import colors_of
from motion_jax.models.shared.spans import spans_of
from motion_jax.motion.representations import to_joints
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax_studio import Pipeline, cli
from tests.conftest import load_config

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def model(tiny_generator):
  return load(tiny_generator)


@pytest.fixture(scope="module")
def pipeline(model):
  return Pipeline(model)


@pytest.fixture(scope="module")
def clip():
  return next(clip for clip in synthetic_clips() if 60 <= clip.num_frames <= 190)


def test_motions_know_where_they_are_from_and_not_their_batch_mates(model):
  two = model.generate(["a person runs", "a person waves"], num_frames=[60, 42], seeds=[1, 5])
  assert two.joints.shape == (2, 60, 22, 3) and two.frame_mask.sum(1).tolist() == [60, 40]
  assert two[1].meta["mask"] == "causal" and two[1].meta["seed"] == 5 and two[1].source == model.id
  alone = model.generate("a person waves", num_frames=40, seeds=[5])
  np.testing.assert_allclose(alone[0].joints, two[1].joints, atol=1e-4)
  other = model.generate("a person waves", num_frames=40, seeds=[6])
  assert np.abs(other[0].joints - alone[0].joints).max() > 1e-4


PLACE = np.array([3.0, 0.4, -2.0])
TASKS = [dict(task="outpainting"), dict(task="prefix"), dict(keep=[(0, 30), (70, None)]), dict(change=[(33, 55)]),
         dict(change=[(0, None)])]


def on_another_body(clip):
  """The clip on bones that are 4 to 10 % longer, turned about y, elsewhere in the world."""
  own = HUMANML3D.bone_lengths * np.linspace(1.04, 1.1, 22)
  joints = with_lengths(clip.joints.astype(np.float64), dataclasses.replace(HUMANML3D, bone_lengths=own))
  return clip.replace(joints=(joints[..., [2, 1, 0]] * [1, 1, -1] + PLACE).astype(np.float32)), own


@pytest.mark.parametrize("which", TASKS, ids=str)
def test_an_edit_keeps_frames_bones_and_place(pipeline, clip, which):
  """New frames where and only where they were requested, on the bones of the source, in its place."""
  given, own = on_another_body(clip)
  count = given.num_frames
  which = {key: [(a, b or count) for a, b in value] if key != "task" else value for key, value in which.items()}
  made = pipeline.edit(given, "a person waves", seed=0, max_attempts=1, **which)
  new = np.zeros(count, bool)
  for first, past in made.meta["made"]:
    new[first:past] = True
  wanted = {"outpainting": [(0, count / 4), (count * 3 / 4, count)], "prefix": [(count / 2, count)]}.get(
      which.get("task"))
  if "keep" in which:
    wanted = [(30, 70)]
  np.testing.assert_allclose(made.meta["made"], wanted or which["change"], atol=0.51)
  assert made.num_frames == count and made.id == given.id
  np.testing.assert_array_equal(made.joints[~new], given.joints[~new])
  assert np.abs(made.joints[new] - given.joints[new]).max() > 1e-3
  lengths = bone_lengths(made.joints.astype(np.float64), HUMANML3D)[:, 1:]
  assert np.abs(lengths / own[1:] - 1).max() < 1e-4
  assert np.abs(made.joints[:, 0, [0, 2]] - given.joints[0, 0, [0, 2]]).max() < 30, "it stays near its place"
  assert made.features.shape == (count, 66) and np.isfinite(made.features).all()
  words = [caption.text for caption in made.captions]
  assert "a person waves" in words and (new.all() or clip.captions[0].text in words)


def test_other_seeds_make_other_frames_and_keep_the_same(pipeline, clip):
  one, other = (pipeline.edit(clip, "a person waves", "inpainting", seed=seed, max_attempts=1) for seed in (0, 1))
  (first, past), = one.meta["made"]
  assert np.abs(one.joints - other.joints)[first:past].max() > 1e-4 and one.meta["mask"] == "dccm"  # as it was trained
  np.testing.assert_array_equal(one.joints[:first], other.joints[:first])
  colors = colors_of(one)
  assert colors.shape == (one.num_frames, 3) and len(np.unique(colors, axis=0)) == 2


def test_cleanup_fixes_bones_and_feet_of_new_frames_alone(model, pipeline, clip):
  clean, raw = (pipeline.edit(clip, "a person waves", "prefix", seed=0, max_attempts=1, **how)
                for how in ({}, dict(cleanup=False)))
  network = model.edit(clip, "a person waves", "prefix", seed=0)
  spread = lambda motion: np.ptp(bone_lengths(motion.joints.astype(np.float64), HUMANML3D), axis=0).max()
  (first, _), = clean.meta["made"]
  np.testing.assert_array_equal(clean.joints[:first], raw.joints[:first])
  assert spread(clean) < 1e-4 < 1e-3 < spread(raw)
  assert network.num_frames % 4 == 0  # whole latents, as decoded
  assert np.abs(network.joints[:first] - clip.joints[:first]).max() > 1e-3


def test_new_frames_that_do_not_show_the_prompt_are_resampled(pipeline, clip):
  """All attempts are recorded, and what the best one misses is reported."""
  with pytest.warns(UserWarning, match="3 attempts, .*no waving seen"):
    made = pipeline.edit(clip, "a person waves", change=[(20, 60)], seed=0, max_attempts=3)
  attempts = made.meta["attempts"]
  assert [one["number"] for one in attempts] == [1, 2, 3] and sum(one["kept"] for one in attempts) == 1
  best = min(attempts, key=lambda one: one["violation_score"])
  assert best["kept"] and "no waving seen" in made.meta["unmet"]


def test_a_motion_longer_than_the_model_knows_is_edited_around_the_new_frames(pipeline):
  joints = np.concatenate([synthetic_joints("walk", 150, np.random.default_rng(i)) for i in (0, 0)])
  joints[150:] += joints[149, 0] * [1, 0, 1]
  made = pipeline.edit(joints, "a person waves", change=[(201, 223)], seed=0, max_attempts=1)
  assert made.num_frames == 300 and made.meta["made"] == [[201, 223]]
  kept = np.r_[0:201, 223:300]
  np.testing.assert_array_equal(made.joints[kept], joints[kept].astype(np.float32))
  with pytest.raises(ValueError, match="mark a shorter span"):
    pipeline.edit(joints, "a person waves", keep=[(0, 20)])


def test_a_model_of_steps_edits_in_place(clip, tmp_path):
  """Its features do not tell where a motion is; kept frames stay where they are all the same, also behind new ones."""
  config = load_config("cdamd_generator", "steps_tiny").unlock()
  config.sampler.update(num_iterations=3, num_steps=1, solver="euler")
  training.run(config, tmp_path)
  model = load(tmp_path)
  pipeline = Pipeline(model)
  walk = next(clip for clip in synthetic_clips() if np.ptp(clip.joints[:, 0, 2]) > 1 and clip.num_frames <= 190)
  for task in ("suffix", "inpainting"):
    made = pipeline.edit(walk, "a person waves", task, seed=0, max_attempts=1)
    new = np.zeros(walk.num_frames, bool)
    for first, past in made.meta["made"]:
      new[first:past] = True
    np.testing.assert_array_equal(made.joints[~new], walk.joints[~new])
    assert np.abs(made.joints[new] - walk.joints[new]).max() > 1e-2
    # The features are those of the motion, but for where it begins.
    shown = to_joints(made.features, model.stats.layout)
    assert np.abs(np.linalg.norm(np.diff(shown[:, 0], axis=0), axis=-1)
                  - np.linalg.norm(np.diff(made.joints[:, 0], axis=0), axis=-1)).max() < 1e-3
  assert model.generate("a person walks", 40, seeds=[1], cleanup=False)[0].joints[0, 0, [0, 2]].tolist() == [0, 0]


def test_spans(pipeline, clip):
  assert spans_of(["0:1.5s", "25%:0.5", "90:"], 100, 20.0) == [(0, 30), (25, 50), (90, 100)]
  for arguments, words in ((dict(), "one of task, keep and change"), (dict(keep=[(0, 10_000)]), "span 0:10000"),
                           (dict(task="prefix", keep=[(0, 8)]), "one of task")):
    with pytest.raises(ValueError, match=words):
      pipeline.edit(clip, "a person waves", **arguments)
  with pytest.raises(ValueError, match="expected A:B"):
    spans_of(["30"], 100, 20.0)
  with pytest.raises(ValueError, match="'soon'"):
    spans_of(["soon:4s"], 100, 20.0)


def test_what_cannot_be_made_is_refused(model):
  for arguments, words in ((dict(num_frames=500), "4 to 196"), (dict(num_frames=40, solver="ddpm"), "trained by flow"),
                           (dict(num_frames=40, order="middle"), "random or left_to_right"),
                           (dict(num_frames=40, mask="dcm"), "dccm")):
    with pytest.raises(ValueError, match=words):
      model.generate("a person walks", **arguments)


def test_the_command_line(tiny_generator, clip, tmp_path, monkeypatch, capsys):
  monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
  np.save(tmp_path / "in.npy", clip.joints)
  edit = ["edit", str(tmp_path / "in.npy"), "--prompt", "a person waves", "--model", str(tiny_generator), "--out"]
  assert cli.main([*edit, f"{tmp_path}/out.npz", "--change", "1s:2s", "--max-attempts", "1"]) == 0
  assert "new frames: 1.0 to 2.0 s" in capsys.readouterr().out
  kept = np.r_[0:20, 40:clip.num_frames]
  np.testing.assert_array_equal(np.load(tmp_path / "out.npz")["joints"][kept], clip.joints[kept].astype(np.float32))
  assert cli.main(["multi-prompt", "walks | waves", "--model", str(tiny_generator), "--out", f"{tmp_path}/no.npz"]) == 1
  assert "'multi_prompt'" in capsys.readouterr().err and not (tmp_path / "no.npz").exists()


def test_a_model_may_read_words_behind_the_sentence(tiny_generator, tmp_path):
  """The transformer is the same; a run that was trained on words says so in its config."""
  for name in ("params.safetensors", "frozen.safetensors", "Mean.npy", "Std.npy"):
    shutil.copy(tiny_generator / name, tmp_path / name)
  config = json.loads((tiny_generator / "config.json").read_text())
  config["frozen"]["text_level"] = "words"
  (tmp_path / "config.json").write_text(json.dumps(config))
  loaded = load(tmp_path)
  draw = np.random.default_rng(0)  # two steps leave the gates at 0, behind which words do nothing
  loaded.params = jax.tree.map(lambda a: a + 0.1 * draw.standard_normal(a.shape, np.float32), loaded.params)
  text_emb, text_mask = loaded.encode_words(["a person runs", "runs"])
  assert text_emb.shape == (2, 78, 32) and text_mask.sum(1).tolist()[0] > text_mask.sum(1).tolist()[1] > 2
  one, other = (loaded.generate(prompt, 40, seeds=[1])[0].joints for prompt in ("a person runs", "a person jumps"))
  assert np.isfinite(one).all() and np.abs(one - other).max() > 1e-5
  long = ", ".join(["someone walks forward and then turns left"] * 12)  # more than everyday captions are padded to
  assert loaded.encode_words([long])[0].shape == (1, 155, 32)


def test_clips_are_edited_together_as_they_are_alone(pipeline):
  clips = [clip for clip in synthetic_clips() if 60 <= clip.num_frames <= 190][:2]
  both = pipeline.edits(clips, ["a person waves", "a person runs"], "suffix", seeds=[1, 2], max_attempts=1)
  alone = pipeline.edit(clips[1], "a person runs", "suffix", seed=2, max_attempts=1)
  np.testing.assert_allclose(alone.joints, both[1].joints, atol=1e-4)
  assert both[1].meta["made"] == alone.meta["made"] and both[0].id == clips[0].id
  with pytest.raises(ValueError, match="1 prompts for 2 clips"):
    pipeline.edits(clips, ["a person waves"], "suffix")


def test_segments_continue_one_another(model, pipeline):
  """Each is inpainted after the end of the one before: no leap, and the first is what it is alone."""
  made = pipeline("a person runs, then waves while walking", num_frames=120, seed=5, cleanup=False, max_attempts=1)
  assert [c.text for c in made.captions] == ["a person runs", "a person walks and waves"] and made.num_frames == 120
  border = round(made.captions[0].end * 20)
  alone = model.generate("a person runs", num_frames=border, seeds=[5])[0]
  np.testing.assert_allclose(made.joints[:border], alone.joints, atol=1e-5)
  steps = np.linalg.norm(np.diff(made.joints, axis=0), axis=-1).max(-1)
  assert steps[border - 1] <= np.delete(steps, border - 1).max()  # no leap beyond those of an untrained body
  assert made.features.shape == (120, 66) and np.ptp(made.joints[border:], axis=0).max() > 1e-3


def test_a_length_estimator_gives_the_default_length(model):
  """Without one it is six seconds; at most it is the training length."""
  assert model.length is None and model.estimated_frames("a person walks") is None
  assert model.default_frames("a person walks") == 120
  shipped = load("cdamd-small")
  if shipped.length is not None:
    assert shipped.default_frames("a person waves") == shipped.estimated_frames("a person waves") <= 196
