"""Folders in Hugging Face layout: CLIP, T5 and Sentence-T5 encode captions; what is wrong with a folder is told."""
import json
import shutil

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file
from tokenizers import Tokenizer, models, pre_tokenizers, processors

from motion_jax.text import bert, clip, hugging_face, mpnet, t5
from motion_jax.text.encoder import load_text_encoder
from motion_jax.text.folder import clip_tokenizer
from tests import fixtures
from tests.conftest import some_of
from tests.golden import Fixture
from tests.text.reference import mean_sentence

LETTERS = "abcdefghijklmnopqrstuvwxyz"
CAPTIONS = ["a walk", "Walk a walk", "b c d"]


def write_json(path, value):
  path.parent.mkdir(parents=True, exist_ok=True)
  path.write_text(json.dumps(value))


def write_clip(folder, whole=False):
  """The recorded small CLIP: its text half with tokenizer.json, or the whole model with the two old files."""
  fixture = Fixture(fixtures.path("text/clip_text.npz"))
  net, state = fixture.config["net"], fixture.params
  pieces = [*LETTERS, *(letter + "</w>" for letter in LETTERS), "wa", "lk</w>", "walk</w>"]
  write_json(folder / "vocab.json", {piece: i for i, piece in enumerate(pieces)} |
             {"<|startoftext|>": net["bos_token_id"], "<|endoftext|>": net["eos_token_id"]})
  (folder / "merges.txt").write_text("#version: 0.2\nw a\nl k</w>\nwa lk</w>\n")
  config = {"model_type": "clip_text_model", **net}
  if whole:
    ones = np.ones(3, np.float32)
    state = state | {"vision_model.post_layernorm.weight": ones, "logit_scale": ones[:1]}
    config = {"model_type": "clip", "projection_dim": net["projection_dim"], "vision_config": {},
              "text_config": net | {"eos_token_id": 2}}
  else:
    clip_tokenizer(folder / "vocab.json", folder / "merges.txt").save(str(folder / "tokenizer.json"))
    (folder / "vocab.json").unlink()
  write_json(folder / "config.json", config)
  save_file(state, folder / "model.safetensors")
  return folder


def write_t5(folder, sentence=False):
  """The recorded small T5, and with `sentence` the projection beside it as sentence-transformers lays it out."""
  fixture = Fixture(fixtures.path(f"text/t5_v1_{0 if sentence else 1}.npz"))
  write_json(folder / "config.json", {"model_type": "t5", **fixture.config["net"]})
  save_file(fixture.params, folder / "model.safetensors")
  pieces = ["<pad>", "</s>", "<unk>", "▁", *("▁" + letter for letter in LETTERS), *LETTERS, "▁walk"]
  tokenizer = Tokenizer(models.Unigram([(piece, -len(piece)) for piece in pieces[:-1]] + [("▁walk", -1)], unk_id=2))
  tokenizer.pre_tokenizer = pre_tokenizers.Metaspace()
  tokenizer.post_processor = processors.TemplateProcessing(single="$A </s>", special_tokens=[("</s>", 1)])
  tokenizer.save(str(folder / "tokenizer.json"))
  if sentence:
    write_json(folder / "2_Dense" / "config.json", {"activation_function": "torch.nn.modules.linear.Identity"})
    save_file({"linear.weight": fixture["in/projection"]}, folder / "2_Dense" / "model.safetensors")
  return folder


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
  root = tmp_path_factory.mktemp("encoders")
  for name in ("clip", "whole_clip", "t5", "sentence_t5"):
    (root / name).mkdir()
  return {"clip": write_clip(root / "clip"), "whole_clip": write_clip(root / "whole_clip", whole=True),
          "t5": write_t5(root / "t5"), "sentence_t5": write_t5(root / "sentence_t5", sentence=True)}


@pytest.fixture(scope="module", params=[*some_of(["clip", "t5", "sentence_t5"], quick=["sentence_t5"], slow=["clip"])])
def encoders(request, folders):
  """The same encoder at both levels."""
  return tuple(load_text_encoder(folders[request.param], level=level) for level in ("words", "sentence"))


def test_features_are_the_networks(encoders):
  words, sentences = encoders
  text_emb, text_mask = words(CAPTIONS)
  apply = jax.jit(words.model.apply, static_argnames="method")
  for caption, row, mask, vector in zip(CAPTIONS, text_emb, text_mask, sentences(CAPTIONS)[0][:, 0]):
    ids = jnp.array([words.tokenizer.encode(caption).ids])
    real = jnp.ones(ids.shape, bool)
    last = apply({"params": words.params}, ids, real)
    np.testing.assert_allclose(row[mask], last[0], atol=2e-6)
    assert not row[~mask].any()
    if isinstance(words.model, clip.ClipText):
      expected = apply({"params": words.params}, ids, real, method="sentence")[0]
      assert abs(np.linalg.norm(vector) - 1) > 0.01  # as it is, not at unit length
    else:
      expected = mean_sentence(last, real, words._sentence.projection)[0]
    np.testing.assert_allclose(vector, expected, atol=2e-6)
  assert words.dim == 32 and sentences.dim == len(vector)
  assert sentences.dim == (32 if isinstance(words.model, t5.T5Encoder) and words.model.gated else 24)
  np.testing.assert_allclose(np.linalg.norm(words.sentence(CAPTIONS), axis=-1), 1, atol=1e-6)


def test_a_whole_clip_with_the_old_files_is_the_same(folders):
  part, whole = (load_text_encoder(folders[name], level="sentence") for name in ("clip", "whole_clip"))
  assert (part(CAPTIONS)[0] == whole(CAPTIONS)[0]).all() and part.fingerprint != whole.fingerprint


def test_weights_in_shards_are_the_same_encoder(folders, tmp_path):
  shutil.copytree(folders["t5"], tmp_path, dirs_exist_ok=True)
  state = load_file(tmp_path / "model.safetensors")
  (tmp_path / "model.safetensors").unlink()
  write_json(tmp_path / "model.safetensors.index.json", {"weight_map": {
      name: f"model-{i % 2}.safetensors" for i, name in enumerate(state)}})
  for half in (0, 1):
    save_file(dict(list(state.items())[half::2]), tmp_path / f"model-{half}.safetensors")
  whole, parts = load_text_encoder(folders["t5"]), load_text_encoder(tmp_path)
  jax.tree.map(np.testing.assert_array_equal, parts.params, whole.params)
  (tmp_path / "model-1.safetensors").unlink()
  with pytest.raises(FileNotFoundError, match="of which 1 are missing"):
    load_text_encoder(tmp_path)


def test_clips_tokenizer(folders):
  tokenizer = clip_tokenizer(*(folders["whole_clip"] / name for name in ("vocab.json", "merges.txt")))
  pieces = lambda text: tokenizer.encode(text).tokens[1:-1]
  assert pieces(" Walk \n WALKa, ")[:3] == ["walk</w>", "wa", "l"]
  assert pieces("we're") == ["w", "e</w>", "<|endoftext|>", "r", "e</w>"]  # an apostrophe is not in this vocabulary
  assert tokenizer.encode("a").ids == [88, 26, 89]


def test_long_captions(folders):
  encoder = load_text_encoder(folders["clip"])
  with pytest.warns(UserWarning, match="16 word pieces of the 42"):
    cut = encoder([" ".join("a" * 40)])[0]
  assert (cut == encoder([" ".join("a" * 14)])[0]).all()  # the end token stays last
  encoder = load_text_encoder(folders["t5"])
  assert encoder.max_words == 512 and encoder([" ".join("a" * 150)])[0].shape[1] == 151
  with pytest.raises(ValueError, match="601 word pieces, expected at most 512"):
    encoder([" ".join("a" * 600)])


def test_missing_files_are_listed(tmp_path, monkeypatch):
  monkeypatch.setattr(hugging_face, "installed", lambda: False)
  write_json(tmp_path / "config.json", {"model_type": "t5"})
  (tmp_path / "2_Dense").mkdir()
  for name in ("pytorch_model.bin", "spiece.model", "2_Dense/pytorch_model.bin"):
    (tmp_path / name).touch()
  with pytest.raises(FileNotFoundError) as told:
    load_text_encoder(tmp_path)
  for words in ("lacks model.safetensors, tokenizer.json, 2_Dense/model.safetensors", "load_state",
                "spiece.model is not", str(tmp_path / "2_Dense" / "pytorch_model.bin")):
    assert words in str(told.value)
  write_json(tmp_path / "config.json", {"model_type": "bert"})
  (tmp_path / "vocab.txt").touch()
  with pytest.raises(FileNotFoundError, match=r"lacks .*tokenizer.json.*vocab.txt is not read here.*\[convert\]"):
    load_text_encoder(tmp_path)


def change_config(folder, **changes):
  write_json(folder / "config.json", json.loads((folder / "config.json").read_text()) | changes)


def change_piece(folder, number):
  content = json.loads((folder / "tokenizer.json").read_text())
  content["model"]["vocab"]["z"] = number
  write_json(folder / "tokenizer.json", content)


def change_state(folder, file="model.safetensors", drop=(), **changes):
  with_those = {name: a for name, a in Fixture(fixtures.path("text/clip_text.npz")).params.items() if name not in drop}
  save_file(with_those | changes, folder / file)


@pytest.mark.parametrize("change, message", [
    (lambda f: change_config(f, model_type="roberta"), "model_type 'roberta', expected one of bert"),
    (lambda f: change_config(f, eos_token_id=5), "ends a sentence with piece 89, config.json says 5"),
    (lambda f: change_config(f, vocab_size=12), "the weights|shape"),
    (lambda f: change_state(f, surprise=np.ones(2, np.float32)), "unknown 1 .surprise"),
    (lambda f: change_state(f, drop=["text_model.final_layer_norm.bias"]), "missing 1 .text_model.final_layer_norm"),
    (lambda f: change_config(f, num_hidden_layers=2**31), "got num_layers 2.14748e.09, expected at most 100;"),
    (lambda f: change_piece(f, 10**6), "the tokenizer has 1000001 word pieces"),
    (lambda f: (f / "model.safetensors").write_bytes(b"half a file"), "cannot be read"),
    (lambda f: (f / "tokenizer.json").write_text("[]"), "not a tokenizer")])
def test_a_folder_that_does_not_fit_is_one_clear_error(tmp_path, change, message):
  change(write_clip(tmp_path))
  with pytest.raises(ValueError, match=message) as told:
    load_text_encoder(tmp_path, level="sentence")
  assert "text encoder" in str(told.value)


def test_words_need_no_projection(tmp_path):
  change_state(write_clip(tmp_path), drop=["text_projection.weight"])
  assert load_text_encoder(tmp_path)(["a walk"])[0].shape == (1, 4, 32)


@pytest.mark.parametrize("fields, config, message", [
    (bert.bert_fields, {"model_type": "bert", "vocab_size": 3}, "lacks"),
    (clip.clip_fields, {"model_type": "clip_text_model", "hidden_act": "swish"}, "swish"),
    (t5.t5_fields, {"model_type": "t5", "feed_forward_proj": "gated-swish"}, "gated-swish"),
    (t5.t5_fields, {"model_type": "t5", "vocab_size": 3}, "lacks"),
    (mpnet.mpnet_fields, {"model_type": "mpnet", "vocab_size": 3}, "lacks 'hidden_size'")])
def test_a_config_that_no_network_of_ours_has(fields, config, message):
  with pytest.raises(ValueError, match=message):
    fields(config)


@pytest.mark.parametrize("config, state, message", [
    ({"activation_function": "torch.nn.Tanh"}, {"linear.weight": np.ones((24, 32), np.float32)}, "activation 'Tanh'"),
    ({}, {"linear.weight": np.ones((24, 31), np.float32)}, r"\(24, 31\), expected \(any, 32\)")])
def test_a_projection_that_does_not_fit(tmp_path, config, state, message):
  write_t5(tmp_path, sentence=True)
  write_json(tmp_path / "2_Dense" / "config.json", config)
  save_file(state, tmp_path / "2_Dense" / "model.safetensors")
  with pytest.raises(ValueError, match=message):
    load_text_encoder(tmp_path)
