"""Our CLIP text transformer gives the reference's numbers, and takes its half of a whole CLIP."""
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
