"""Our BERT and DistilBERT give the reference's numbers, and padding is invisible."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.text import bert
from tests import fixtures
from tests.golden import Fixture
from tests.text.reference import mean_sentence, params_to_reference


def golden(name):
  """(recording with transformers 5.23.0 and torch 2.13.0, our fields)."""
  fixture = Fixture(fixtures.path(f"text/{name}.npz"))
  fields = bert.bert_fields({"model_type": name, **fixture.config["net"]})
  return fixture, {**fields, "has_pooler": name == "bert"}


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


@pytest.mark.parametrize("name, kind", [pytest.param("bert", "float64", marks=pytest.mark.slow),
                                        ("distilbert", "float64"),
                                        pytest.param("bert", "float32", marks=pytest.mark.exhaustive)])
def test_parity(name, kind):
  """Words that are padding in the recording among them: nothing of these is seen."""
  fixture, fields = golden(name)
  with jax.enable_x64(kind == "float64"), jax.default_matmul_precision("highest"):
    out = outputs(fixture.arrays, fixture.params, fields, jnp.dtype(kind))
    prefix, bound = ("out64/", 1e-10) if kind == "float64" else ("out/", fixture.meta["tolerance"])
    wanted = fixture.under(prefix)
    assert wanted.keys() == out.keys()
    for key, array in wanted.items():
      difference = np.abs(np.asarray(out[key]) - array).max() / max(1, np.abs(array).max())
      assert out[key].dtype == kind
      assert difference < bound, (key, difference)


def test_names_go_both_ways_and_heads_are_ignored():
  fixture, fields = golden("distilbert")
  state = fixture.params
  released = {f"distilbert.{name}": array for name, array in state.items()} | {"vocab_projector.bias": np.zeros(3)}
  params = bert.params_from_reference(released, fields)
  back = params_to_reference(params, fields)
  assert back.keys() == state.keys()
  assert all((back[name] == state[name]).all() for name in state)
  with pytest.raises(ValueError, match="ffn.lin1.weight"):
    bert.params_from_reference({name: a for name, a in state.items() if "layer.1.ffn.lin1.weight" not in name}, fields)


def test_a_foreign_config_is_refused():
  with pytest.raises(ValueError, match="t5"):
    bert.bert_fields({"model_type": "t5"})
  with pytest.raises(ValueError, match="lacks"):
    bert.bert_fields({"model_type": "bert", "vocab_size": 3})
