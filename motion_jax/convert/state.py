"""PyTorch files to flat dicts of arrays, and those to parameters by a table of names."""
import pathlib

import flax
import numpy as np

from motion_jax.convert import torch_files
from motion_jax.utils.input_files import INDEX, load_safetensors

_DEEPEST, _MOST = 32, 1_000_000  # levels and entries of a checkpoint
Table = dict[str, tuple[str, str]]  # {name of the reference: (our path, kind of `_KINDS`)}


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
    "transposed": {"": ("", np.transpose)},
    "conv_transpose": {"weight": ("kernel", lambda w: w.transpose(2, 0, 1)[::-1]), "bias": ("bias", None)},
    "first_state": {"": ("", lambda h: h.squeeze(1))},
    "gru": {f"{theirs}_l0{direction}": (f"{part}/{ours}", turn)
            for part, direction in (("forward", ""), ("backward", "_reverse"))
            for theirs, ours, turn in (("weight_ih", "w_in", np.transpose), ("weight_hh", "w_hidden", np.transpose),
                                       ("bias_ih", "b_in", None), ("bias_hh", "b_hidden", None))},
    "attention_in": {"in_proj_weight": _split("kernel", _QKV, np.transpose),
                     "in_proj_bias": _split("bias", _QKV, lambda b: b)},
    "qkv_in": {"in_proj_weight": _split("kernel", "qkv", np.transpose),
               "in_proj_bias": _split("bias", "qkv", lambda b: b)},
    "qkv": {"weight": _split("kernel", "qkv", np.transpose), "bias": _split("bias", "qkv", lambda b: b)},
    "qkv_plain": {"weight": _split("kernel", "qkv", np.transpose)},
    "kernel": {"weight": ("kernel", lambda w: w.T)},
    "patches": {"weight": ("kernel", lambda w: w.reshape(len(w), -1).T), "bias": ("bias", None)},
    "first": {"": ("", lambda a: a.squeeze(0))},
    "first_row": {"": ("", lambda a: a.squeeze((0, 1)))},
    "middle": {"": ("", lambda a: a.squeeze(1))},
}


def load_state(path):
  """A flat dict of numpy arrays from a .safetensors file, its shards or a PyTorch checkpoint, never unpickled.

  A checkpoint that nests its weights gives keys joined by "/": "ema_model/x_embedder.weight".
  """
  return load_checkpoint(path)[0]


def load_checkpoint(path):
  """What load_state gives, and the names of the entries that hold no tensor: counters, schedules."""
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no checkpoint {path}")
  if path.suffix == ".safetensors" or path.name.endswith(INDEX):
    return load_safetensors(path, advice="it is no whole safetensors file: fetch it again"), set()
  state = torch_files.load(path)
  if not isinstance(state, dict):
    raise ValueError(f"{path} holds a {type(state).__name__}, expected a dict of tensors")
  flat, seen = {}, 0

  def collect(prefix, value, depth):
    nonlocal seen
    seen += 1
    if depth > _DEEPEST or seen > _MOST:  # dictionaries that hold each other have no end
      raise ValueError(f"{path} nests its entries without end; expected a dict of tensors")
    if isinstance(value, dict):
      for key, inner in value.items():
        collect(f"{prefix}/{key}" if prefix else str(key), inner, depth + 1)
    elif isinstance(value, np.ndarray):
      if value.dtype.kind == "c":
        raise ValueError(f"{path} holds complex numbers ({prefix}), which no network here has")
      flat[prefix] = np.array(value, np.float32, order="C")  # ascontiguousarray would make a vector of a number

  collect("", state, 0)
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


def post_norm_names(theirs, ours):
  """PyTorch's TransformerEncoderLayer, whose attention keeps q, k and v in one matrix, as `nets.post_norm`'s layer."""
  return {f"{theirs}.self_attn": (ours, "attention_in"), f"{theirs}.self_attn.out_proj": (f"{ours}/out", "dense"),
          f"{theirs}.linear1": (f"{ours}/mlp_in", "dense"), f"{theirs}.linear2": (f"{ours}/mlp_out", "dense"),
          f"{theirs}.norm1": (f"{ours}/attn_norm", "norm"), f"{theirs}.norm2": (f"{ours}/mlp_norm", "norm")}


def post_norm_decoder_names(theirs, ours):
  """PyTorch's TransformerDecoderLayer as `nets.post_norm`'s."""
  table = {f"{theirs}.linear1": (f"{ours}/mlp_in", "dense"), f"{theirs}.linear2": (f"{ours}/mlp_out", "dense"),
           f"{theirs}.norm1": (f"{ours}/attn_norm", "norm"), f"{theirs}.norm2": (f"{ours}/cross_norm", "norm"),
           f"{theirs}.norm3": (f"{ours}/mlp_norm", "norm")}
  for attention, name in (("self_attn", "self_attn"), ("multihead_attn", "cross_attn")):
    table |= {f"{theirs}.{attention}": (f"{ours}/{name}", "qkv_in"),
              f"{theirs}.{attention}.out_proj": (f"{ours}/{name}/o", "dense")}
  return table
