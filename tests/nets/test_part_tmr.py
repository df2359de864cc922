"""The teacher is the reference's: six streams, frame features, heads, contrast."""
import flax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.models import tmr
from motion_jax.models.tmr.weight_names import TMR_PARTS, part_tmr_from_torch, part_tmr_names
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


@golden("part_tmr")
def run_part_tmr(fixture, dtype):
  teacher, bert, params = network(fixture, dtype)
  x, hidden = jnp.asarray(fixture["in/motion"], dtype), jnp.asarray(fixture["in/hidden"], dtype)
  ids, text_mask = jnp.asarray(fixture["in/input_ids"]), jnp.asarray(fixture["in/attention_mask"], bool)
  apply = lambda motion, *args, method: teacher.apply({"params": motion}, *args, method=method)

  def loss(motion, params):
    params = {**params, "motion": motion}
    made = {"motion_unit": tmr.embed_motion(teacher, params, x, None),
            "text_unit": tmr.embed_text(teacher, bert, params, ids, text_mask)}
    value, made["logits"] = tmr.info_nce(made["text_unit"], made["motion_unit"],
                                                 apply(motion, method="scale"))
    return value, {**made, "loss": value}

  @jax.jit
  def run(params):
    motion = params["motion"]
    (_, made), grads = jax.value_and_grad(loss, has_aux=True)(motion, params)
    made["text_hidden"] = bert.apply({"params": params["text"]}, ids, text_mask)
    made |= {"frame_features": apply(motion, x, method="hidden").swapaxes(0, 1),
             "frame_embeddings": apply(motion, x, method="frames").swapaxes(0, 1),
             "clip_embedding": apply(motion, x, method="motion_vector"),
             "text_head": apply(motion, hidden[:, 0], method="text_head"),
             "text_embedding": apply(motion, made["text_hidden"][:, 0], method="text_head")}
    return made, grads

  made, grads = run(params)
  streams = jax.jit(lambda motion: apply(motion, x, method="split"))(params["motion"])
  made |= {f"parts/{theirs}": streams[ours] for theirs, ours in TMR_PARTS.items()}
  flat = flax.traverse_util.flatten_dict(grads, sep="/")
  leaves = {"dense": (("weight", "kernel"), ("bias", "bias")), "norm": (("weight", "scale"), ("bias", "bias"))}
  for theirs, (ours, kind) in part_tmr_names(0).items():
    for suffix, leaf in leaves.get(kind, ()):
      made[f"grad/{theirs}.{suffix}"] = flat[f"{ours}/{leaf}"].T
  made["grad/logit_scale"] = flat["logit_scale"]
  return made


@recordings("part_tmr")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


TWO = part_columns("full")[:2]  # of six parts, which would be the same network six times


def _small(pool="real", parts=TWO):
  fields = dict(width=8, depth=1, num_heads=2, mlp_width=8, dim=4, pool=pool)
  teacher = PartTMR(parts=parts, **fields)
  x = jnp.asarray(np.random.default_rng(0).normal(size=(2, 12, 263)), jnp.float32)
  return teacher, untrained(jax.eval_shape(teacher.init, jax.random.key(1), x, jnp.zeros((2, 6)))), x


def test_parameter_count_is_the_references():
  """117,443,585 with DistilBERT's 66,362,880 (docs/papers/cmdm.md#part-tmr)."""
  text = bert_fields(dict(model_type="distilbert", vocab_size=30522, dim=768, n_layers=6, n_heads=12, hidden_dim=3072))
  shapes = tmr.teacher_shapes(PartTMR(parts=part_columns("full")), text)
  count = lambda tree: sum(a.size for a in jax.tree.leaves(tree))
  assert count(shapes) == 117_443_585 and count(shapes["text"]) == 66_362_880
  assert count({k: v for k, v in shapes["motion"].items() if k.endswith(("leg", "arm", "root", "bone"))}) == 50_619_904


@pytest.mark.parametrize("pool", ["real", "token"])
def test_padding_is_invisible_where_the_pool_says_so(pool):
  teacher, params, x = _small(pool)
  clip = jax.jit(lambda x, mask: teacher.apply(params, x, mask, method="motion_vector"))
  mask = jnp.arange(12) < jnp.array([[12], [7]])
  short = clip(x[1:, :7], jnp.ones((1, 7), bool))
  assert np.allclose(clip(x.at[1, 7:].set(9.0), mask)[1], short[0], atol=1e-5)
  assert not np.allclose(clip(x[1:], jnp.ones((1, 12), bool)), short, atol=1e-3)


def test_the_released_pool_sees_padding():
  """Parity: the mean is over all frames, padding included."""
  teacher, params, x = _small("all")
  clip = jax.jit(lambda x: teacher.apply(params, x, jnp.arange(12)[None] < 7, method="motion_vector"))
  assert not np.allclose(clip(x), clip(x.at[:, 7:].set(0.0)), atol=1e-3)


def test_the_teacher_looks_both_ways():
  teacher, params, x = _small()
  frames = jax.jit(lambda x: teacher.apply(params, x, method="frames"))
  changed = np.abs(frames(x.at[:, -1].add(5.0)) - frames(x)).max((0, 2))
  assert (changed > 0).all()


def test_a_teacher_without_parts_is_one_part():
  teacher, params, x = _small(parts=whole_body("full"))
  assert teacher.apply(params, x, method="split")["body"].shape == x.shape
  assert sum(name.startswith("motion_") for name in params["params"]) == 2  # the body and the head


def test_a_wrong_pool_is_told():
  with pytest.raises(ValueError, match="expected all, real or token"):
    _small("mean")
