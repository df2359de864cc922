"""The motion-language teacher of CMDM: motions and sentences in one space, trained by contrast (facts: cmdm 3)."""
import jax
import jax.numpy as jnp

from motion_jax.metrics.evaluators import symmetric_cross_entropy
from motion_jax.motion.features import get_layout
from motion_jax.motion.parts import chain_columns, part_columns, whole_body
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.motion_patches import MotionPatches
from motion_jax.nets.part_tmr import PartTMR
from motion_jax.stage import Stage
from motion_jax.text.bert import Bert


def unit(x):
  """x / |x| over the last axis."""
  return x / jnp.maximum(jnp.linalg.norm(x, axis=-1, keepdims=True), 1e-12)


def info_nce(text, motion, scale, same=None):
  """Symmetric contrast: the mean of two cross-entropies over text (B, E) and motion (B, E), both of unit length.

  same (B, B): pairs that say the same and are no counter-examples; the code has no such filter (Parity).
  Returns (loss, logits (B, B), rows are texts).
  """
  logits = scale * text @ motion.T
  seen = logits
  if same is not None:
    seen = jnp.where(same & ~jnp.eye(len(logits), dtype=bool), jnp.finfo(logits.dtype).min, logits)
  return symmetric_cross_entropy(seen), logits


def make_teacher(fields, layout):
  """The motion network that config.model names: kind part_tmr, tmr or motion_patches, and the fields of the module."""
  fields = dict(fields)
  kind = fields.pop("kind", "part_tmr")
  if kind == "part_tmr":
    return PartTMR(parts=part_columns(layout), **fields)
  if kind == "tmr":
    return PartTMR(parts=whole_body(layout), **fields)
  if kind == "motion_patches":
    return MotionPatches(chains=chain_columns(layout), **fields)
  raise ValueError(f"got teacher kind {kind!r}, expected part_tmr, tmr or motion_patches")


def init_teacher(teacher, bert, layout, rng):
  """Random parameters of a teacher: {"motion": ..., "text": ...}."""
  motion_rng, text_rng = jax.random.split(rng)
  x = jnp.zeros((1, 4, get_layout(layout).dim))
  return {"motion": teacher.init(motion_rng, x, jnp.zeros((1, bert.width)))["params"],
          "text": bert.init(text_rng, jnp.zeros((1, 1), jnp.int32), jnp.ones((1, 1), bool))["params"]}


def teacher_shapes(teacher, text_fields, layout="full"):
  """Shapes of a teacher run's parameters, to check a file against."""
  return jax.eval_shape(lambda: init_teacher(teacher, Bert(**text_fields), layout, jax.random.key(0)))


def embed_text(teacher, bert, params, ids, text_mask, pool="first", deterministic=True, rngs=None):
  """Unit vectors (B, E) of sentences given as word pieces. pool: the first piece's state, or the mean of all."""
  hidden = bert.apply({"params": params["text"]}, ids, text_mask)
  if pool == "first":
    hidden = hidden[:, 0]
  else:
    weight = text_mask[..., None].astype(hidden.dtype)
    hidden = (hidden * weight).sum(1) / weight.sum(1)
  return unit(teacher.apply({"params": params["motion"]}, hidden, deterministic, method="text_head", rngs=rngs))


def embed_motion(teacher, params, x, frame_mask, deterministic=True, rngs=None):
  """Unit vectors (B, E) of motions x (B, T, F), normalized features."""
  return unit(teacher.apply({"params": params["motion"]}, x, frame_mask, deterministic, method="clip", rngs=rngs))


def teacher_stage(config, axis_name="devices") -> Stage:
  """Trains the teacher. Batch: features (B, T, F), num_frames (B,), ids (B, S), text_mask (B, S), index (B,).

  The contrast is over the whole batch: what lies on other devices is gathered, so that N devices learn what one does.
  axis_name is the devices' axis of the train step, None outside of one. The text transformer's weights come with
  `init` from the named encoder (`training`), and `params["text"]` learns at its own rate (optimizer.rates).
  """
  teacher = make_teacher(config.model, config.data.layout)
  bert = Bert(**config.text)
  whole = (lambda a: a) if axis_name is None else (lambda a: jax.lax.all_gather(a, axis_name, tiled=True))

  def init(batch, rng):
    return init_teacher(teacher, bert, config.data.layout, rng)

  def loss(params, frozen, batch, step, rng):
    # Dropout masks differ from device to device, as the batch they fall on does.
    drop_rng = jax.random.fold_in(rng, batch["index"][0])
    rngs = lambda i: {"dropout": jax.random.fold_in(drop_rng, i)}
    frame_mask = padding_mask(batch["num_frames"], batch["features"].shape[1])
    motion = embed_motion(teacher, params, batch["features"], frame_mask, False, rngs(0))
    text = embed_text(teacher, bert, params, batch["ids"], batch["text_mask"], config.loss.text_pool, False, rngs(1))
    ids = whole(batch["ids"])
    same = (ids[:, None] == ids[None]).all(-1) if config.loss.skip_same_caption else None
    scale = teacher.apply({"params": params["motion"]}, method="scale")
    value, logits = info_nce(whole(text), whole(motion), scale, same)
    hit = (logits.argmax(0) == jnp.arange(len(logits))).mean()
    return {"loss": value, "batch_recall": hit}, 1.0

  def predict(params, frozen, batch, rng):
    frame_mask = padding_mask(batch["num_frames"], batch["features"].shape[1])
    return {"motion": embed_motion(teacher, params, batch["features"], frame_mask),
            "text": embed_text(teacher, bert, params, batch["ids"], batch["text_mask"], config.loss.text_pool)}

  return Stage(init, loss, predict)


def frame_features(teacher, params, x):
  """The frozen teacher's feature of every frame (B, T, E) of windows without padding (facts: cmdm 3.4)."""
  return teacher.apply({"params": params}, x, method="frames")
