"""Gradients under the reference's names: a table of `convert` read backwards."""
import flax
import jax.numpy as jnp


def by_reference(tree, table):
  """{reference's name: array} of a tree of parameters or gradients under our names."""
  flat = flax.traverse_util.flatten_dict(tree, sep="/")
  stacked = lambda ours, parts, leaf: jnp.concatenate([flat[f"{ours}/{part}/{leaf}"].T for part in parts])
  parts = {"attention_in": ("query", "key", "value"), "qkv_in": "qkv", "qkv": "qkv"}
  plain = {"qkv_plain": "qkv", "kernel": ("",)}
  made = {}
  for theirs, (ours, kind) in table.items():
    if kind in parts:
      weight, bias = (".in_proj_weight", ".in_proj_bias") if kind != "qkv" else (".weight", ".bias")
      made[theirs + weight] = stacked(ours, parts[kind], "kernel")
      made[theirs + bias] = stacked(ours, parts[kind], "bias")
    elif kind in plain:
      made[f"{theirs}.weight"] = jnp.concatenate([
          flat[f"{ours}/{part}/kernel" if part else f"{ours}/kernel"].T for part in plain[kind]])
    elif kind == "dense":
      made |= {f"{theirs}.weight": flat[f"{ours}/kernel"].T, f"{theirs}.bias": flat[f"{ours}/bias"]}
    elif kind == "middle":
      made[theirs] = flat[ours][:, None]
    elif kind == "transposed":
      made[theirs] = flat[ours].T
    elif kind == "scale":
      made[f"{theirs}.weight"] = flat[f"{ours}/scale"]
    elif kind == "conv":
      made |= {f"{theirs}.weight": flat[f"{ours}/kernel"].transpose(2, 1, 0), f"{theirs}.bias": flat[f"{ours}/bias"]}
    elif kind == "pointwise":
      made |= {f"{theirs}.weight": flat[f"{ours}/kernel"].T[..., None], f"{theirs}.bias": flat[f"{ours}/bias"]}
    elif kind == "norm":
      made |= {f"{theirs}.weight": flat[f"{ours}/scale"], f"{theirs}.bias": flat[f"{ours}/bias"]}
    elif kind == "patches":
      made[f"{theirs}.bias"] = flat[f"{ours}/bias"]
    else:
      lead = {"array": 0, "first": 1, "first_row": 2}[kind]
      made[theirs] = flat[ours].reshape((1,) * lead + flat[ours].shape)
  return made
