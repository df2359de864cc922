"""Released PyTorch weights to parameters, by tables of names: every tensor is accounted for.

A table maps a reference's name, less ".weight" or ".bias", to (our path, kind); the kind says how arrays are turned.
"""
import pathlib
import re

import flax
import jax
import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file

from motion_jax.quant.vq import codebook_of
from motion_jax.text import bert


def _split(leaf, parts, turn):
  """One tensor of the reference, several stacked along its first axis, as one leaf for each part."""
  take = lambda i: lambda w: turn(np.split(w, len(parts))[i])
  return [(f"{part}/{leaf}", take(i)) for i, part in enumerate(parts)]


_QKV = ("query", "key", "value")

# kind -> {suffix of the reference: (our leaf, transposition), or a list of such pairs}; "" = the name itself
_KINDS = {
    "dense": {"weight": ("kernel", lambda w: w.T), "bias": ("bias", None)},
    "conv": {"weight": ("kernel", lambda w: w.transpose(2, 1, 0)), "bias": ("bias", None)},
    "pointwise": {"weight": ("kernel", lambda w: w.squeeze(2).T), "bias": ("bias", None)},
    "norm": {"weight": ("scale", None), "bias": ("bias", None)},
    "scale": {"weight": ("scale", None)},
    "array": {"": ("", None)},
    "conv_transpose": {"weight": ("kernel", lambda w: w.transpose(2, 0, 1)[::-1]), "bias": ("bias", None)},
    "first_state": {"": ("", lambda h: h.squeeze(1))},
    "gru": {f"{theirs}_l0{direction}": (f"{part}/{ours}", turn)
            for part, direction in (("forward", ""), ("backward", "_reverse"))
            for theirs, ours, turn in (("weight_ih", "w_in", np.transpose), ("weight_hh", "w_hidden", np.transpose),
                                       ("bias_ih", "b_in", None), ("bias_hh", "b_hidden", None))},
    "attention_in": {"in_proj_weight": _split("kernel", _QKV, np.transpose),
                     "in_proj_bias": _split("bias", _QKV, lambda b: b)},
}


def load_state(path):
  """A flat dict of numpy arrays from a .safetensors file or a PyTorch checkpoint, which is never unpickled in full.

  A checkpoint that nests its weights gives keys joined by "/": "ema_model/x_embedder.weight".
  """
  return load_checkpoint(path)[0]


def load_checkpoint(path):
  """What load_state gives, and the names of the entries that hold no tensor: counters, schedules."""
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no checkpoint {path}")
  if path.suffix == ".safetensors":
    try:
      return load_file(path), set()
    except SafetensorError as error:
      raise ValueError(f"{path} is no whole safetensors file ({error}); fetch it again") from error
  try:
    import torch
  except ImportError as error:
    raise ValueError(f"reading {path.name} needs torch: pip install 'motion-jax[convert]', or give a .safetensors "
                     "file") from error
  try:
    state = torch.load(path, map_location="cpu", weights_only=True)
  except Exception as error:  # torch tells a damaged file by whatever its reader stumbled over
    foreign = re.search(r"GLOBAL ([\w.]+)", str(error))
    if foreign:
      raise ValueError(f"{path} holds a {foreign[1]} besides tensors and plain values; reading such a thing can run "
                       "code, so it is refused. Where you trust the file, save its tensors alone, with "
                       "torch.save(state_dict) or safetensors, and convert that") from error
    reason = str(error).strip().splitlines() or [type(error).__name__]
    raise ValueError(f"{path} is no whole PyTorch checkpoint ({reason[0]}); fetch it again") from error
  if not isinstance(state, dict):
    raise ValueError(f"{path} holds a {type(state).__name__}, expected a dict of tensors")
  flat = {}

  def collect(prefix, value):
    if isinstance(value, dict):
      for key, inner in value.items():
        collect(f"{prefix}/{key}" if prefix else str(key), inner)
    elif isinstance(value, torch.Tensor):
      flat[prefix] = value.float().contiguous().numpy()

  collect("", state)
  return flat, {str(key) for key in state} - {name.split("/")[0] for name in flat}


def select(state, prefix):
  """The entries under a prefix, less the prefix: the "ae" or "ema_model" part of a checkpoint."""
  part = {key[len(prefix):]: value for key, value in state.items() if key.startswith(prefix)}
  if not part:
    raise ValueError(f"the checkpoint has nothing under {prefix!r}; it has "
                     f"{', '.join(sorted({key.split('/')[0] for key in state})[:8])}")
  return part


def _join(name, rest, mark):
  return f"{name}{mark}{rest}" if rest else name


def from_torch(state, table, ignore=()):
  """Parameters {"params": ...} from a state dict; a name that is unknown or missing is an error that lists it.

  ignore: names of buffers that are formulas (sine tables).
  """
  flat, used = {}, set()
  for theirs, (ours, kind) in table.items():
    for suffix, leaves in _KINDS[kind].items():
      name = _join(theirs, suffix, ".")
      if name in state:
        used.add(name)
        array = np.asarray(state[name], np.float32)
        for leaf, turn in leaves if isinstance(leaves, list) else [leaves]:
          try:
            flat[_join(f"params/{ours}", leaf, "/")] = array if turn is None else turn(array)
          except ValueError as error:
            raise ValueError(f"{name} has the shape {array.shape}, which is not that of its layer ({kind})") from error
  expected = {_join(theirs, suffix, ".") for theirs, (_, kind) in table.items() for suffix in _KINDS[kind]}
  missing, unknown = sorted(expected - used), sorted(set(state) - used - set(ignore))
  if missing or unknown:
    tell = lambda names: f"{len(names)} ({', '.join(names[:4])}{', ...' if len(names) > 4 else ''})"
    raise ValueError(f"the checkpoint does not fit this network: missing {tell(missing)}, unknown {tell(unknown)}; "
                     "check which network and size it is of")
  return flax.traverse_util.unflatten_dict(flat, sep="/")


def causal_vae_names(num_halvings=2, depth=3, teacher=True, teacher_to_latent=False):
  """MAC-VAE (facts: cmdm 9). teacher: the state holds the alignment projection, of either direction."""
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


def autoencoder_names(num_halvings=2, depth=3):
  """AE of CDAMD and MARDM (facts: cdamd 2)."""
  last = 2 + num_halvings
  ends = {"encoder.model.0": "encoder/conv_in", f"encoder.model.{last}": "encoder/conv_out",
          "decoder.model.0": "decoder/conv_in", f"decoder.model.{last}": "decoder/conv_mid",
          f"decoder.model.{last + 2}": "decoder/conv_out"}
  table = {theirs: (f"{ours}/conv", "conv") for theirs, ours in ends.items()}
  for i in range(num_halvings):
    table |= {f"encoder.model.{2 + i}.0": (f"encoder/down{i}/conv", "conv"),
              f"decoder.model.{2 + i}.2": (f"decoder/up{i}/conv", "conv")}
    for half, place in (("encoder", 1), ("decoder", 0)):
      for b in range(depth):
        theirs, ours = f"{half}.model.{2 + i}.{place}.model.{b}", f"{half}/stack{i}_block{b}"
        table |= {f"{theirs}.conv1": (f"{ours}/conv/conv", "conv"),
                  f"{theirs}.conv2": (f"{ours}/pointwise", "pointwise")}
  return table


def rvq_names(num_levels=4, num_halvings=2, depth=3):
  """RVQ-VAE of CDAMD (facts: cdamd 3), the codes of level q under codes/q."""
  levels = {f"quantizer.layers.{q}.codebook": (f"codes/{q}", "array") for q in range(num_levels)}
  return autoencoder_names(num_halvings, depth) | levels


def rvq_from_torch(state, num_levels=4, num_halvings=2, depth=3):
  """RVQ-VAE of CDAMD as it is used: {"params", "codebooks"} with all fields of `quant.vq.Codebook`."""
  params = from_torch(state, rvq_names(num_levels, num_halvings, depth))["params"]
  codes = params.pop("codes")
  book = codebook_of(np.stack([codes[str(q)] for q in range(num_levels)]))
  return {"params": params, "codebooks": jax.tree.map(np.asarray, book._asdict())}


def causal_dit_names(depth):
  """Causal-DiT (facts: cmdm 9)."""
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


def post_norm_names(theirs, ours):
  """PyTorch's TransformerEncoderLayer, whose attention keeps q, k and v in one matrix, as `nets.post_norm`'s layer."""
  return {f"{theirs}.self_attn": (ours, "attention_in"), f"{theirs}.self_attn.out_proj": (f"{ours}/out", "dense"),
          f"{theirs}.linear1": (f"{ours}/mlp_in", "dense"), f"{theirs}.linear2": (f"{ours}/mlp_out", "dense"),
          f"{theirs}.norm1": (f"{ours}/attn_norm", "norm"), f"{theirs}.norm2": (f"{ours}/mlp_norm", "norm")}


TMR_PARTS = {"Root": "root", "R_Leg": "right_leg", "L_Leg": "left_leg", "Backbone": "backbone", "R_Arm": "right_arm",
             "L_Arm": "left_arm"}


def part_tmr_names(depth=4):
  """Part-TMR less its text transformer (facts: cmdm 9)."""
  table = {"logit_scale": ("logit_scale", "array")}
  for theirs, ours in TMR_PARTS.items():
    table |= {f"motion_encoder.emb_token_{theirs}": (f"motion_{ours}/token", "array"),
              f"motion_encoder.skel_embedding_{theirs}": (f"motion_{ours}/embed", "dense")}
    for i in range(depth):
      table |= post_norm_names(f"motion_encoder.seqTransEncoder_{theirs}.layers.{i}", f"motion_{ours}/layer{i}")
  for side in ("motion", "text"):
    head = f"{side}_projection"
    table |= {f"{head}.projection": (f"{head}/projection", "dense"), f"{head}.fc": (f"{head}/fc", "dense"),
              f"{head}.layer_norm": (f"{head}/norm", "norm")}
  return table


def part_tmr_from_torch(state, text_fields, depth=4):
  """Part-TMR whole: {"motion", "text"} as a teacher's run keeps it; text_fields are those of its `text.bert.Bert`."""
  prefix = "text_encoder.text_model."
  ignored = [f"motion_encoder.sequence_pos_encoding_{part}.pe" for part in TMR_PARTS]
  motion = {name: array for name, array in state.items() if not name.startswith(prefix)}
  return {"motion": from_torch(motion, part_tmr_names(depth), ignored)["params"],
          "text": bert.params_from_reference(select(state, prefix), text_fields)}


def _sequence_names(theirs, ours):
  return {f"{theirs}hidden": (f"{ours}/first_state", "first_state"), f"{theirs}input_emb": (f"{ours}/embed", "dense"),
          f"{theirs}gru": (ours, "gru"), f"{theirs}output_net.0": (f"{ours}/mix", "dense"),
          f"{theirs}output_net.1": (f"{ours}/norm", "norm"), f"{theirs}output_net.3": (f"{ours}/out", "dense")}


def t2m_evaluator_names(movement="movement_encoder/", motion="motion_encoder/", text="text_encoder/"):
  """The T2M evaluator (facts: cmdm 9), whose file holds three networks; the arguments are their prefixes."""
  ours = "movement_encoder"
  table = {f"{movement}main.0": (f"{ours}/conv0", "conv"), f"{movement}main.3": (f"{ours}/conv1", "conv"),
           f"{movement}out_net": (f"{ours}/out", "dense"), f"{text}pos_emb": ("text_encoder/classes", "dense")}
  return table | _sequence_names(motion, "motion_encoder") | _sequence_names(text, "text_encoder/sequence")


def movement_decoder_names(prefix="movement_decoder/"):
  """The other half of the T2M evaluator's movement autoencoder."""
  return {f"{prefix}main.0": ("conv0", "conv_transpose"), f"{prefix}main.2": ("conv1", "conv_transpose"),
          f"{prefix}out_net": ("out", "dense")}


CLIP_EVALUATOR_IGNORED = ("motion_encoder.sequence_pos_encoder.pe",)  # a sine table


def clip_evaluator_names(depth=8):
  """MARDM's CLIP-type evaluator: what lies under contrast_model/ in its file."""
  table = {"positional_embedding": ("positions", "array"), "logit_scale": ("logit_scale", "array"),
           "motion_encoder.query_token": ("query", "array"), "motion_encoder.embed_motion": ("embed", "dense"),
           "motion_encoder.out_ln": ("motion_norm", "norm"), "motion_encoder.out": ("motion_out", "dense"),
           "token_embedding.weight": ("tokens", "array"), "text_ln": ("text_norm", "norm"),
           "out": ("text_out", "dense")}
  for i in range(depth):
    table |= post_norm_names(f"motion_encoder.transformer.layers.{i}", f"motion_layers_{i}")
    table |= post_norm_names(f"textTransEncoder.layers.{i}", f"text_layers_{i}")
  return table


def length_estimator_names():
  """MARDM's length estimator."""
  table = {"output.11": ("out", "dense")}
  for i, place in enumerate((0, 4, 8)):
    table |= {f"output.{place}": (f"layer{i}", "dense"), f"output.{place + 1}": (f"norm{i}", "norm")}
  return table


def diffusion_mlp_names(depth, prefix="net.", ours=""):
  """The diffusion head of CDAMD and MARDM (facts: cdamd 5), below `prefix` there and `ours` here."""
  table = {"time_embed.mlp.0": ("time_in", "dense"), "time_embed.mlp.2": ("time_out", "dense"),
           "cond_embed": ("condition_in", "dense"), "input_proj": ("x_in", "dense"),
           "final_layer.linear": ("out", "dense"), "final_layer.adaLN_modulation.1": ("film", "dense")}
  for i in range(depth):
    table |= {f"res_blocks.{i}.in_ln": (f"block{i}/norm", "norm"),
              f"res_blocks.{i}.mlp.0": (f"block{i}/ff_in", "dense"),
              f"res_blocks.{i}.mlp.2": (f"block{i}/ff_out", "dense"),
              f"res_blocks.{i}.adaLN_modulation.1": (f"block{i}/film", "dense")}
  return _below(table, prefix, ours)


def _below(table, theirs, ours):
  return {theirs + name: (ours + path, kind) for name, (path, kind) in table.items()}


def _generator_names(table, head_depth):
  """A table of a transformer, and that of its diffusion head if it has one; then both lie in a `Generator`."""
  table |= {"mask_latent": ("inputs/mask_latent", "array"), "input_process.poseEmbedding": ("inputs/x_in", "dense"),
            "cond_emb": ("inputs/text_in", "dense")}
  if head_depth is None:
    return table
  return _below(table, "", "transformer/") | diffusion_mlp_names(head_depth, "DiffMLPs.net.", "head/")


def masked_transformer_names(depth, head_depth=None):
  """CDAMD's transformer (facts: cdamd 4); with head_depth, layers of the diffusion head, the whole generator."""
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


def mardm_names(depth, head_depth=None):
  """MARDM's transformer (facts: cdamd 4.5), alone or with its diffusion head."""
  table = {}
  for i in range(depth):
    theirs, ours = f"MARTransformer.{i}", f"block{i}"
    table |= {f"{theirs}.attn.{name}": (f"{ours}/self_attn/{short}", "dense")
              for name, short in (("query", "q"), ("key", "k"), ("value", "v"), ("proj", "o"))}
    table |= {f"{theirs}.mlp.fc1": (f"{ours}/ff_in", "dense"), f"{theirs}.mlp.fc2": (f"{ours}/ff_out", "dense"),
              f"{theirs}.adaLN_modulation.1": (f"{ours}/film", "dense")}
  return _generator_names(table, head_depth)
