"""Names of CDAMD's and MARDM's released generators; those of their autoencoders: `shared.autoencoder_weights`."""
from motion_jax.convert.names import below, diffusion_mlp_names
from motion_jax.convert.state import Table


def _generator_names(table, head_depth):
  """A table of a transformer, and that of its diffusion head if it has one; then both lie in a `Generator`."""
  table |= {"mask_latent": ("inputs/mask_latent", "array"), "input_process.poseEmbedding": ("inputs/x_in", "dense"),
            "cond_emb": ("inputs/text_in", "dense")}
  if head_depth is None:
    return table
  return below(table, "", "transformer/") | diffusion_mlp_names(head_depth, "DiffMLPs.net.", "head/")


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


