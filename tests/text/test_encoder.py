"""The text encoder: captions do not feel each other, errors say what to do, the shipped model knows its words."""
import json
import pathlib
import shutil

import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.text.encoder import SHIPPED, load_text_encoder
from motion_jax.utils.errors import InputError

CAPTIONS = ["a person walks forward.", "someone jumps",
            "a person turns left, then waves with the right hand and sits down.", "Run!",
            "a person takes 3 steps at 90° – señor, naïve café 😀"]


@pytest.fixture(scope="module")
def encoder():
  return load_text_encoder("words")


def cosine(a, b):
  return float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))


def test_shapes_masks_and_padding(encoder):
  text_emb, text_mask = encoder(CAPTIONS)
  assert text_emb.dtype == np.float32 and text_mask.dtype == bool
  assert text_emb.shape == (*text_mask.shape, encoder.dim) and text_mask.sum(1).max() == text_mask.shape[1]
  assert np.isfinite(text_emb).all() and not text_emb[~text_mask].any()
  longer_emb, longer_mask = encoder(CAPTIONS, pad_to=60)
  assert longer_mask.shape == (5, 60) and (longer_emb[:, :text_emb.shape[1]] == text_emb).all()
  assert (longer_mask.sum(1) == text_mask.sum(1)).all()


def test_batch_mates_are_invisible_and_runs_repeat(encoder):
  together, mask = encoder(CAPTIONS)
  again = load_text_encoder(encoder.name)  # an empty cache
  for i in reversed(range(len(CAPTIONS))):
    alone, alone_mask = again([CAPTIONS[i]])
    assert (alone[0] == together[i][mask[i]]).all() and alone_mask.all()
    assert (again.sentence([CAPTIONS[i]])[0] == encoder.sentence(CAPTIONS)[i]).all()
    with pytest.raises(ValueError, match="read-only"):
      again._feature(CAPTIONS[i])[0] = 0  # a caller cannot spoil the cache
  np.testing.assert_allclose(np.linalg.norm(encoder.sentence(CAPTIONS), axis=-1), 1, atol=1e-5)
  assert again.fingerprint == encoder.fingerprint and len(again.fingerprint) == 64


def test_for_training_a_caption_has_one_feature_whatever_else_is_encoded(encoder):
  together, mask = encoder.for_training()(CAPTIONS)
  alone = encoder.for_training()
  for caption, row, real in reversed(list(zip(CAPTIONS, together, mask))):
    assert (alone([caption])[0][0] == row[real]).all()
  np.testing.assert_allclose(together, encoder(CAPTIONS)[0], atol=2e-5)


@pytest.mark.parametrize("caption, message", [
    ("", "empty caption"), ("  \n ", "empty caption"), ("\u200b", "empty caption"), (None, "NoneType"),
    ("walk " * 200, "word pieces")])
def test_bad_captions(encoder, caption, message):
  with pytest.raises(ValueError, match=message):
    encoder([caption])


def test_bad_sizes(encoder):
  with pytest.raises(ValueError, match="no caption"):
    encoder([])
  with pytest.raises(ValueError, match="pad_to=3"):
    encoder(["a person walks forward."], pad_to=3)
  short = load_text_encoder(encoder.name, max_words=5)
  assert short(["a person walks"])[1].sum() == 5, "with the two special pieces"
  with pytest.raises(ValueError, match="at most 5"):
    short(["a person walks forward"])
  with pytest.raises(InputError, match="got the text level .*a: 1.*, expected one of words, sentence") as error:
    load_text_encoder("words", level=ConfigDict({"a": 1}))  # of a damaged run; its repr has several lines
  assert "\n" not in str(error.value)


def test_a_sentence_is_one_row(encoder):
  sentences = load_text_encoder(encoder.name, level="sentence")
  text_emb, text_mask = sentences(CAPTIONS, pad_to=60)
  assert text_emb.shape == (5, 1, sentences.dim) and text_mask.all() and text_mask.shape == (5, 1)
  assert (text_emb[:, 0] == encoder.sentence(CAPTIONS)).all() and (sentences.sentence(CAPTIONS) == text_emb[:, 0]).all()
  assert sentences.fingerprint != encoder.fingerprint and len(sentences.fingerprint) == 64
  with pytest.raises(ValueError, match="paragraph"):
    load_text_encoder(encoder.name, level="paragraph")


def test_a_folder_of_the_hugging_face_layout_loads_whole_or_is_one_clear_error(tmp_path, encoder):
  folder = pathlib.Path(shutil.copytree(SHIPPED / "words", tmp_path / "model"))
  (folder / "known_words.txt").unlink()
  copy = load_text_encoder(folder)
  assert (copy(CAPTIONS)[0] == encoder(CAPTIONS)[0]).all() and copy.fingerprint == encoder.fingerprint
  assert copy.out_of_vocabulary("a person frobnicates") == []
  config = (folder / "config.json").read_bytes()
  wider = json.dumps(json.loads(config) | {"dim": 64}).encode()
  for file, content in (("config.json", wider), ("config.json", b"{"), ("config.json", b'{"model_type": "t5"}'),
                        ("model.safetensors", b"half a file"), ("tokenizer.json", b"[]")):
    kept = (folder / file).read_bytes()
    (folder / file).write_bytes(content)
    with pytest.raises(ValueError, match="text encoder"):
      load_text_encoder(folder)
    (folder / file).write_bytes(kept)


@pytest.mark.parametrize("verb, synonym", [
    ("walks", "strolls"), ("punches", "jabs"), ("raises", "lifts")])
def test_synonyms_are_nearer_than_other_movements(encoder, verb, synonym):
  feature = encoder.word(f"a person {synonym}.", synonym)
  near = cosine(feature, encoder.word(f"a person {verb}.", verb))
  others = {"walks", "jumps", "punches", "raises", "sits", "kicks"} - {verb}
  assert all(near > cosine(feature, encoder.word(f"a person {other}.", other)) + 0.1 for other in others)


def test_words_out_of_vocabulary_are_named(encoder):
  assert encoder.out_of_vocabulary("A person strolled happily forward, then jumped 3 times!") == []
  assert encoder.out_of_vocabulary("a person qzxvks, frobnicates 😀") == ["qzxvks", "frobnicates", "😀"]
  assert encoder.out_of_vocabulary("a person ambles sneakily") == ["ambles"], "sneak was in the training"


def test_synonyms_are_near_enough(encoder):
  assert encoder.synonym("strolls", ("kicks", "walks")) == "walks"
  assert encoder.synonym("strolls", ("kicks", "sits")) == encoder.synonym("qzxvks", ("walks",)) == ""
