"""Released weights are taken over whole or refused: every tensor of a checkpoint is accounted for."""
import sys

import jax
import numpy as np
import pytest
from safetensors.numpy import save_file

from motion_jax import convert
from motion_jax.nets.post_norm import PostNormLayer

TABLE = {"net.0": ("first", "dense"), "net.norm": ("norm", "norm"), "conv": ("deep/conv", "conv")}


def state():
  draw = np.random.default_rng(0).normal
  return {"net.0.weight": draw(size=(3, 2)), "net.0.bias": draw(size=3), "net.norm.weight": draw(size=3),
          "net.norm.bias": draw(size=3), "conv.weight": draw(size=(5, 4, 3)), "conv.bias": draw(size=5)}


def test_layouts_are_turned():
  theirs = state()
  params = convert.from_torch(theirs, TABLE)["params"]
  np.testing.assert_allclose(params["first"]["kernel"], theirs["net.0.weight"].T, rtol=1e-6)
  assert params["norm"]["scale"].shape == (3,) and params["first"]["kernel"].dtype == np.float32
  assert params["deep"]["conv"]["kernel"].shape == (3, 4, 5)  # (kernel, in, out)


def test_no_tensor_is_left_over_and_none_made_up():
  with pytest.raises(ValueError, match=r"missing 1 \(net.0.bias\), unknown 0"):
    convert.from_torch({name: array for name, array in state().items() if name != "net.0.bias"}, TABLE)
  with pytest.raises(ValueError, match=r"missing 0 \(\), unknown 1 \(pe\)"):
    convert.from_torch(state() | {"pe": np.zeros(4)}, TABLE)
  assert convert.from_torch(state() | {"pe": np.zeros(4)}, TABLE, ignore=("pe",))


def test_files(tmp_path, monkeypatch):
  arrays = {name: array.astype(np.float32) for name, array in state().items()}
  save_file(arrays, tmp_path / "weights.safetensors")
  loaded = convert.load_state(tmp_path / "weights.safetensors")
  assert loaded.keys() == arrays.keys()
  np.testing.assert_array_equal(loaded["conv.weight"], arrays["conv.weight"])
  (tmp_path / "cut.safetensors").write_bytes((tmp_path / "weights.safetensors").read_bytes()[:100])
  with pytest.raises(ValueError, match="no whole safetensors file"):
    convert.load_state(tmp_path / "cut.safetensors")
  with pytest.raises(FileNotFoundError, match="no checkpoint"):
    convert.load_state(tmp_path / "nothing.tar")
  (tmp_path / "latest.tar").write_bytes(b"not read without torch")
  monkeypatch.setitem(sys.modules, "torch", None)
  with pytest.raises(ValueError, match="needs torch"):
    convert.load_state(tmp_path / "latest.tar")


def test_a_part_of_a_checkpoint():
  nested = {f"ema_model/{name}": array for name, array in state().items()} | {"it": np.zeros(1)}
  assert convert.select(nested, "ema_model/").keys() == state().keys()
  with pytest.raises(ValueError, match="nothing under 'ae/'.*ema_model"):
    convert.select(nested, "ae/")


def test_attention_in_one_matrix_is_taken_apart():
  """PyTorch stacks q, k and v: the layer's output must be that of the three products done apart."""
  draw = np.random.default_rng(0).normal
  sizes = {"self_attn.in_proj_weight": (12, 4), "self_attn.in_proj_bias": (12,), "self_attn.out_proj.weight": (4, 4),
           "self_attn.out_proj.bias": (4,), "linear1.weight": (6, 4), "linear1.bias": (6,), "linear2.weight": (4, 6),
           "linear2.bias": (4,), "norm1.weight": (4,), "norm1.bias": (4,), "norm2.weight": (4,), "norm2.bias": (4,)}
  theirs = {f"layers.0.{name}": draw(size=size) for name, size in sizes.items()}
  made = convert.from_torch(theirs | {"hidden": np.ones(3)},
                            convert.post_norm_names("layers.0", "layer0") | {"hidden": ("hidden", "array")})["params"]
  assert made["hidden"].shape == (3,)
  for i, name in enumerate(("query", "key", "value")):
    stacked = theirs["layers.0.self_attn.in_proj_weight"], theirs["layers.0.self_attn.in_proj_bias"]
    np.testing.assert_allclose(made["layer0"][name]["kernel"], stacked[0][4 * i:4 * i + 4].T, rtol=1e-6)
    np.testing.assert_allclose(made["layer0"][name]["bias"], stacked[1][4 * i:4 * i + 4], rtol=1e-6)
  layer = PostNormLayer(num_heads=2, mlp_width=6)
  shapes = jax.eval_shape(layer.init, jax.random.key(0), np.zeros((1, 3, 4), np.float32))["params"]
  assert jax.tree.map(lambda a: a.shape, shapes) == jax.tree.map(lambda a: a.shape, made["layer0"])
