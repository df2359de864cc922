"""Networks of the teachers, and the space of motions and captions that each of them spans.

  kind            network                                        captions by                      training
  part_tmr        a transformer per body part                    a text transformer that learns   `contrastive_stage`
  whole_body      the same with one part                         as above                         `contrastive_stage`
  motion_patches  a vision transformer on an image of joints     as above                         `contrastive_stage`
  tmr             Gaussians of motion and caption, a decoder     a frozen one                     `tmr_stage`

Retrieval, evaluation and the alignment of a tokenizer know a teacher only by its `Space`, which `make_space` makes.
"""
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from ml_collections import ConfigDict

from motion_jax.models.tmr.losses import unit
from motion_jax.motion.body_parts import chain_columns, part_columns, whole_body
from motion_jax.motion.representations import Representation, get_layout
from motion_jax.nets.motion_patches import MotionPatches
from motion_jax.nets.part_tmr import PartTMR
from motion_jax.nets.tmr import TMR
from motion_jax.shapes import Array, Bool, Float, Int, Net
from motion_jax.text.bert import Bert
from motion_jax.text.encoder import TextEncoder

Teacher = PartTMR | TMR | MotionPatches

KINDS: dict[str, tuple[Any, Callable[..., dict[str, Any]]]] = {
    "part_tmr": (PartTMR, lambda layout: {"parts": part_columns(layout)}),
    "whole_body": (PartTMR, lambda layout: {"parts": whole_body(layout)}),
    "tmr": (TMR, lambda layout: {"features": get_layout(layout).dim}),
    "motion_patches": (MotionPatches, lambda layout: {"chains": chain_columns(layout)}),
}


def make_teacher(fields: Mapping[str, Any], layout: Representation | str) -> Teacher:
  """The motion network of config.model: its kind, and the fields of the module.

  A field "layout" takes precedence over the layout given: a teacher may read another layout than its tokenizer
  (`as_seen`).
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

  text_fields: of the `Bert` that is trained with it, or, for a TMR, {"width": size of a word feature}.
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
  """Shapes of the parameters of a teacher's run."""
  return jax.eval_shape(lambda: init_teacher(teacher, text_fields, layout, jax.random.key(0)))


class Space(NamedTuple):
  """Motions and captions in one space, as pure functions, for any kind of teacher."""
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
  """Word features of a frozen encoder for these rows of captions, without cutting: {"text_emb": (B, S, W), "text_mask":
  (B, S)}.

  S is a multiple of step, so that few lengths are compiled.
  """
  text_emb, text_mask = encoder(captions, rows=rows)
  more = -text_mask.shape[1] % step
  return {"text_emb": np.pad(text_emb, ((0, 0), (0, more), (0, 0))),
          "text_mask": np.pad(text_mask, ((0, 0), (0, more)))}


def embed_text(teacher: Net, bert: Net, params: Any, ids: Int[Array, "b s"], text_mask: Bool[Array, "b s"],
               pool: str = "first", deterministic: bool = True, rngs: Any = None) -> Float[Array, "b e"]:
  """Unit vectors (B, E) of captions given as word pieces. pool: the first piece's state, or the mean of all."""
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
