"""Names of CMDM's released weights: tokenizer and denoiser (docs/papers/cmdm.md#checkpoint-names)."""
from motion_jax.convert.state import Table


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
