"""Motion-language teachers of CMDM: motions and sentences in one space (docs/papers/cmdm.md#part-tmr).

  kind            network                                        sentences by                     training
  part_tmr        a transformer per body part                    a text transformer that learns   `teacher_stage`
  whole_body      the same with one part                         as above                         `teacher_stage`
  motion_patches  a vision transformer on an image of joints     as above                         `teacher_stage`
  tmr             Gaussians of motion and sentence, a decoder    a frozen one                     `tmr.tmr_stage`

A space (`make_space`) is what retrieval, judging and the tokenizer's alignment see of any of them.
"""
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from ml_collections import ConfigDict

from motion_jax import shapes
from motion_jax.evaluators.networks import symmetric_cross_entropy
from motion_jax.motion.body_parts import chain_columns, part_columns, whole_body
from motion_jax.motion.representations import Representation, get_layout
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.motion_patches import MotionPatches
from motion_jax.nets.part_tmr import PartTMR
from motion_jax.nets.tmr import TMR
from motion_jax.shapes import Array, Net
from motion_jax.text.bert import Bert
from motion_jax.text.encoder import TextEncoder
from motion_jax.training.stage import Stage


def unit(x: Float[Array, "*lead e"]) -> Float[Array, "*lead e"]:
  """x / |x| over the last axis."""
  return x / jnp.maximum(jnp.linalg.norm(x, axis=-1, keepdims=True), 1e-12)


def info_nce(text: Float[Array, "b e"], motion: Float[Array, "b e"], scale: Any, same: Bool[Array, "b b"] | None = None
             ) -> tuple[Float[Array, ""], Float[Array, "b b"]]:
  """Symmetric contrast: the mean of two cross-entropies over text (B, E) and motion (B, E), both of unit length.

  same (B, B): pairs that say the same and are no counter-examples; the code has no such filter (Parity).
  Returns (loss, logits (B, B), rows are texts).
  """
  shapes.check(text=(text, "BE"), motion=(motion, "BE"))
  logits = scale * text @ motion.T
  seen = logits
  if same is not None:
    seen = jnp.where(same & ~jnp.eye(len(logits), dtype=bool), jnp.finfo(logits.dtype).min, logits)
  return symmetric_cross_entropy(seen), logits


Teacher = PartTMR | TMR | MotionPatches

KINDS: dict[str, tuple[Any, Callable[..., dict[str, Any]]]] = {
    "part_tmr": (PartTMR, lambda layout: {"parts": part_columns(layout)}),
    "whole_body": (PartTMR, lambda layout: {"parts": whole_body(layout)}),
    "tmr": (TMR, lambda layout: {"features": get_layout(layout).dim}),
    "motion_patches": (MotionPatches, lambda layout: {"chains": chain_columns(layout)}),
}


def make_teacher(fields: Mapping[str, Any], layout: Representation | str) -> Teacher:
  """The motion network that config.model names: its kind, and the fields of the module.

  A field "layout" goes before the layout given: a teacher may read another one than what it teaches on (`as_seen`).
  """
  fields = dict(fields)
  kind, layout = fields.pop("kind", "part_tmr"), fields.pop("layout", layout)
  if kind not in KINDS:
    raise ValueError(f"got teacher kind {kind!r}, expected one of {', '.join(KINDS)}")
  module, columns = KINDS[kind]
  known = {field.name for field in dataclasses.fields(module)} - {"parent", "name"} - columns(layout).keys()
  if fields.keys() - known:
    raise ValueError(f"got the fields {', '.join(sorted(fields.keys() - known))} for a teacher of kind {kind!r}, which "
                     f"has {', '.join(sorted(known))}; what was kind 'tmr' and had heads is now kind 'whole_body'")
  return module(**columns(layout), **fields)


def init_teacher(teacher: Teacher, text_fields: Mapping[str, Any], layout: Representation | str, rng: jax.Array
                 ) -> dict[str, Any]:
  """Random parameters of a teacher: {"motion": ..., "text": ...}; a TMR, whose text transformer is frozen, has no text.

  text_fields: of the `Bert` that learns with it, or, for a TMR, {"width": numbers a word}.
  """
  motion_rng, text_rng = jax.random.split(rng)
  x, width = jnp.zeros((1, 4, get_layout(layout).dim)), text_fields["width"]
  if isinstance(teacher, TMR):
    return {"motion": teacher.init(motion_rng, x, jnp.ones((1, 4), bool), jnp.zeros((1, 1, width)),
                                   jnp.ones((1, 1), bool))["params"]}
  bert = Bert(**text_fields)
  return {"motion": teacher.init(motion_rng, x, jnp.zeros((1, width)))["params"],
          "text": bert.init(text_rng, jnp.zeros((1, 1), jnp.int32), jnp.ones((1, 1), bool))["params"]}


def teacher_shapes(teacher: Teacher, text_fields: Mapping[str, Any], layout: Representation | str = "full"
                   ) -> dict[str, Any]:
  """Shapes of a teacher run's parameters, to check a file against."""
  return jax.eval_shape(lambda: init_teacher(teacher, text_fields, layout, jax.random.key(0)))


class Space(NamedTuple):
  """Motions and sentences in one space, as pure functions, whatever the kind of the teacher."""
  net: Any
  init: Callable    # (rng) -> params
  motion: Callable  # (params, x (B, T, F) normalized, frame_mask (B, T)) -> unit vectors (B, E)
  text: Callable    # (params, *read) -> unit vectors (B, E)
  read: Callable    # (encoder, captions, rows) -> {name: array (B, ...)}, what `text` takes, in this order


def make_space(config: ConfigDict) -> Space:
  """The space of a teacher's config: model, text, data.layout, data.max_words, loss.text_pool."""
  layout, fields = config.data.layout, {**config.text}
  net: Any = make_teacher(config.model, layout)
  init = lambda rng: init_teacher(net, fields, layout, rng)
  motion = lambda params, x, frame_mask: embed_motion(net, params, x, frame_mask)
  if isinstance(net, TMR):
    def text_of_words(params, text_emb, text_mask):
      latents: Any = net.apply({"params": params["motion"]}, text_emb, text_mask, method="text")
      return unit(latents)

    return Space(net, init, motion, text_of_words, word_features)
  bert = Bert(**fields)

  def text(params, ids, text_mask):
    return embed_text(net, bert, params, ids, text_mask, config.loss.text_pool)

  return Space(net, init, motion, text, lambda encoder, captions, rows=slice(None): word_pieces(
      encoder, captions, config.data.max_words, rows))


def word_pieces(encoder: TextEncoder, captions: Sequence[str], at_least: int, rows: slice = slice(None)
                ) -> dict[str, np.ndarray]:
  """Word pieces of these rows of captions: {"ids": (B, S), "text_mask": (B, S)}, S as `TextEncoder.pieces` has it."""
  return {name: array[rows] for name, array in zip(("ids", "text_mask"), encoder.pieces(captions, at_least))}


def word_features(encoder: TextEncoder, captions: Sequence[str], rows: slice = slice(None), step: int = 32
                  ) -> dict[str, np.ndarray]:
  """A frozen encoder's features of the words of these rows of captions, none cut: {"text_emb": (B, S, W), "text_mask":
  (B, S)}.

  S is a multiple of step, so that few lengths are compiled.
  """
  text_emb, text_mask = encoder(captions, rows=rows)
  more = -text_mask.shape[1] % step
  return {"text_emb": np.pad(text_emb, ((0, 0), (0, more), (0, 0))),
          "text_mask": np.pad(text_mask, ((0, 0), (0, more)))}


def embed_text(teacher: Net, bert: Net, params: Any, ids: Int[Array, "b s"], text_mask: Bool[Array, "b s"],
               pool: str = "first", deterministic: bool = True, rngs: Any = None) -> Float[Array, "b e"]:
  """Unit vectors (B, E) of sentences given as word pieces. pool: the first piece's state, or the mean of all."""
  hidden = bert.apply({"params": params["text"]}, ids, text_mask)
  if pool == "first":
    hidden = hidden[:, 0]
  else:
    weight = text_mask[..., None].astype(hidden.dtype)
    hidden = (hidden * weight).sum(1) / weight.sum(1)
  return unit(teacher.apply({"params": params["motion"]}, hidden, deterministic, method="text_head", rngs=rngs))


def embed_motion(teacher: Net, params: Any, x: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"],
                 deterministic: bool = True, rngs: Any = None) -> Float[Array, "b e"]:
  """Unit vectors (B, E) of motions x (B, T, F), normalized features."""
  return unit(teacher.apply({"params": params["motion"]}, x, frame_mask, deterministic, method="motion_vector",
                            rngs=rngs))


def teacher_stage(config: ConfigDict, axis_name: str | None = "devices") -> Stage:
  """Trains the teacher. Batch: features (B, T, F), num_frames (B,), ids (B, S), text_mask (B, S), index (B,).

  The contrast is over the whole batch: what lies on other devices is gathered, so that N devices learn what one does.
  axis_name is the devices' axis of the train step, None outside of one. The text transformer's weights come with
  `init` from the named encoder (`training`), and `params["text"]` learns at its own rate (optimizer.rates).
  """
  space = make_space(config)
  teacher, bert = space.net, Bert(**config.text)
  whole = (lambda a: a) if axis_name is None else (lambda a: jax.lax.all_gather(a, axis_name, tiled=True))

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
    return {"motion": space.motion(params, batch["features"], frame_mask),
            "text": space.text(params, batch["ids"], batch["text_mask"])}

  return Stage(lambda batch, rng: space.init(rng), loss, predict,
               about_loss="cross-entropy of finding a motion's caption in its batch and back")


# --- teaching ----------------------------------------------------------------------------------------------------


def check_readable(layout: Representation | str, own_layout: Representation | str) -> None:
  """Raises ValueError where windows in `layout` do not hold what a teacher of own_layout reads."""
  ours, theirs = get_layout(layout), get_layout(own_layout)
  if not ours.narrows_to(theirs):
    raise ValueError(f"a teacher of layout {theirs.name!r} cannot read windows of layout {ours.name!r}, only those of "
                     "its own layout, one that it is a part of or, if it is coordinates, one with the same joints; "
                     "train it on such data")


def as_seen(x: Float[Array, "b t f"], view: Mapping[str, Array], layout: Representation | str,
            own_layout: Representation | str) -> Float[Array, "b t g"]:
  """Windows (B, T, F) of a tokenizer as its teacher reads them (B, T, G), in its own layout and statistics.

  view: "mean" and "std" of x, "own_mean" and "own_std" of the teacher. A window is a clip of its own: its joints start
  at the origin, facing +z.
  """
  seen: Any = x * view["std"] + view["mean"]
  seen = get_layout(layout).narrow_to(seen, get_layout(own_layout))
  return (seen - view["own_mean"]) / view["own_std"]


def motion_side(teacher: Teacher, params: Any) -> Any:
  """What of a teacher's parameters gives frame features: of a TMR neither its text encoder nor its decoder."""
  motion = params["motion"]
  return {"motion_encoder": motion["motion_encoder"]} if isinstance(teacher, TMR) else motion


def frame_features(teacher: Net, params: Any, x: Float[Array, "b t f"]) -> Float[Array, "b t e"]:
  """The frozen teacher's feature of every frame (B, T, E) of windows without padding.

  Source: docs/papers/cmdm.md#teacher-features.
  """
  return teacher.apply({"params": params}, x, method="frames")
