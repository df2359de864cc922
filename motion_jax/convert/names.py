"""Names of layers in released weights that several methods share."""
from motion_jax.convert.state import Table


def below(table: Table, theirs: str, ours: str) -> Table:
  """A table whose names all have these prefixes."""
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
  return below(table, prefix, ours)


def causal_vae_names(num_halvings: int = 2, depth: int = 3, teacher: bool = True, teacher_to_latent: bool = False
                     ) -> Table:
  """MAC-VAE of CMDM, and without a teacher MotionStreamer's causal autoencoder; teacher: the state holds the
  alignment projection, of either direction."""
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
