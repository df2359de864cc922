"""Names of CMDM's released weights: tokenizer, denoiser, teacher (docs/papers/cmdm.md#checkpoint-names)."""
from collections.abc import Mapping
from typing import Any

from motion_jax.convert.state import Table, from_torch, post_norm_names, select
from motion_jax.text import bert


def causal_vae_names(num_halvings: int = 2, depth: int = 3, teacher: bool = True, teacher_to_latent: bool = False
                     ) -> Table:
  """MAC-VAE. teacher: the state holds the alignment projection, of either direction."""
  table = {"encoder.model.0.conv": ("encoder/conv_in/conv", "conv"), "encoder.proj": ("encoder/head", "dense"),
           f"encoder.model.{2 + num_halvings}.conv": ("encoder/conv_out/conv", "conv"),
           "decode_proj": ("decoder/head", "dense"), "decoder.model.0.conv": ("decoder/conv_in/conv", "conv"),
           f"decoder.model.{2 + num_halvings}.conv": ("decoder/conv_mid/conv", "conv"),
           f"decoder.model.{4 + num_halvings}.conv": ("decoder/conv_out/conv", "conv")}
  if teacher:
    table["linear_proj_aux" if teacher_to_latent else "linear_proj_z"] = ("align", "dense")
  for i in range(num_halvings):
    table[f"encoder.model.{2 + i}.0.conv"] = (f"encoder/down{i}/conv", "conv")
    table[f"decoder.model.{2 + i}.2.conv"] = (f"decoder/up{i}/conv", "conv")
    for half, place in (("encoder", 1), ("decoder", 0)):
      for b in range(depth):
        theirs, ours = f"{half}.model.{2 + i}.{place}.model.{b}", f"{half}/stack{i}_block{b}"
        table[f"{theirs}.conv1"] = (f"{ours}/conv/conv", "conv")
        table[f"{theirs}.conv2"] = (f"{ours}/pointwise", "pointwise")
  return table


def causal_dit_names(depth: int) -> Table:
  """Causal-DiT (docs/papers/cmdm.md#checkpoint-names)."""
  table = {"t_embedder.mlp.0": ("time_in", "dense"), "t_embedder.mlp.2": ("time_out", "dense"),
           "x_embedder": ("x_in", "dense"), "y_embedder": ("text_in", "dense"), "final_layer": ("out", "dense")}
  for i in range(depth):
    theirs, ours = f"blocks.{i}", f"block{i}"
    table |= {f"{theirs}.adaLN_modulation.1": (f"{ours}/film", "dense"), f"{theirs}.norm3": (f"{ours}/norm2", "norm"),
              f"{theirs}.ffn.0": (f"{ours}/ff_in", "dense"), f"{theirs}.ffn.2": (f"{ours}/ff_out", "dense")}
    for attention in ("self_attn", "cross_attn"):
      table |= {f"{theirs}.{attention}.{name}": (f"{ours}/{attention}/{name}", "dense") for name in "qkvo"}
      table |= {f"{theirs}.{attention}.norm_{name}": (f"{ours}/{attention}/norm_{name}", "scale") for name in "qk"}
  return table


TMR_PARTS = {"Root": "root", "R_Leg": "right_leg", "L_Leg": "left_leg", "Backbone": "backbone", "R_Arm": "right_arm",
             "L_Arm": "left_arm"}


def part_tmr_names(depth: int = 4) -> Table:
  """Part-TMR less its text transformer (docs/papers/cmdm.md#checkpoint-names)."""
  table = {"logit_scale": ("logit_scale", "array")}
  for theirs, ours in TMR_PARTS.items():
    table |= {f"motion_encoder.emb_token_{theirs}": (f"motion_{ours}/token", "array"),
              f"motion_encoder.skel_embedding_{theirs}": (f"motion_{ours}/embed", "dense")}
    for i in range(depth):
      table |= post_norm_names(f"motion_encoder.seqTransEncoder_{theirs}.layers.{i}", f"motion_{ours}/layer{i}")
  for side in ("motion", "text"):
    head = f"{side}_projection"
    table |= {f"{head}.projection": (f"{head}/projection", "dense"), f"{head}.fc": (f"{head}/fc", "dense"),
              f"{head}.layer_norm": (f"{head}/norm", "norm")}
  return table


def part_tmr_from_torch(state: Mapping[str, Any], text_fields: Mapping[str, Any], depth: int = 4) -> dict[str, Any]:
  """Part-TMR whole: {"motion", "text"} as a teacher's run keeps it; text_fields are those of its `text.bert.Bert`."""
  prefix = "text_encoder.text_model."
  ignored = [f"motion_encoder.sequence_pos_encoding_{part}.pe" for part in TMR_PARTS]
  motion = {name: array for name, array in state.items() if not name.startswith(prefix)}
  return {"motion": from_torch(motion, part_tmr_names(depth), ignored)["params"],
          "text": bert.params_from_reference(select(state, prefix), text_fields)}
