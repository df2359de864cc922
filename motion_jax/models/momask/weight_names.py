"""Names of MoMask's released transformers; those of its RVQ-VAE and length estimator: `shared.autoencoder_weights`."""
from motion_jax.convert.state import Table, post_norm_names

POSITIONS = "position_enc.pe"


def _trunk(depth: int) -> Table:
  table: Table = {"input_process.poseEmbedding": ("trunk/x_in", "dense"), "cond_emb": ("trunk/text_in", "dense"),
                  "output_process.dense": ("head/dense", "dense"), "output_process.LayerNorm": ("head/norm", "norm"),
                  "output_process.poseFinal": ("head/out", "dense")}
  for i in range(depth):
    table |= post_norm_names(f"seqTransEncoder.layers.{i}", f"trunk/layer{i}")
  return table


def masked_names(depth: int) -> Table:
  """The masked transformer (docs/papers/momask.md#transformers)."""
  return _trunk(depth) | {"token_emb.weight": ("code_table", "array")}


def residual_names(depth: int, shared_tables: bool = True) -> Table:
  """The residual transformer, with tables that levels share or with two each."""
  tables = {"token_embed_weight_": "first_table", "embed_proj_shared_weight": "shared_tables",
            "output_proj_weight_": "last_table"} if shared_tables else {
                "token_embed_weight": "tables_in", "output_proj_weight": "tables_out", "output_proj_bias": "bias_out"}
  return _trunk(depth) | {"quant_emb": ("level_in", "dense")} | {
      theirs: (ours, "array") for theirs, ours in tables.items()}
