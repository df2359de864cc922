"""Conversion of the benchmarks' released evaluators.

Source: docs/papers/cmdm.md#checkpoint-names, docs/papers/cdamd.md#evaluation.
"""
import jax
import jax.numpy as jnp

from motion_jax.convert.parts import Network, check_free, heads_of, network, read_part, stats_of, write
from motion_jax.convert.state import load_state
from motion_jax.evaluators.networks import ClipEvaluator, T2MEvaluator
from motion_jax.evaluators.weight_names import CLIP_EVALUATOR_IGNORED, clip_evaluator_names, t2m_evaluator_names
from motion_jax.evaluators.words import CONVERTED, load_words
from motion_jax.motion.representations import LAYOUTS
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.training.setup import text_identity

T2M = ("movement_encoder", "motion_encoder", "text_encoder")


def evaluator(path, num_heads=None) -> Network:
  """A released evaluator, recognized by its tensors: T2M's (259 or 67 numbers per frame) or MARDM's CLIP-type one."""
  names = load_state(path)
  if any(name.startswith("contrast_model/") or name == "token_embedding.weight" for name in names):
    return _clip_evaluator(path, num_heads)
  what, part = "T2M evaluator", read_part(path, T2M, others=("movement_decoder",))
  movement_width, features, _ = part.shape("movement_encoder/main.0.weight", what, 3)
  # 259 of 263 and 247 of 251: it reads full features without their contacts.
  with_contacts = {layout["contacts"].start: layout.dim for layout in LAYOUTS.values()
                   if "contacts" in layout.blocks and not layout.joints_suffice}
  fields = dict(features=features, columns=with_contacts.get(features, features),
                movement_width=movement_width, movement_dim=part.shape("movement_encoder/main.3.weight", what, 3)[0],
                motion_width=part.shape("motion_encoder/input_emb.weight", what, 2)[0],
                text_width=part.shape("text_encoder/input_emb.weight", what, 2)[0],
                dim=part.shape("motion_encoder/output_net.3.weight", what, 2)[0])
  classes, words = part.shape("text_encoder/pos_emb.weight", what, 2)[::-1]
  module = T2MEvaluator(**fields)
  length = jnp.ones(1, jnp.int32)
  shapes = jax.eval_shape(lambda: module.init(jax.random.key(0), jnp.zeros((1, 4, words)), jnp.zeros((1, 4, classes)),
                                              length, jnp.zeros((1, 8, module.columns)), 8 * length))
  return network(what, part, module, fields, shapes, t2m_evaluator_names())


def _clip_evaluator(path, num_heads):
  what, part = "CLIP-type evaluator", read_part(path, ("contrast_model",))
  width, features = part.shape("motion_encoder.embed_motion.weight", what, 2)
  vocab_size, _ = part.shape("token_embedding.weight", what, 2)
  depth = part.count(r"motion_encoder\.transformer\.layers\.(\d+)\.")
  mlp_width, _ = part.shape("motion_encoder.transformer.layers.0.linear1.weight", what, 2)
  fields = dict(features=features, columns=features, width=width, depth=depth, num_heads=heads_of(num_heads, width, 8),
                mlp_width=mlp_width, dim=part.shape("out.weight", what, 2)[0], vocab_size=vocab_size,
                max_words=part.shape("positional_embedding", what, 2)[0])
  module = ClipEvaluator(**fields)
  shapes = jax.eval_shape(lambda: module.init(jax.random.key(0), jnp.zeros((1, 4), jnp.int32),
                                              jnp.zeros((1, 4, features)), jnp.ones(1, jnp.int32)))
  return network(what, part, module, fields, shapes, clip_evaluator_names(depth),
                  CLIP_EVALUATOR_IGNORED)


def write_evaluator(out, file, stats, num_heads=None, glove=None, text=None):
  """Writes the folder of a released evaluator -> the Networks. stats: its own statistics, not those of the training
  data.

  Text input: glove, the benchmark's folder of word vectors, which is written beside the weights; text, the folder of
  the CLIP that a CLIP-type evaluator was trained on, which the config names. Without them `load_evaluator` needs
  `text`.
  """
  check_free(out)
  network = evaluator(file, num_heads)
  clip = isinstance(network.module, ClipEvaluator)
  if (glove and clip) or (text and not clip):
    raise ValueError(f"{file} is " + ("of CLIP's type, which reads word pieces: give --text-encoder" if clip else
                                      "T2M's evaluator, which reads word vectors: give --glove") + " instead")
  files, words = {}, load_words(glove) if glove else None
  if words:
    width = network.params["params"]["text_encoder"]["classes"]["kernel"].shape[-1]
    if words.dim != width:
      raise ValueError(f"{glove} has vectors of {words.dim} numbers, {file} was trained on {width}")
    files[CONVERTED] = words.to_bytes()
  columns = network.fields["columns"]
  stats = stats_of(stats, columns, ("Mean.npy", "eval_mean.npy", f"eval_mean_{columns}.npy"))
  config = dict(stage="evaluator.clip" if clip else "evaluator.t2m", model=network.fields,
                data=dict(layout=stats.layout.name))
  if text:
    config["frozen"], files[checkpoint.TEXT] = dict(text=str(text)), text_identity(load_text_encoder(text))
  write(out, config, [network], network.params, stats, files=files)
  return [network]
