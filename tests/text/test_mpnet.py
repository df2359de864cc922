"""MPNet, written out in numpy from transformers' formulas, and read from a folder in Hugging Face layout."""
import json

import jax
import jax.numpy as jnp
import numpy as np
from safetensors.numpy import save_file
from scipy.special import erf, softmax
from tokenizers import Tokenizer, models, pre_tokenizers, processors

from motion_jax.text import mpnet
from motion_jax.text.encoder import load_text_encoder

CONFIG = dict(model_type="mpnet", vocab_size=12, hidden_size=8, num_hidden_layers=2, num_attention_heads=2,
              intermediate_size=12, max_position_embeddings=42, layer_norm_eps=1e-5)


def state():
  draw, sizes = np.random.default_rng(0).normal, {}
  for path, (name, kind) in mpnet.names(mpnet.mpnet_fields(CONFIG)).items():
    rows = {"words": 12, "positions": 42, "distances": 32, "mlp_in": 12}.get(path[-1], 8)
    columns = {"distances": 2, "mlp_out": 12}.get(path[-1], 8)
    sizes[f"{name}.weight"] = (rows,) if kind == "norm" else (rows, columns)
    if kind != "embed":
      sizes[f"{name}.bias"] = (rows,)
  return {name: draw(size=size) for name, size in sizes.items()}


def by_hand(weights, ids):
  """Hidden states (S, 8) of one sentence, float64."""
  linear = lambda name, x: x @ weights[f"{name}.weight"].T + weights[f"{name}.bias"]

  def norm(name, x):
    x = (x - x.mean(-1, keepdims=True)) / np.sqrt(x.var(-1, keepdims=True) + 1e-5)
    return x * weights[f"{name}.weight"] + weights[f"{name}.bias"]

  def bucket(distance):  # of key - query
    n, half = abs(distance), 16 if distance > 0 else 0
    return half + (n if n < 8 else min(8 + int(np.log(n / 8) / np.log(16) * 8), 15))

  count = len(ids)
  x = weights["embeddings.word_embeddings.weight"][ids] + weights["embeddings.position_embeddings.weight"][2:2 + count]
  x = norm("embeddings.LayerNorm", x)
  bias = np.array([[weights["encoder.relative_attention_bias.weight"][bucket(k - q)] for k in range(count)]
                   for q in range(count)])
  for i in range(2):
    layer = f"encoder.layer.{i}"
    query, key, value = (linear(f"{layer}.attention.attn.{name}", x).reshape(count, 2, 4) for name in "qkv")
    scores = np.einsum("qhd,khd->hqk", query, key) / 2 + bias.transpose(2, 0, 1)
    mixed = np.einsum("hqk,khd->qhd", softmax(scores, -1), value).reshape(count, 8)
    x = norm(f"{layer}.attention.LayerNorm", x + linear(f"{layer}.attention.attn.o", mixed))
    y = linear(f"{layer}.intermediate.dense", x)
    x = norm(f"{layer}.output.LayerNorm", x + linear(f"{layer}.output.dense", y * 0.5 * (1 + erf(y / np.sqrt(2)))))
  return x


def test_hidden_states():
  """30 pieces reach the ranges of the distance table; padding is not seen."""
  weights, fields = state(), mpnet.mpnet_fields(CONFIG)
  ids = np.random.default_rng(1).integers(0, 12, (1, 30))
  with jax.enable_x64(True):
    params = mpnet.params_from_reference({f"mpnet.{name}": a for name, a in weights.items()}, fields, np.float64)
    net = mpnet.MPNet(**fields, dtype=jnp.float64)
    padded = jnp.asarray(np.pad(ids, ((0, 0), (0, 6)), constant_values=3))
    made = net.apply({"params": params}, padded, jnp.arange(36)[None] < 30)[0, :30]
  np.testing.assert_allclose(made, by_hand(weights, ids[0]), atol=1e-10)


def test_a_folder_gives_sentences(tmp_path):
  """Mean of the real word pieces at unit length, from the files that Hugging Face has."""
  words = ["<s>", "<pad>", "</s>", "[UNK]", *"abcdefgh"]
  tokenizer = Tokenizer(models.WordLevel({word: i for i, word in enumerate(words)}, unk_token="[UNK]"))
  tokenizer.pre_tokenizer = pre_tokenizers.Whitespace()
  tokenizer.post_processor = processors.TemplateProcessing(
      single="<s> $A </s>", special_tokens=[("<s>", 0), ("</s>", 2)])
  tokenizer.save(str(tmp_path / "tokenizer.json"))
  (tmp_path / "config.json").write_text(json.dumps(CONFIG))
  weights = state() | {"pooler.dense.weight": np.ones((8, 8)), "pooler.dense.bias": np.ones(8)}
  save_file({name: a.astype(np.float32) for name, a in weights.items()}, tmp_path / "model.safetensors")
  encoder = load_text_encoder(tmp_path, level="sentence")
  mean = by_hand(state(), [0, 4, 6, 2]).mean(0)
  np.testing.assert_allclose(encoder.sentence(["a c"])[0], mean / np.linalg.norm(mean), atol=1e-5)
  assert encoder.max_words == 40
