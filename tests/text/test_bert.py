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


@pytest.mark.parametrize("name", [pytest.param("bert", marks=pytest.mark.slow), "distilbert"])
def test_parity(name):
  """Words that are padding in the recording among them: nothing of these is seen."""
  fixture, fields = golden(name)
  with jax.enable_x64(True), jax.default_matmul_precision("highest"):
    out = outputs(fixture.arrays, fixture.params, fields, jnp.float64)
    wanted = fixture.under("out64/")
    assert wanted.keys() == out.keys()
    for key, array in wanted.items():
      difference = np.abs(np.asarray(out[key]) - array).max() / max(1, np.abs(array).max())
      assert out[key].dtype == np.float64 and difference < 1e-10, (key, difference)


def test_released_names_are_read_and_heads_are_ignored():
  fixture, fields = golden("distilbert")
  released = {f"distilbert.{name}": array for name, array in fixture.params.items()}
  released["vocab_projector.bias"] = np.zeros(3)
  back = params_to_reference(bert.params_from_reference(released, fields), fields)
  assert back.keys() == fixture.params.keys() and all((back[name] == a).all() for name, a in fixture.params.items())
