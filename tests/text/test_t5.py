"""Our T5 encoders give the reference's numbers, and take their half of a whole T5."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.text import t5
from tests import fixtures
from tests.golden import Fixture, check, golden
from tests.text.reference import mean_sentence, mean_words


def network(fixture):
  """(module's fields, float32 state dict) of a recorded small network."""
  return t5.t5_fields({"model_type": "t5", **fixture.config["net"]}), fixture.params


@golden("t5_v1_0")
@golden("t5_v1_1")
def run_t5(fixture, dtype):
  fields, state = network(fixture)
  model, params = t5.T5Encoder(**fields, dtype=dtype), {"params": t5.params_from_reference(state, fields, dtype)}
  ids, mask = jnp.asarray(fixture["in/input_ids"]), jnp.asarray(fixture["in/attention_mask"]) > 0
  apply = jax.jit(model.apply, static_argnames="method")
  states = apply(params, ids, mask, method="hidden_states")
  last, projection = apply(params, ids, mask), jnp.asarray(fixture["in/projection"], dtype)
  bias = model.apply(params, ids.shape[1], method="position_bias")[None]
  far = len(fixture["out/buckets"]) // 2
  buckets = t5.distance_buckets(np.arange(-far, far + 1), fields["num_buckets"], fields["max_distance"])
  return {f"hidden/{i}": state for i, state in enumerate(states)} | {
      "last": last, "mean": mean_words(last, mask), "sentence": mean_sentence(last, mask, projection),
      "position_bias": bias, "buckets": buckets}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["t5_v1_0", "t5_v1_1"])
def test_parity(name):
  assert not check(fixtures.path(f"text/{name}.npz")).failures


def test_a_whole_t5_loads_without_its_decoder():
  fields, state = network(Fixture(fixtures.path("text/t5_v1_1.npz")))
  table = state["shared.weight"]
  whole = state | {"decoder.final_layer_norm.weight": np.ones(3), "lm_head.weight": table,
                   "encoder.embed_tokens.weight": table}
  renamed = {name: a for name, a in whole.items() if name != "shared.weight"}  # some files keep the other name
  expected = t5.params_from_reference(state, fields)
  for other in (whole, renamed):
    made = t5.params_from_reference(other, fields)
    assert jax.tree.all(jax.tree.map(lambda a, b: bool((a == b).all()), expected, made))
  with pytest.raises(ValueError, match="two different word tables"):
    t5.params_from_reference(whole | {"encoder.embed_tokens.weight": table + 1}, fields)
