"""The teacher is the reference's: six streams, frame features, heads, contrast."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.models import tmr
from motion_jax.models.tmr.weight_names import TMR_PARTS, part_tmr_from_torch
from motion_jax.motion.body_parts import part_columns, whole_body
from motion_jax.nets.part_tmr import PartTMR
from motion_jax.text.bert import Bert, bert_fields
from motion_jax.training.setup import untrained
from tests import fixtures
from tests.golden import check, golden, recordings


def network(fixture, dtype):
  sizes = fixture.config
  fields = bert_fields({"model_type": "distilbert", **sizes["text"]})
  teacher = PartTMR(sizes["width"], sizes["layers"], sizes["heads"], sizes["ff"], sizes["projection"],
                    parts=part_columns("full"), dtype=dtype)
  params = part_tmr_from_torch(fixture.params, fields, sizes["layers"])
  return teacher, Bert(**fields, dtype=dtype), jax.tree.map(lambda a: jnp.asarray(a, dtype), params)


@golden("part_tmr", leave_out=("grad/",))  # nothing changes a gradient on its way
def run_part_tmr(fixture, dtype):
  teacher, bert, params = network(fixture, dtype)
  x, hidden = jnp.asarray(fixture["in/motion"], dtype), jnp.asarray(fixture["in/hidden"], dtype)
  ids, text_mask = jnp.asarray(fixture["in/input_ids"]), jnp.asarray(fixture["in/attention_mask"], bool)
  apply = lambda motion, *args, method: teacher.apply({"params": motion}, *args, method=method)

  @jax.jit
  def run(params):
    motion = params["motion"]
    made = {"motion_unit": tmr.embed_motion(teacher, params, x, None),
            "text_unit": tmr.embed_text(teacher, bert, params, ids, text_mask)}
    made["loss"], made["logits"] = tmr.info_nce(made["text_unit"], made["motion_unit"], apply(motion, method="scale"))
    made["text_hidden"] = bert.apply({"params": params["text"]}, ids, text_mask)
    made |= {"frame_features": apply(motion, x, method="hidden").swapaxes(0, 1),
             "frame_embeddings": apply(motion, x, method="frames").swapaxes(0, 1),
             "clip_embedding": apply(motion, x, method="motion_vector"),
             "text_head": apply(motion, hidden[:, 0], method="text_head"),
             "text_embedding": apply(motion, made["text_hidden"][:, 0], method="text_head")}
    streams = apply(motion, x, method="split")
    return made | {f"parts/{theirs}": streams[ours] for theirs, ours in TMR_PARTS.items()}

  return run(params)


@pytest.mark.slow
@recordings("part_tmr")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


TWO = part_columns("full")[:2]  # of six parts, which would be the same network six times


def _small(pool="real", parts=TWO):
  fields = dict(width=8, depth=1, num_heads=2, mlp_width=8, dim=4, pool=pool)
  teacher = PartTMR(parts=parts, **fields)
  x = np.random.default_rng(0).normal(size=(2, 12, 263)).astype(np.float32)
  return teacher, untrained(jax.eval_shape(teacher.init, jax.random.key(1), x, jnp.zeros((2, 6)))), x


@pytest.mark.parametrize("pool", ["real", pytest.param("token", marks=pytest.mark.slow), "all"])
def test_padding_is_invisible_where_the_pool_says_so(pool):
  """Parity: in the released pool, "all", the mean is over all frames, padding included."""
  teacher, params, x = _small(pool)
  clip = jax.jit(lambda x, mask: teacher.apply(params, x, mask, method="motion_vector"))
  mask, other = np.arange(12) < np.array([[12], [7]]), x.copy()
  other[1, 7:] = 9.0
  made = clip(x, mask)[1]
  assert np.allclose(clip(other, mask)[1], made, atol=1e-5) == (pool != "all")
  if pool != "all":
    assert np.allclose(made, clip(x[1:, :7], np.ones((1, 7), bool))[0], atol=1e-5)
    assert not np.allclose(made, clip(x, np.ones((2, 12), bool))[1], atol=1e-3)


def test_a_teacher_without_parts_is_one_part_and_a_wrong_pool_is_refused():
  _, params, _ = _small(parts=whole_body("full"))
  assert sum(name.startswith("motion_") for name in params["params"]) == 2  # the body and the head
  with pytest.raises(ValueError, match="expected all, real or token"):
    _small("mean")
