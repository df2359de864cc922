"""Names of MotionStreamer's released weights (docs/papers/motionstreamer.md#files)."""
from motion_jax.convert.names import below, causal_vae_names, diffusion_mlp_names
from motion_jax.convert.state import Table


def autoencoder_names(num_halvings: int = 2, depth: int = 3) -> Table:
  """The causal autoencoder, `nets.causal_vae` without a teacher."""
  return below(causal_vae_names(num_halvings, depth, teacher=False), "tae.", "")


def transformer_names(depth: int = 12) -> Table:
  """`nets.latent_llama.LatentLlama`."""
  table = {"transformer.wte": ("x_in", "dense"), "transformer.cond_embed": ("text_in", "dense"),
           "transformer.ln_f.scale": ("norm/scale", "array"), "out_proj": ("out", "dense")}
  for i in range(depth):
    theirs, ours = f"transformer.h.{i}", f"block{i}"
    table |= {f"{theirs}.rms_1.scale": (f"{ours}/norm1/scale", "array"),
              f"{theirs}.rms_2.scale": (f"{ours}/norm2/scale", "array"),
              f"{theirs}.attn.scale": (f"{ours}/attn/logit_scale", "array"),
              f"{theirs}.attn.c_attn": (f"{ours}/attn", "qkv_plain"),
              f"{theirs}.attn.c_proj": (f"{ours}/attn/o", "kernel"), f"{theirs}.mlp.c_fc1": (f"{ours}/gate", "kernel"),
              f"{theirs}.mlp.c_fc2": (f"{ours}/up", "kernel"), f"{theirs}.mlp.c_proj": (f"{ours}/down", "kernel")}
  return table


def generator_names(depth: int = 12, head_depth: int = 9) -> Table:
  """Transformer and diffusion head, `nets.latent_llama.LatentGenerator`."""
  return below(transformer_names(depth), "", "transformer/") | diffusion_mlp_names(head_depth, "diff_loss.net.",
                                                                                   "head/")
