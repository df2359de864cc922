"""Our BERT and DistilBERT give the reference's numbers, and padding is invisible."""
import json
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.text import bert
from tests.text.reference import mean_sentence, params_to_reference

FIXTURES = pathlib.Path(__file__).parents[1] / "fixtures" / "text"  # recorded with transformers 5.23.0, torch 2.13.0


def golden(name):
  with np.load(FIXTURES / f"{name}.npz", allow_pickle=False) as file:
    arrays = {key: file[key] for key in file.files}
  meta = json.loads(str(arrays.pop("meta")))
  state = {key[6:]: array.astype(np.float32) for key, array in arrays.items() if key.startswith("param/")}
  fields = bert.bert_fields({"model_type": name, **meta["config"]["net"]})
  return arrays, state, {**fields, "has_pooler": name == "bert"}, meta


def run(name, dtype):
  arrays, state, fields, meta = golden(name)
  return arrays, outputs(arrays, state, fields, dtype), meta


def outputs(arrays, state, fields, dtype):
  """All that is recorded of a network, from its inputs, PyTorch weights and our fields."""
  params = {"params": bert.params_from_reference(state, fields, dtype)}
  model = bert.Bert(**fields, dtype=dtype)
  args = [jnp.asarray(arrays["in/input_ids"]), jnp.asarray(arrays["in/attention_mask"]) > 0]
  if "in/token_type_ids" in arrays:
    args.append(jnp.asarray(arrays["in/token_type_ids"]))
  states = model.apply(params, *args, method="hidden_states")
  out = {f"hidden/{i}": state for i, state in enumerate(states)}
  out["last"] = model.apply(params, *args)
  if fields["has_pooler"]:
    out["pooled"] = model.apply(params, *args, method="pooled")
    out["sentence"] = mean_sentence(out["last"], args[1])
  return out


@pytest.mark.parametrize("name", ["bert", "distilbert"])
@pytest.mark.parametrize("kind", ["float64", pytest.param("float32", marks=pytest.mark.slow)])
def test_parity(name, kind):
  with jax.enable_x64(kind == "float64"), jax.default_matmul_precision("highest"):
    arrays, out, meta = run(name, jnp.dtype(kind))
    prefix, bound = ("out64/", 1e-10) if kind == "float64" else ("out/", meta["tolerance"])
    wanted = {key[len(prefix):]: array for key, array in arrays.items() if key.startswith(prefix)}
    assert wanted.keys() == out.keys()
    for key, array in wanted.items():
      difference = np.abs(np.asarray(out[key]) - array).max() / max(1, np.abs(array).max())
      assert out[key].dtype == kind
      assert difference < bound, (key, difference)


def test_names_go_both_ways_and_heads_are_ignored():
  _, state, fields, _ = golden("distilbert")
  released = {f"distilbert.{name}": array for name, array in state.items()} | {"vocab_projector.bias": np.zeros(3)}
  params = bert.params_from_reference(released, fields)
  back = params_to_reference(params, fields)
  assert back.keys() == state.keys()
  assert all((back[name] == state[name]).all() for name in state)
  with pytest.raises(ValueError, match="ffn.lin1.weight"):
    bert.params_from_reference({name: a for name, a in state.items() if "layer.1.ffn.lin1.weight" not in name}, fields)


def test_padding_is_invisible():
  _, state, fields, _ = golden("distilbert")
  params = {"params": bert.params_from_reference(state, fields)}
  model = bert.Bert(**fields)
  ids = jnp.array([[5, 17, 3, 60]])
  alone = model.apply(params, ids, jnp.ones((1, 4), bool))
  padded = jnp.pad(ids, ((0, 0), (0, 5)), constant_values=9)
  longer = model.apply(params, padded, jnp.arange(9)[None] < 4)
  np.testing.assert_allclose(longer[:, :4], alone, atol=2e-6)


def test_a_foreign_config_is_refused():
  with pytest.raises(ValueError, match="t5"):
    bert.bert_fields({"model_type": "t5"})
  with pytest.raises(ValueError, match="lacks"):
    bert.bert_fields({"model_type": "bert", "vocab_size": 3})
