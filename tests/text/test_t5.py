"""Our T5 encoders give the reference's numbers, and take their half of a whole T5."""
import flax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.text import t5
from motion_jax.text.bert import mean_words
from tests import fixtures
from tests.golden import Fixture, check, golden
from tests.text.reference import mean_sentence


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


def test_buckets_grow_with_distance():
  rows = t5.distance_buckets(np.arange(-300, 301))
  assert rows[300] == 0 and rows[299] == 1 and rows[301] == 17  # itself, the word before, the word behind
  assert rows[0] == 15 and rows[-1] == 31                       # the last row of each half: all that is far
  assert (np.diff(rows[301:]) >= 0).all() and (np.diff(rows[:301]) <= 0).all()


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


def test_options_that_it_does_not_have():
  with pytest.raises(ValueError, match="mt5"):
    t5.t5_fields({"model_type": "mt5"})
  with pytest.raises(ValueError, match="gated-swish"):
    t5.t5_fields({"model_type": "t5", "feed_forward_proj": "gated-swish"})
  with pytest.raises(ValueError, match="lacks"):
    t5.t5_fields({"model_type": "t5", "vocab_size": 3})


@pytest.mark.parametrize("changes, count", [({"d_ff": 3072}, 109_628_544),
                                            ({"d_ff": 2048, "feed_forward_proj": "gated-gelu"}, 109_628_544)])
def test_the_sizes_of_base(changes, count):
  base = dict(model_type="t5", vocab_size=32128, d_model=768, d_kv=64, num_layers=12, num_heads=12)
  fields = t5.t5_fields(base | changes)
  ids = jnp.zeros((1, 8), jnp.int32)
  shapes = jax.eval_shape(t5.T5Encoder(**fields).init, jax.random.key(0), ids, ids == 0)["params"]
  assert sum(leaf.size for leaf in jax.tree.leaves(shapes)) == count
  assert {path[:-1] for path in flax.traverse_util.flatten_dict(shapes)} == set(t5.names(fields))
