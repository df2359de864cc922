"""Names of the benchmarks' evaluators (docs/papers/cmdm.md#checkpoint-names) and of MARDM's length estimator."""
from motion_jax.convert.state import post_norm_names


def _sequence_names(theirs, ours):
  return {f"{theirs}hidden": (f"{ours}/first_state", "first_state"), f"{theirs}input_emb": (f"{ours}/embed", "dense"),
          f"{theirs}gru": (ours, "gru"), f"{theirs}output_net.0": (f"{ours}/mix", "dense"),
          f"{theirs}output_net.1": (f"{ours}/norm", "norm"), f"{theirs}output_net.3": (f"{ours}/out", "dense")}


def t2m_evaluator_names(movement="movement_encoder/", motion="motion_encoder/", text="text_encoder/"):
  """The T2M evaluator, whose file holds three networks; the arguments are their prefixes."""
  ours = "movement_encoder"
  table = {f"{movement}main.0": (f"{ours}/conv0", "conv"), f"{movement}main.3": (f"{ours}/conv1", "conv"),
           f"{movement}out_net": (f"{ours}/out", "dense"), f"{text}pos_emb": ("text_encoder/classes", "dense")}
  return table | _sequence_names(motion, "motion_encoder") | _sequence_names(text, "text_encoder/sequence")


CLIP_EVALUATOR_IGNORED = ("motion_encoder.sequence_pos_encoder.pe",)  # a sine table


def clip_evaluator_names(depth=8):
  """MARDM's CLIP-type evaluator: the tensors below contrast_model/ in its file."""
  table = {"positional_embedding": ("positions", "array"), "logit_scale": ("logit_scale", "array"),
           "motion_encoder.query_token": ("query", "array"), "motion_encoder.embed_motion": ("embed", "dense"),
           "motion_encoder.out_ln": ("motion_norm", "norm"), "motion_encoder.out": ("motion_out", "dense"),
           "token_embedding.weight": ("tokens", "array"), "text_ln": ("text_norm", "norm"),
           "out": ("text_out", "dense")}
  for i in range(depth):
    table |= post_norm_names(f"motion_encoder.transformer.layers.{i}", f"motion_layers_{i}")
    table |= post_norm_names(f"textTransEncoder.layers.{i}", f"text_layers_{i}")
  return table
