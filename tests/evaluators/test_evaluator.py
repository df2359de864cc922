"""An evaluator's vectors know neither padding nor batch-mates; what does not belong to it is refused."""
import functools

import ml_collections
import numpy as np
import pytest

from motion_jax import fit as training
from motion_jax.evaluators.evaluator import fresh_evaluator, load_evaluator, shipped_names
from motion_jax.evaluators.words import CONVERTED, WordVectors
from motion_jax.metrics.scores import cosines
from motion_jax.motion.stats import save_stats
from motion_jax.runs import PRETRAINED
from motion_jax.text.tagger import tag
from motion_jax.training import checkpoint
from tests.configs.test_tiny_sizes import traced_training
from tests.conftest import load_config

CAPTIONS = ["a person walks forward", "someone waves the left hand", "he sits down"]


fresh = functools.cache(lambda kind: fresh_evaluator(kind, "coordinates"))


@pytest.fixture(params=[pytest.param("t2m", marks=pytest.mark.slow), "clip", "tmr", "snapmogen"])
def evaluator(request):
  return fresh(request.param)


def test_padding_and_batch_mates_do_not_matter(evaluator):
  x = np.random.default_rng(0).normal(size=(3, 60, 66)).astype(np.float32)
  frames = np.array([60, 40, 24])
  for row, count in zip(x, frames):
    row[count:] = 0
  together = evaluator.embed_motion(x, frames)
  assert together.shape == (3, evaluator.dim) and together.dtype == np.float32
  np.testing.assert_array_equal(evaluator.embed_motion(x[::-1], frames[::-1]), together[::-1])
  alone = evaluator.embed_motion(x[1:2, :40], frames[1:2])
  np.testing.assert_allclose(alone[0], together[1], atol=1e-5)
  assert np.abs(together[0] - together[1]).max() > 1e-3


def test_sentences_know_no_batch_mates(evaluator):
  together = evaluator.embed_text(CAPTIONS)
  assert together.shape == (3, evaluator.dim) and np.abs(together[0] - together[1]).max() > 1e-3
  np.testing.assert_allclose(evaluator.embed_text(CAPTIONS[1:2])[0], together[1], atol=1e-5)
  lines = [" ".join(tag(caption)) for caption in CAPTIONS]
  np.testing.assert_array_equal(evaluator.embed_text(CAPTIONS, lines), together)


def test_wrong_input_is_refused():
  evaluator = fresh("t2m")
  x = np.zeros((2, 20, 66), np.float32)
  for given, frames, words in (
      (x[..., :63], [20, 8], "got 63 features per frame.*reads 66"), (x, [20, 3], "4 to 20"), (x, [24, 8], "4 to 20"),
      (x, [20], r"expected \(B, T, F\)"), (x[0], [20, 20], r"expected \(B, T, F\)")):
    with pytest.raises(ValueError, match=words):
      evaluator.embed_motion(given, frames)
  for captions, tokens, words in (([], None, "list of sentences"), ([3], None, "list of sentences"),
                                  (["a"], ["a/DET", "b/NOUN"], "1 captions and 2 token lines")):
    with pytest.raises(ValueError, match=words):
      evaluator.embed_text(captions, tokens)


def test_a_seed_says_which_evaluator():
  one, same, other = (fresh_evaluator("t2m", "coordinates", seed) for seed in (0, 0, 1))
  assert one.hash == same.hash != other.hash and len(one.hash) == 64
  with pytest.raises(ValueError, match="t2m, clip, tmr or"):
    fresh_evaluator("classic")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
  """A tiny matching run with random weights, on a vocabulary of its own, which is gone when the evaluator is used."""
  folder = tmp_path_factory.mktemp("runs")
  words = ["sos", "eos", "unk", "person", "walk", "wave", "hand"]
  vocabulary = WordVectors(words, np.random.default_rng(0).normal(size=(7, 5)))
  vocabulary.save(folder / "words.npz")
  config = load_config("evaluator_matching", "tiny").unlock()
  config.frozen.glove = str(folder / "words.npz")
  with pytest.MonkeyPatch.context() as patch:
    patch.setattr(training.loop, "train", traced_training)
    training.run(config, folder / "run")
  (folder / "words.npz").unlink()
  return folder / "run"


def test_a_run_folder_is_all_it_takes(run):
  evaluator = load_evaluator(run)
  assert (evaluator.kind, evaluator.layout.name, evaluator.max_frames) == ("t2m", "coordinates", 96)
  known, unknown, other = evaluator.embed_text(["a person walks", "a person zzz", "a person qqq"])
  np.testing.assert_array_equal(unknown, other)
  assert np.abs(known - unknown).max() > 1e-6
  assert load_evaluator(run).hash == evaluator.hash


def test_the_words_of_a_converted_folder_may_lie_elsewhere(run, tmp_path):
  """What `motion-jax convert evaluator` writes: a config without text, weights, statistics."""
  evaluator, model = load_evaluator(run), checkpoint.load_config(run).model.to_dict()
  config = dict(stage="evaluator.t2m", model=model, data=dict(layout="coordinates"))
  checkpoint.save_config(tmp_path, ml_collections.ConfigDict(config))
  checkpoint.save_params(tmp_path, checkpoint.load_params(run))
  save_stats(evaluator.stats, tmp_path)
  converted = load_evaluator(tmp_path)
  assert converted.hash == evaluator.hash and converted.max_frames == 196
  with pytest.raises(FileNotFoundError, match="--glove FOLDER"):
    converted.embed_text(CAPTIONS)
  np.testing.assert_array_equal(load_evaluator(tmp_path, text=run / CONVERTED).embed_text(CAPTIONS),
                                evaluator.embed_text(CAPTIONS))
  with pytest.raises(ValueError, match="vectors of 32 numbers, the evaluator was trained on 5"):
    load_evaluator(tmp_path, text="random-init").embed_text(CAPTIONS)


def test_folders_that_are_no_evaluator_are_refused(run, tmp_path):
  with pytest.raises(FileNotFoundError, match="neither a run folder.*that ships: clip-evaluator-small"):
    load_evaluator(tmp_path / "none")
  with pytest.raises(ValueError, match="'cmdm.denoiser' run, expected one of stage evaluator.matching"):
    load_evaluator(PRETRAINED / "cmdm-small")
  for file in (checkpoint.CONFIG, checkpoint.PARAMS, "Mean.npy", "Std.npy"):
    (tmp_path / file).write_bytes((run / file).read_bytes())
  (tmp_path / "Std.npy").unlink()
  with pytest.raises(FileNotFoundError, match="has no Std.npy"):
    load_evaluator(tmp_path)
  for size in (63, 263):
    for name in ("Mean.npy", "Std.npy"):
      np.save(tmp_path / name, np.ones(size, np.float32))
    with pytest.raises(ValueError, match="another representation"):
      load_evaluator(tmp_path)


@pytest.mark.slow
def test_the_evaluators_that_ship():
  """Trained on our own words, and real enough to tell actions apart."""
  folders = [PRETRAINED / name for name in ("evaluator-small", "clip-evaluator-small")]
  assert {folder.name for folder in folders} <= set(shipped_names())
  for folder, kind in zip(folders, ("t2m", "clip")):
    evaluator = load_evaluator(folder.name)
    assert (evaluator.kind, evaluator.layout.name, evaluator.mode) == (kind, "coordinates", "corrected")
    assert (folder / "LICENSE.txt").is_file() and (folder / "README.md").is_file()
    text = evaluator.embed_text(["a person runs forward", "someone is running", "a person raises both hands"])
    near, far = (cosines(text[:1], text[i:i + 1])[0, 0] for i in (1, 2))
    assert near > far + 0.2


@pytest.mark.parametrize("features, columns, words", [
    (66, 60, "got model.features 66 and model.columns 60, expected model.columns 66.*the two are exchanged"),
    (0, 66, "got model.features 0 and model.columns 66")])
def test_features_and_columns_that_do_not_fit_are_both_named(features, columns, words):
  config = load_config("evaluator_movement", "tiny").unlock()
  config.model.update(features=features, columns=columns)
  with pytest.raises(ValueError, match=words):
    training.setups()[config.stage](config)
