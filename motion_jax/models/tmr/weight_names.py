"""Names of the teachers of CMDM's Table 9, and of vision transformers of timm and Hugging Face.

Source: docs/papers/cmdm.md#checkpoint-names.
"""
from collections.abc import Mapping
from typing import Any

from motion_jax.convert.state import Table, from_torch, post_norm_decoder_names, post_norm_names, select
from motion_jax.text import bert

TEXT = "text_encoder.text_model."


def head_names(ours: str, theirs: str | None = None) -> Table:
  """A projection head."""
  theirs = theirs or ours
  return {f"{theirs}.projection": (f"{ours}/projection", "dense"), f"{theirs}.fc": (f"{ours}/fc", "dense"),
          f"{theirs}.layer_norm": (f"{ours}/norm", "norm")}


TMR_PARTS = {"Root": "root", "R_Leg": "right_leg", "L_Leg": "left_leg", "Backbone": "backbone", "R_Arm": "right_arm",
             "L_Arm": "left_arm"}


def part_tmr_names(depth: int = 4) -> Table:
  """Part-TMR without its text transformer (docs/papers/cmdm.md#checkpoint-names)."""
  table = {"logit_scale": ("logit_scale", "array")}
  for theirs, ours in TMR_PARTS.items():
    table |= {f"motion_encoder.emb_token_{theirs}": (f"motion_{ours}/token", "array"),
              f"motion_encoder.skel_embedding_{theirs}": (f"motion_{ours}/embed", "dense")}
    for i in range(depth):
      table |= post_norm_names(f"motion_encoder.seqTransEncoder_{theirs}.layers.{i}", f"motion_{ours}/layer{i}")
  return table | head_names("motion_projection") | head_names("text_projection")


def part_tmr_from_torch(state: Mapping[str, Any], text_fields: Mapping[str, Any], depth: int = 4) -> dict[str, Any]:
  """The whole Part-TMR: {"motion", "text"} as in a teacher's run; text_fields: of its `text.bert.Bert`."""
  ignored = [f"motion_encoder.sequence_pos_encoding_{part}.pe" for part in TMR_PARTS]
  motion = {name: array for name, array in state.items() if not name.startswith(TEXT)}
  return {"motion": from_torch(motion, part_tmr_names(depth), ignored)["params"],
          "text": bert.params_from_reference(select(state, TEXT), text_fields)}


def tmr_names(depth: int = 6) -> Table:
  """TMR: two encoders and the decoder."""
  table = {"motion_decoder.final_layer": ("motion_decoder/out", "dense")}
  for side in ("motion_encoder", "text_encoder"):
    table |= {f"{side}.tokens": (f"{side}/tokens", "array"), f"{side}.projection": (f"{side}/embed", "dense")}
    for i in range(depth):
      table |= post_norm_names(f"{side}.seqTransEncoder.layers.{i}", f"{side}/layer{i}")
  for i in range(depth):
    table |= post_norm_decoder_names(f"motion_decoder.seqTransDecoder.layers.{i}", f"motion_decoder/layer{i}")
  return table


def vit_names(depth: int = 12, prefix: str = "", ours: str = "") -> Table:
  """A vision transformer under timm's names, without its last norm and its head."""
  table = {f"{prefix}cls_token": (f"{ours}token", "first_row"), f"{prefix}pos_embed": (f"{ours}positions", "first"),
           f"{prefix}patch_embed.proj": (f"{ours}patch_embed", "patches")}
  for i in range(depth):
    block, mine = f"{prefix}blocks.{i}", f"{ours}block{i}"
    table |= {f"{block}.norm1": (f"{mine}/attn_norm", "norm"), f"{block}.attn.qkv": (f"{mine}/attn", "qkv"),
              f"{block}.attn.proj": (f"{mine}/attn/o", "dense"), f"{block}.norm2": (f"{mine}/mlp_norm", "norm"),
              f"{block}.mlp.fc1": (f"{mine}/mlp_in", "dense"), f"{block}.mlp.fc2": (f"{mine}/mlp_out", "dense")}
  return table


def huggingface_vit_names(depth: int = 12, prefix: str = "") -> Table:
  """The same under the names of Hugging Face's ViT."""
  embed = f"{prefix}embeddings"
  table = {f"{embed}.cls_token": ("token", "first_row"), f"{embed}.position_embeddings": ("positions", "first"),
           f"{embed}.patch_embeddings.projection": ("patch_embed", "patches")}
  for i in range(depth):
    layer, mine = f"{prefix}encoder.layer.{i}", f"block{i}"
    table |= {f"{layer}.attention.attention.{name}": (f"{mine}/attn/{name[0]}", "dense")
              for name in ("query", "key", "value")}
    table |= {f"{layer}.attention.output.dense": (f"{mine}/attn/o", "dense"),
              f"{layer}.layernorm_before": (f"{mine}/attn_norm", "norm"),
              f"{layer}.layernorm_after": (f"{mine}/mlp_norm", "norm"),
              f"{layer}.intermediate.dense": (f"{mine}/mlp_in", "dense"),
              f"{layer}.output.dense": (f"{mine}/mlp_out", "dense")}
  return table


def vit_from_torch(state: Mapping[str, Any], depth: int = 12) -> tuple[Any, list[str]]:
  """(parameters of `nets.vit.ViT`, names that were left out) from an ImageNet checkpoint of either naming.

  Its head and its last norm are left out; any other name that is unknown or missing is an error.
  """
  prefix = "vit." if any(name.startswith("vit.") for name in state) else ""
  ours = f"{prefix}embeddings.cls_token" in state
  tops = ("layernorm", "pooler") if ours else ("norm", "fc_norm", "head", "head_drop", "pre_logits")
  unused = tuple(f"{prefix}{top}." for top in tops) + ("classifier.",)
  left = sorted(name for name in state if name.startswith(unused))
  table = huggingface_vit_names(depth, prefix) if ours else vit_names(depth)
  return from_torch({name: a for name, a in state.items() if name not in left}, table)["params"], left


def motion_patches_names(depth: int = 12) -> Table:
  """MotionPatches without its text transformer."""
  model = "motion_encoder.model."
  table = vit_names(depth, model, "vit/") | {f"{model}fc_norm": ("fc_norm", "norm"),
                                             "logit_scale": ("logit_scale", "array")}
  return table | head_names("motion_projection") | head_names("text_projection")


def motion_patches_from_torch(state: Mapping[str, Any], text_fields: Mapping[str, Any], depth: int = 12
                              ) -> dict[str, Any]:
  """The whole MotionPatches: {"motion", "text"} as in a teacher's run; text_fields: of its `text.bert.Bert`."""
  motion = {name: array for name, array in state.items() if not name.startswith(TEXT)}
  return {"motion": from_torch(motion, motion_patches_names(depth))["params"],
          "text": bert.params_from_reference(select(state, TEXT), text_fields)}
