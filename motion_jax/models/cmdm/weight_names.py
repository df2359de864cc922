"""Names of CMDM's released weights: tokenizer and denoiser (docs/papers/cmdm.md#checkpoint-names)."""
from motion_jax.convert.names import causal_vae_names
from motion_jax.convert.state import Table

__all__ = ["causal_dit_names", "causal_vae_names"]


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
