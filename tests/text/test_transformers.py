"""Our encoders are transformers' PyTorch modules, at random weights and through a folder on disk, word for word.

Any size, activation or option that a folder may have can be tried so, beside the recorded files of one size each.
"""
import json
import re

import numpy as np
import pytest
from tokenizers import Tokenizer, models, normalizers, pre_tokenizers, processors

from motion_jax.text.encoder import load_text_encoder

CAPTIONS = ["a person walks.", "walks a", "A person, a person walks and walks."]
WORDS = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", "[MASK]", "a", "person", "walk", "##s", "and", ".", ",", "</s>"]

BERT = dict(vocab_size=len(WORDS), hidden_size=24, num_hidden_layers=2, num_attention_heads=3, intermediate_size=40,
            max_position_embeddings=32)
DISTILBERT = dict(vocab_size=len(WORDS), dim=24, n_layers=2, n_heads=2, hidden_dim=40, max_position_embeddings=32)
CLIP = dict(vocab_size=len(WORDS), hidden_size=24, num_hidden_layers=2, num_attention_heads=3, intermediate_size=40,
            max_position_embeddings=32, projection_dim=10, bos_token_id=2, eos_token_id=len(WORDS) - 1,
            pad_token_id=0)
T5 = dict(vocab_size=len(WORDS), d_model=24, d_kv=7, num_layers=3, num_heads=2, d_ff=40, eos_token_id=len(WORDS) - 1,
          pad_token_id=0, relative_attention_num_buckets=8, relative_attention_max_distance=12)
CASES = {  # config class, model class, fields
    "bert": ("BertConfig", "BertModel", BERT),
    "bert-relu": ("BertConfig", "BertModel", BERT | dict(hidden_act="relu", layer_norm_eps=1e-5, type_vocab_size=1)),
    "distilbert": ("DistilBertConfig", "DistilBertModel", DISTILBERT),
    "clip": ("CLIPTextConfig", "CLIPTextModelWithProjection", CLIP),
    "clip-gelu": ("CLIPTextConfig", "CLIPTextModelWithProjection", CLIP | dict(hidden_act="gelu")),
    "t5-1.0": ("T5Config", "T5EncoderModel", T5 | dict(feed_forward_proj="relu")),
    "t5-1.1": ("T5Config", "T5EncoderModel", T5 | dict(feed_forward_proj="gated-gelu")),
}


def word_pieces(end=None):
  """A tokenizer of WORDS; with `end` its sentences end there, else they stand between [CLS] and [SEP]."""
  tokenizer = Tokenizer(models.WordPiece({word: i for i, word in enumerate(WORDS)}, unk_token="[UNK]"))
  tokenizer.normalizer, tokenizer.pre_tokenizer = normalizers.BertNormalizer(), pre_tokenizers.BertPreTokenizer()
  marks = ("$A", end) if end else ("[CLS]", "$A", "[SEP]")
  tokenizer.post_processor = processors.TemplateProcessing(
      single=" ".join(marks), special_tokens=[(mark, WORDS.index(mark)) for mark in marks if mark != "$A"])
  return tokenizer


def write_model(folder, case):
  """A folder that transformers wrote, of random weights, with our tokenizer -> their module."""
  import torch
  import transformers
  config_class, model_class, fields = CASES[case]
  torch.manual_seed(len(case))
  model = getattr(transformers, model_class)(getattr(transformers, config_class)(**fields)).eval()
  with torch.no_grad():
    for parameter in model.parameters():  # gains of 1 and offsets of 0 would hide that they are in the wrong place
      parameter.add_(0.1 * torch.randn(parameter.shape))
  model.save_pretrained(folder)
  word_pieces("</s>" if case.startswith(("clip", "t5")) else None).save(str(folder / "tokenizer.json"))
  return model


@pytest.mark.torch
@pytest.mark.parametrize("case", CASES)
def test_features_are_those_of_the_pytorch_module(case, tmp_path):
  import torch
  theirs = write_model(tmp_path, case)
  encoder = load_text_encoder(tmp_path)
  made, mask = encoder(CAPTIONS)
  tokenizer = word_pieces("</s>" if case.startswith(("clip", "t5")) else None)
  worst = 0.0
  for row, real, caption in zip(made, mask, CAPTIONS):
    ids = tokenizer.encode(caption).ids
    with torch.no_grad():
      expected = theirs(input_ids=torch.tensor([ids])).last_hidden_state[0].numpy()
    assert real.sum() == len(ids)
    worst = max(worst, np.abs(np.asarray(row)[:len(ids)] - expected).max() / max(1, np.abs(expected).max()))
  assert worst < 2e-5


@pytest.mark.torch
def test_clips_sentence_is_its_projected_end(tmp_path):
  import torch
  theirs = write_model(tmp_path, "clip")
  made = load_text_encoder(tmp_path, level="sentence").sentence(CAPTIONS[:1])
  with torch.no_grad():
    expected = theirs(input_ids=torch.tensor([word_pieces("</s>").encode(CAPTIONS[0]).ids])).text_embeds.numpy()
  unit = lambda a: np.asarray(a) / np.linalg.norm(a)
  np.testing.assert_allclose(unit(made), unit(expected), atol=2e-5)


@pytest.mark.torch
def test_an_older_tokenizer_and_a_short_config_are_read(tmp_path):
  """vocab.txt for tokenizer.json, and a config.json without what its kind has by default: the same features."""
  write_model(tmp_path, "bert")
  expected = load_text_encoder(tmp_path)
  (tmp_path / "tokenizer.json").unlink()
  (tmp_path / "vocab.txt").write_text("".join(f"{word}\n" for word in WORDS))
  np.testing.assert_array_equal(load_text_encoder(tmp_path)(CAPTIONS)[0], expected(CAPTIONS)[0])

  config = json.loads((tmp_path / "config.json").read_text())
  del config["num_attention_heads"]  # 12 by default, which 24 columns allow
  (tmp_path / "config.json").write_text(json.dumps(config))
  assert load_text_encoder(tmp_path).model.num_heads == 12


@pytest.mark.torch
def test_pytorch_weights_of_an_encoder_are_converted_once(tmp_path):
  """pytorch_model.bin is never opened by the reader; the line that its error spells out makes the other file of it."""
  import torch
  expected = write_model(tmp_path, "distilbert")
  safe = load_text_encoder(tmp_path)(CAPTIONS)[0]
  (tmp_path / "model.safetensors").unlink()
  torch.save(expected.state_dict(), tmp_path / "pytorch_model.bin")
  with pytest.raises(FileNotFoundError, match="pytorch_model.bin is not opened here") as told:
    load_text_encoder(tmp_path)
  line = re.search(r'python -c "(.*?)"', str(told.value))[1]
  exec(line, {})
  np.testing.assert_array_equal(load_text_encoder(tmp_path)(CAPTIONS)[0], safe)
