"""Names of T2M-GPT's released GPT; those of its VQ-VAE: `shared.autoencoder_weights`."""
import re

from motion_jax.convert.state import Table

# Buffers that are formulas, and a table that no code reads.
UNUSED = re.compile(r"trans_base\.(pos_embedding\.weight|pos_embed\.embed)|trans_(base|head)\.blocks\.\d+\.attn\.mask")


def gpt_names(half: int) -> Table:
  """The GPT (docs/papers/t2m_gpt.md#gpt), whose blocks lie in two halves of the same number."""
  table: Table = {"trans_base.tok_emb.weight": ("code_table", "array"), "trans_base.cond_emb": ("text_in", "dense"),
                  "trans_head.ln_f": ("norm", "norm"), "trans_head.head.weight": ("out/kernel", "transposed")}
  for i in range(2 * half):
    theirs = f"trans_{'base' if i < half else 'head'}.blocks.{i % half}"
    ours = f"block{i}"
    table |= {f"{theirs}.ln1": (f"{ours}/norm1", "norm"), f"{theirs}.ln2": (f"{ours}/norm2", "norm"),
              f"{theirs}.mlp.0": (f"{ours}/ff_in", "dense"), f"{theirs}.mlp.2": (f"{ours}/ff_out", "dense")}
    table |= {f"{theirs}.attn.{name}": (f"{ours}/attn/{short}", "dense")
              for name, short in (("query", "q"), ("key", "k"), ("value", "v"), ("proj", "o"))}
  return table
