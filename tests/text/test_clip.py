"""Our CLIP text transformer gives the reference's numbers, and takes its half of a whole CLIP."""
import flax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.text import clip
from tests import fixtures
from tests.golden import Fixture, check, golden


def network(fixture):
  """(module's fields, float32 state dict) of a recorded small network."""
  return clip.clip_fields({"model_type": "clip_text_model", **fixture.config["net"]}), fixture.params


@golden("clip_text")
def run_clip_text(fixture, dtype):
  fields, state = network(fixture)
  model, params = clip.ClipText(**fields, dtype=dtype), clip.params_from_reference(state, fields, dtype)
  apply = jax.jit(model.apply, static_argnames="method")
  run = lambda method, *args: apply({"params": params}, *args, method=method)
  ids, mask = jnp.asarray(fixture["in/input_ids"]), jnp.asarray(fixture["in/attention_mask"]) > 0
  made = {f"hidden/{i}": state for i, state in enumerate(run("hidden_states", ids, mask))}
  return made | {"last": run("__call__", ids, mask), "pooled": run("pooled", ids, mask),
                 "embeds": run("sentence", ids, mask), "last_no_mask": run("__call__", ids),
                 "embeds_no_mask": run("sentence", ids)}


@pytest.fixture(scope="module")
def recorded():
  return network(Fixture(fixtures.path("text/clip_text.npz")))


@pytest.mark.slow
def test_parity():
  assert not check(fixtures.path("text/clip_text.npz")).failures


def test_a_whole_clip_model_loads_without_its_picture_half(recorded):
  fields, state = recorded
  other = {"vision_model.embeddings.class_embedding": np.zeros(3), "visual_projection.weight": np.zeros((2, 3)),
           "logit_scale": np.ones(()), "text_model.embeddings.position_ids": np.arange(16)[None]}
  part, whole = (clip.params_from_reference(s, fields) for s in (state, state | other))
  assert jax.tree.all(jax.tree.map(lambda a, b: bool((a == b).all()), part, whole))
  config = {"model_type": "clip", "projection_dim": 24, "text_config": {"hidden_size": 32, "eos_token_id": 2}}
  assert clip.clip_fields(config)["width"] == 32 and clip.clip_fields(config)["projection_dim"] == 24
  assert clip.clip_fields(config)["end_id"] is None and clip.clip_fields(config)["num_layers"] == 12


def test_the_old_end_token_means_the_largest_id(recorded):
  fields, state = recorded
  params = {"params": clip.params_from_reference(state, fields)}
  ids = jnp.array([[88, 5, 17, 89, 0, 0], [88, 3, 60, 4, 7, 89]])
  named, largest = (jax.jit(lambda ids, end=end: clip.ClipText(**fields | {"end_id": end}).apply(
      params, ids, method="sentence"))(ids) for end in (89, None))
  assert (named == largest).all()


def test_options_that_it_does_not_have():
  with pytest.raises(ValueError, match="bert"):
    clip.clip_fields({"model_type": "bert"})
  with pytest.raises(ValueError, match="swish"):
    clip.clip_fields({"model_type": "clip_text_model", "hidden_act": "swish"})
  assert clip.clip_fields({"model_type": "clip_text_model", "hidden_act": "gelu"})["activation"] == "gelu"


def test_the_size_of_vit_b_32():
  fields = clip.clip_fields({"model_type": "clip"})
  shapes = jax.eval_shape(clip.ClipText(**fields).init, jax.random.key(0), jnp.zeros((1, 77), jnp.int32))["params"]
  # CLIPTextModelWithProjection of openai/clip-vit-base-patch32, and of patch16, whose text half is as large.
  assert sum(leaf.size for leaf in jax.tree.leaves(shapes)) == 63_165_952 + 512 * 512
  flat = {path[:-1] for path in flax.traverse_util.flatten_dict(shapes)}
  assert flat == set(clip.names(fields))
