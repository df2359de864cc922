"""CMDM as four functions of fixed shapes, which run anywhere (`export.graphs`): a stream's step without JAX.

  text       word pieces -> keys and values of a caption, once a caption
  step       noise, captions -> one block further: `streaming.begin` and `streaming.iterate`
  decoder    a clean block -> normalized features of its frames
  joints     features -> joints, on the path of those before

The host draws the noise, keeps the captions and hands each state on; docs/onnx.md has the loop.
"""
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.export.graphs import Graph
from motion_jax.models.cmdm import streaming
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.shared.moving_path import Path, continue_path
from motion_jax.nets.causal_dit import Text
from motion_jax.utils.errors import InputError

CAPTIONS = 4  # different captions that a window shows at most


def graphs_of(model: CmdmNetworks, **sampling: Any) -> tuple[list[Graph], dict[str, Any]]:
  """(the four graphs of a model, what a host needs besides them: numbers, skeleton, tokenizer, licence).

  sampling: choices of `CmdmSampling`, which become constants of the graphs. Batch size 1, without constraints.
  """
  plan, chosen, contrast, about = model.plan_of(**sampling)
  if not plan.lag or plan.solver not in ("euler", "heun") or contrast is not None:
    raise InputError(f"got schedule {chosen.schedule!r} and solver {plan.solver!r}, expected a stream by fss or ar "
                     "with euler or heun, without contrast")
  if model.encoder.level != "words" or getattr(model.encoder.model, "vocab_size", None) is None:
    raise InputError(f"got the text encoder {model.encoder.name!r}, expected one of word pieces such as that of "
                     "cmdm-small")
  graphs = [_text(model), _step(model, plan, chosen.guidance_scale), _decoder(model, plan), _joints(model, plan)]
  return graphs, _about(model, plan, about)


def _about(model, plan, about):
  layout, latents = model.stats.layout, model.frames_per_latent
  return {
      "model": model.id, "license": model.license, "sampling": about,
      "constants": {
          "fps": model.fps, "block": plan.block, "frames_per_latent": latents, "frames_per_block": plan.block * latents,
          "latent_dim": model.dit.latent_dim, "num_steps": plan.num_steps, "lag": plan.lag, "age": plan.age,
          "width": plan.width, "context": plan.context, "memory": -1 if plan.memory is None else plan.memory,
          "captions": CAPTIONS, "words": model.encoder.max_words},
      "noise": "threefry2x32: key (0, seed); of block i fold_in(key, i), then jax.random.normal (block, latent_dim)",
      "skeleton": {"joints": list(layout.skeleton.joints), "parents": list(layout.skeleton.parents), "unit": "metre",
                   "axes": "y up, z ahead, x to the body's left"},
      "tokenizer": tokenizer_table(model.encoder.tokenizer), "known_words": sorted(model.encoder.known_words)}


def tokenizer_table(tokenizer: Any) -> dict[str, Any]:
  """Word pieces by number, and the numbers of the special ones, of a tokenizer of lower-case word pieces."""
  first, *_, last = tokenizer.encode("").ids
  return {"kind": "wordpiece", "lowercase": True, "unknown": tokenizer.token_to_id("[UNK]"), "first": first,
          "last": last, "pieces": sorted(tokenizer.get_vocab(), key=tokenizer.token_to_id)}


def _text(model):
  encoder, dit, params = model.encoder, model.dit, model.stacked
  words = encoder.max_words
  variables = {"params": encoder.params}

  def text(ids, mask):
    text_kv = streaming.encode_text(dit, params, encoder.model.apply(variables, ids, mask), mask, guided=False)
    return text_kv.k[:, 0], text_kv.v[:, 0]

  return Graph("text", text, {"ids": np.zeros((1, words), np.int32), "mask": np.ones((1, words), bool)},
               ["text_k", "text_v"], {}, {
                   "ids": "word pieces of a caption, special ones included, padded with 0",
                   "mask": "true = a real word piece", "text_k": "keys of the caption's words in each layer",
                   "text_v": "their values"})


def _step(model, plan, scale):
  dit, params, words = model.dit, model.stacked, model.encoder.max_words
  constants, null = streaming.make_constants(dit, params, plan), None
  if plan.guided:
    empty = np.zeros((1, 1, dit.text_dim), np.float32), np.ones((1, 1), bool)
    null = streaming.encode_text(dit, params, *empty, guided=True).null
  size = plan.block
  state = streaming.first_state(dit, plan.layout, 1, np)
  heads = (dit.depth, words, dit.num_heads, dit.width // dit.num_heads)

  def step(latents, cache_k, cache_v, oldest_k, oldest_v, noise, steps, past, length, caption, since, text_k, text_v,
           text_mask):
    now = streaming.window_at(plan, steps, past, caption, since, length[None])
    before = streaming.Stream(steps, latents, (cache_k, cache_v), (oldest_k, oldest_v), latents, past)
    before = streaming.begin(plan.layout, before, now, noise[:, None])
    side_by_side = lambda a: jnp.moveaxis(a, 0, 1).reshape(dit.depth, 1, CAPTIONS * words, *heads[2:])
    text = Text(side_by_side(text_k), side_by_side(text_v), text_mask[None], null)
    conditions = streaming.Conditions(params, constants, text, scale, None)
    after = streaming.iterate(dit, plan.layout, conditions, before, now, 0, plan.lag)
    finished = jnp.maximum(steps - plan.age + 1, 0) - now.blocks[0]
    block = jax.lax.dynamic_slice_in_dim(after.latents, finished * size, size, axis=1)
    return (block, after.latents, *after.cache, *after.oldest)

  inputs = {
      "latents": np.zeros_like(state.latents, np.float32),
      "cache_k": state.cache[0], "cache_v": state.cache[1], "oldest_k": state.oldest[0], "oldest_v": state.oldest[1],
      "noise": np.zeros((1, size, dit.latent_dim), np.float32), "steps": np.zeros((), np.int32),
      "past": np.zeros((), np.int32), "length": np.full((), 2**30, np.int32),
      "caption": np.zeros((1, plan.width), np.int32), "since": np.full((1, plan.width), -2**30, np.int32),
      "text_k": np.zeros((CAPTIONS, *heads), np.float32), "text_v": np.zeros((CAPTIONS, *heads), np.float32),
      "text_mask": np.zeros((CAPTIONS, words), bool)}
  states = {name: f"next_{name}" for name in ("latents", "cache_k", "cache_v", "oldest_k", "oldest_v")}
  return Graph("step", step, inputs, ["clean", *states.values()], states, {
      "noise": "of the block that begins, number `steps`; a given clean block where that is negative",
      "steps": "how many steps were done before; negative while given blocks are filled in",
      "past": "how many latents were given before block 0",
      "length": "latents of the motion, behind which nothing is seen; 2^30: no end",
      "caption": "which caption each block of the window has; its first block is max(steps - age, 0)",
      "since": "the first block that each block of the window sees; -2^30: any",
      "text_k": "keys of the captions, from the graph `text`", "text_v": "their values",
      "text_mask": "their word pieces, true = real",
      "clean": "the block that became clean, number steps - age + 1; means nothing while that is negative"})


def _decoder(model, plan):
  codec = model.codec
  state = jax.tree.map(np.asarray, codec.init_decode_state(1))
  leaves, tree = jax.tree.flatten(state)

  def decoder(latents, *contexts):
    features, after = codec.decode_step(latents, jax.tree.unflatten(tree, contexts))
    return (features, *jax.tree.leaves(after))

  names = [f"context_{i}" for i in range(len(leaves))]
  states = {name: f"next_{name}" for name in names}
  block = np.zeros((1, plan.block, model.dit.latent_dim), np.float32)
  return Graph("decoder", decoder, {"latents": block, **dict(zip(names, leaves))}, ["features", *states.values()],
               states, {"latents": "a clean block", "features": "normalized features of its frames"})


def _joints(model, plan):
  stats, frames = model.stats, plan.block * model.frames_per_latent

  def joints(features, row, heading, place):
    places, path = continue_path(stats.denormalize(features[0]), Path(row, heading, place), stats.layout)
    return places[None], *path

  inputs = {"features": np.zeros((1, frames, stats.layout.dim), np.float32),
            "row": np.zeros((1, stats.layout.dim), np.float32), "heading": np.array([1, 0, 0, 0], np.float32),
            "place": np.zeros(3, np.float32)}
  states = {name: f"next_{name}" for name in ("row", "heading", "place")}
  return Graph("joints", joints, inputs, ["joints", *states.values()], states, {
      "features": "of the graph `decoder`", "joints": "metres, in the world",
      "row": "the last frame's features, not normalized", "heading": "its heading (w, x, y, z)",
      "place": "its place on the ground"})
