"""Names of MLD's released weights (docs/papers/mld.md#files)."""
from motion_jax.convert.state import Table, post_norm_decoder_names, post_norm_names

UNUSED = ("mem_pos.pe",)  # a parameter of the denoiser that nothing reads


def skip_names(depth: int, theirs: str, ours: str, decoder: bool = False) -> Table:
  """A stack with skip connections, below these names."""
  layer = post_norm_decoder_names if decoder else post_norm_names
  table = {f"{theirs}.norm": (f"{ours}/norm", "norm"), **layer(f"{theirs}.middle_block", f"{ours}/middle")}
  for i in range(depth // 2):
    table |= layer(f"{theirs}.input_blocks.{i}", f"{ours}/down{i}")
    table |= layer(f"{theirs}.output_blocks.{i}", f"{ours}/up{i}")
    table[f"{theirs}.linear_blocks.{i}"] = (f"{ours}/join{i}", "dense")
  return table


def vae_names(depth: int = 9, distribution: str = "tokens", decoder: str = "memory", positions: str = "learned"
              ) -> Table:
  """`nets.latent_diffusion.TokenVAE`, without the prefix "vae."."""
  table = {"global_motion_token": ("encoder/tokens", "array"), "skel_embedding": ("encoder/x_in", "dense"),
           "final_layer": ("decoder/out", "dense"), **skip_names(depth, "encoder", "encoder/layers"),
           **skip_names(depth, "decoder", "decoder/layers", decoder == "memory")}
  if positions == "learned":
    table |= {"query_pos_encoder.pe": ("encoder/positions", "middle"),
              "query_pos_decoder.pe": ("decoder/positions", "middle")}
  if distribution == "linear":
    table["dist_layer"] = ("encoder/distribution", "dense")
  return table


def denoiser_names(depth: int = 9, features: int = 0, has_text_layer: bool = True) -> Table:
  """`nets.latent_diffusion.TokenDenoiser`, without the prefix "denoiser."."""
  table = {"time_embedding.linear_1": ("time_in", "dense"), "time_embedding.linear_2": ("time_out", "dense"),
           "query_pos.pe": ("positions", "middle")}
  if has_text_layer:
    table["emb_proj.1"] = ("text_in", "dense")
  if not features:
    return table | skip_names(depth, "encoder", "layers")
  table |= {"mem_pos.pe": ("memory_positions", "middle"), "pose_embd": ("x_in", "dense"), "pose_proj": ("out", "dense"),
            "decoder.norm": ("norm", "norm")}
  for i in range(depth):
    table |= post_norm_decoder_names(f"decoder.layers.{i}", f"layer{i}")
  return table
