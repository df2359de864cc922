"""Names of CDAMD's and MARDM's released weights: autoencoder, quantizer, generators."""
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from motion_jax.convert.state import Table, from_torch
from motion_jax.quant.vq import codebook_of


def autoencoder_names(num_halvings: int = 2, depth: int = 3) -> Table:
  """AE of CDAMD and MARDM (docs/papers/cdamd.md#autoencoder)."""
  last = 2 + num_halvings
  ends = {"encoder.model.0": "encoder/conv_in", f"encoder.model.{last}": "encoder/conv_out",
          "decoder.model.0": "decoder/conv_in", f"decoder.model.{last}": "decoder/conv_mid",
          f"decoder.model.{last + 2}": "decoder/conv_out"}
  table = {theirs: (f"{ours}/conv", "conv") for theirs, ours in ends.items()}
  for i in range(num_halvings):
    table |= {f"encoder.model.{2 + i}.0": (f"encoder/down{i}/conv", "conv"),
              f"decoder.model.{2 + i}.2": (f"decoder/up{i}/conv", "conv")}
    for half, place in (("encoder", 1), ("decoder", 0)):
      for b in range(depth):
        theirs, ours = f"{half}.model.{2 + i}.{place}.model.{b}", f"{half}/stack{i}_block{b}"
        table |= {f"{theirs}.conv1": (f"{ours}/conv/conv", "conv"),
                  f"{theirs}.conv2": (f"{ours}/pointwise", "pointwise")}
  return table


def rvq_names(num_levels: int = 4, num_halvings: int = 2, depth: int = 3) -> Table:
  """RVQ-VAE of CDAMD (docs/papers/cdamd.md#rvq), the codes of level q under codes/q."""
  levels = {f"quantizer.layers.{q}.codebook": (f"codes/{q}", "array") for q in range(num_levels)}
  return autoencoder_names(num_halvings, depth) | levels


def rvq_from_torch(state: Mapping[str, Any], num_levels: int = 4, num_halvings: int = 2, depth: int = 3
                   ) -> dict[str, Any]:
  """RVQ-VAE of CDAMD as it is used: {"params", "codebooks"} with all fields of `quant.vq.Codebook`."""
  params = from_torch(state, rvq_names(num_levels, num_halvings, depth))["params"]
  codes = params.pop("codes")
  book = codebook_of(np.stack([codes[str(q)] for q in range(num_levels)]))
  return {"params": params, "codebooks": jax.tree.map(np.asarray, book._asdict())}


def _below(table, theirs, ours):
  return {theirs + name: (ours + path, kind) for name, (path, kind) in table.items()}


def diffusion_mlp_names(depth: int, prefix: str = "net.", ours: str = "") -> Table:
  """CDAMD's and MARDM's diffusion head (docs/papers/cdamd.md#diffusion-mlp), below `prefix` there and `ours` here."""
  table = {"time_embed.mlp.0": ("time_in", "dense"), "time_embed.mlp.2": ("time_out", "dense"),
           "cond_embed": ("condition_in", "dense"), "input_proj": ("x_in", "dense"),
           "final_layer.linear": ("out", "dense"), "final_layer.adaLN_modulation.1": ("film", "dense")}
  for i in range(depth):
    table |= {f"res_blocks.{i}.in_ln": (f"block{i}/norm", "norm"),
              f"res_blocks.{i}.mlp.0": (f"block{i}/ff_in", "dense"),
              f"res_blocks.{i}.mlp.2": (f"block{i}/ff_out", "dense"),
              f"res_blocks.{i}.adaLN_modulation.1": (f"block{i}/film", "dense")}
  return _below(table, prefix, ours)


def _generator_names(table, head_depth):
  """A table of a transformer, and that of its diffusion head if it has one; then both lie in a `Generator`."""
  table |= {"mask_latent": ("inputs/mask_latent", "array"), "input_process.poseEmbedding": ("inputs/x_in", "dense"),
            "cond_emb": ("inputs/text_in", "dense")}
  if head_depth is None:
    return table
  return _below(table, "", "transformer/") | diffusion_mlp_names(head_depth, "DiffMLPs.net.", "head/")


def masked_transformer_names(depth: int, head_depth: int | None = None) -> Table:
  """CDAMD's transformer; with head_depth, layers of the diffusion head, the whole generator.

  Source: docs/papers/cdamd.md#masked-transformer.
  """
  table = {"token_emb.weight": ("code_table", "array"), "codebook_type_emb.weight": ("level_table", "array"),
           "seqTransEncoder.pos_emb": ("positions", "array")}
  for i in range(depth):
    theirs, ours = f"seqTransEncoder.layers.{i}", f"block{i}"
    table |= {f"{theirs}.{attention}.{name}_proj": (f"{ours}/{attention}/{name[0]}", "dense")
              for attention in ("self_attn", "cross_attn") for name in ("q", "k", "v", "out")}
    table |= {f"{theirs}.adaln{k}.{name}": (f"{ours}/{name}{k}", "dense") for k in (1, 2, 3)
              for name in ("scale", "shift")}
    table |= {f"{theirs}.ff.0": (f"{ours}/ff_in", "dense"), f"{theirs}.ff.3": (f"{ours}/ff_out", "dense")}
  return _generator_names(table, head_depth)


def mardm_names(depth: int, head_depth: int | None = None) -> Table:
  """MARDM's transformer (docs/papers/cdamd.md#mardm), alone or with its diffusion head."""
  table: Table = {}
  for i in range(depth):
    theirs, ours = f"MARTransformer.{i}", f"block{i}"
    table |= {f"{theirs}.attn.{name}": (f"{ours}/self_attn/{short}", "dense")
              for name, short in (("query", "q"), ("key", "k"), ("value", "v"), ("proj", "o"))}
    table |= {f"{theirs}.mlp.fc1": (f"{ours}/ff_in", "dense"), f"{theirs}.mlp.fc2": (f"{ours}/ff_out", "dense"),
              f"{theirs}.adaLN_modulation.1": (f"{ours}/film", "dense")}
  return _generator_names(table, head_depth)


def length_estimator_names() -> Table:
  """MARDM's length estimator."""
  table = {"output.11": ("out", "dense")}
  for i, place in enumerate((0, 4, 8)):
    table |= {f"output.{place}": (f"layer{i}", "dense"), f"output.{place + 1}": (f"norm{i}", "norm")}
  return table
