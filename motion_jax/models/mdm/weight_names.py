"""Names of MDM's released weights (docs/papers/mdm.md#files)."""
from motion_jax.convert.state import Table, post_norm_decoder_names, post_norm_names

BUFFERS = ("sequence_pos_encoder.pe", "embed_timestep.sequence_pos_encoder.pe")  # tables of sines, formulas here


def mdm_names(depth: int = 8, kind: str = "encoder", goals: bool = False) -> Table:
  """MDM's network of a kind of `nets.motion_denoiser`, with or without the targets of DiP."""
  table = {"input_process.poseEmbedding": ("x_in", "dense"), "output_process.poseFinal": ("out", "dense"),
           "embed_timestep.time_embed.0": ("time_in", "dense"), "embed_timestep.time_embed.2": ("time_out", "dense"),
           "embed_text": ("text_in", "dense")}
  if goals:
    table |= {"embed_target_cond.mlp.0": ("goal_in", "dense"), "embed_target_cond.mlp.2": ("goal_out", "dense")}
  for i in range(depth):
    if kind == "encoder":
      table |= post_norm_names(f"seqTransEncoder.layers.{i}", f"layer{i}")
    elif kind == "decoder":
      table |= post_norm_decoder_names(f"seqTransDecoder.layers.{i}", f"layer{i}")
    else:
      table |= {f"gru.{theirs}_l{i}": (f"layer{i}/{ours}", kind) for theirs, ours, kind in (
          ("weight_ih", "w_in", "transposed"), ("weight_hh", "w_hidden", "transposed"), ("bias_ih", "b_in", "array"),
          ("bias_hh", "b_hidden", "array"))}
  return table
