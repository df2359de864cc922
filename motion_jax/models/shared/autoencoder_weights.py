"""Released weights of the networks that several methods share: autoencoder, RVQ-VAE, length estimator."""
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import ml_collections
import numpy as np

from motion_jax.convert.parts import Network, network, read_part, write
from motion_jax.convert.state import Table, from_torch
from motion_jax.models.shared import length as lengths
from motion_jax.models.shared.autoencoders import autoencoder_shapes
from motion_jax.motion.stats import Stats
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.quant.vq import codebook_of
from motion_jax.training import checkpoint

# --- names --------------------------------------------------------------------------------------------------------


def autoencoder_names(num_halvings: int = 2, depth: int = 3) -> Table:
  """AE of CDAMD and MARDM (docs/papers/cdamd.md#autoencoder)."""
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


def rvq_names(num_levels: int = 4, num_halvings: int = 2, depth: int = 3) -> Table:
  """RVQ-VAE of CDAMD (docs/papers/cdamd.md#rvq), the codes of level q under codes/q."""
  levels = {f"quantizer.layers.{q}.codebook": (f"codes/{q}", "array") for q in range(num_levels)}
  return autoencoder_names(num_halvings, depth) | levels


def one_level(state: Mapping[str, Any]) -> dict[str, Any]:
  """T2M-GPT's VQ-VAE under the names of an RVQ-VAE of one level."""
  return {name.removeprefix("vqvae.").replace("quantizer.codebook", "quantizer.layers.0.codebook"): array
          for name, array in state.items()}


def rvq_from_torch(state: Mapping[str, Any], num_levels: int = 4, num_halvings: int = 2, depth: int = 3
                   ) -> dict[str, Any]:
  """RVQ-VAE of CDAMD as it is used: {"params", "codebooks"} with all fields of `quant.vq.Codebook`."""
  params = from_torch(state, rvq_names(num_levels, num_halvings, depth))["params"]
  codes = params.pop("codes")
  book = codebook_of(np.stack([codes[str(q)] for q in range(num_levels)]))
  return {"params": params, "codebooks": jax.tree.map(np.asarray, book._asdict())}


def length_estimator_names() -> Table:
  """MARDM's length estimator."""
  table = {"output.11": ("out", "dense")}
  for i, place in enumerate((0, 4, 8)):
    table |= {f"output.{place}": (f"layer{i}", "dense"), f"output.{place + 1}": (f"norm{i}", "norm")}
  return table


# --- files --------------------------------------------------------------------------------------------------------


def _layers(part, what):
  """Fields of an `Autoencoder`. Growth of the dilations, 3, is the released code's; no tensor tells it."""
  width, features, _ = part.shape("encoder.model.0.weight", what, 3)
  halvings = part.count(r"encoder\.model\.(\d+)\.0\.weight")
  latent_dim, *_ = part.shape(f"encoder.model.{2 + halvings}.weight", what, 3)
  depth = part.count(r"encoder\.model\.2\.1\.model\.(\d+)\.conv1\.weight")
  return dict(features=features, latent_dim=latent_dim, width=width, num_halvings=halvings,
              dilations=tuple(3 ** b for b in reversed(range(depth))), dropout=0.2)


def autoencoder(path: str | pathlib.Path) -> Network:
  """A released AE, "ae" of latest.tar or net_best_fid.tar."""
  what, part = "autoencoder", read_part(path, ("ae",))
  fields = _layers(part, what)
  net = Autoencoder(**fields)
  table = autoencoder_names(net.num_halvings, len(net.dilations))
  return network(what, part, net, fields, autoencoder_shapes(net), table)


def rvq(path: str | pathlib.Path, choices: Sequence[str] = ("vq_model", "net"),
        turn: Callable[[dict[str, Any]], dict[str, Any]] = dict) -> Network:
  """A released RVQ-VAE, "vq_model" (or "net") of latest.tar or net_best_fid.tar; params are {"params", "codebooks"}.

  choices: entries that may hold it; turn: renames its tensors.

  Files hold the codes and neither their running sums nor counts: training continues as if each was used once.
  """
  what, part = "RVQ-VAE", read_part(path, choices=choices)
  part = part._replace(state=turn(part.state))
  fields = _layers(part, what)
  num_levels = max(part.count(r"quantizer\.layers\.(\d+)\.codebook"), 1)
  shapes = [part.shape(f"quantizer.layers.{level}.codebook", what, 2) for level in range(num_levels)]
  if len(set(shapes)) > 1 or shapes[0][1] != fields["latent_dim"]:
    raise ValueError(f"{part.source['file']} does not fit an {what}: its codebooks have the shapes {shapes}, expected "
                     f"the same for all, with codes of {fields['latent_dim']} numbers as latents")
  quantizer = dict(num_levels=num_levels, num_codes=shapes[0][0])
  net = Autoencoder(**fields)
  params = rvq_from_torch(part.state, num_levels, net.num_halvings, len(net.dilations))
  expected = autoencoder_shapes(net, ml_collections.ConfigDict(quantizer))
  checkpoint.check_fits(params, expected, f"{part.source['file']} does not fit an {what}")
  return Network(what, net, fields | quantizer, params, part)


def length_estimator(path: str | pathlib.Path) -> Network:
  """MARDM's length estimator, "estimator" of finest.tar or latest.tar."""
  what, part = "length estimator", read_part(path, choices=("estimator", "length_estimator"))
  width, text_dim = part.shape("output.0.weight", what, 2)
  net = LengthEstimator(num_classes=part.shape("output.11.weight", what, 2)[0], width=width)
  fields = dict(num_classes=net.num_classes, width=width, dropout=0.2)
  return network(what, part, net, fields, lengths.length_shapes(net, text_dim), length_estimator_names())


def write_tokenizer(out: str | pathlib.Path, made: Network, stats: Stats, stage: str) -> list[Network]:
  """The run folder of an autoencoder or RVQ-VAE alone -> its Network."""
  fields = dict(made.fields)
  config: dict[str, Any] = dict(stage=stage, frozen={}, data=dict(layout=stats.layout.name))
  if "num_levels" in fields:
    config |= dict(quantizer={name: fields.pop(name) for name in ("num_levels", "num_codes")})
  write(out, config | dict(model=fields), [made], made.params, stats)
  return [made]
