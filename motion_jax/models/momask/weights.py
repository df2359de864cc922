"""MoMask's released weights: RVQ-VAE, masked and residual transformer, length estimator (docs/papers/momask.md)."""
import pathlib
from typing import Any

from motion_jax.convert.parts import (
  Network,
  NetworkState,
  check_free,
  check_sinusoids,
  heads_of,
  network,
  read_part,
  stats_of,
  text_files,
  without_clip,
  write,
)
from motion_jax.latents import TOKENIZER
from motion_jax.models.momask.stages import masked_shapes, residual_shapes
from motion_jax.models.momask.weight_names import POSITIONS, masked_names, residual_names
from motion_jax.models.shared.autoencoder_weights import length_estimator, rvq, write_tokenizer
from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
from motion_jax.training import checkpoint

TEXT = "clip-vit-base-patch32"
HEADS = {384: 6}  # of the released width; no tensor tells


def _trunk(part: NetworkState, what: str, num_heads: int | None) -> dict[str, Any]:
  width, code_dim = part.shape("input_process.poseEmbedding.weight", what, 2)
  check_sinusoids(part, POSITIONS, width)
  return dict(code_dim=code_dim, width=width, depth=part.count(r"seqTransEncoder\.layers\.(\d+)\."),
              num_heads=heads_of(num_heads, width, HEADS.get(width)),
              ff_width=part.shape("seqTransEncoder.layers.0.linear1.weight", what, 2)[0],
              text_dim=part.shape("cond_emb.weight", what, 2)[1], dropout=0.2)


def masked(path: str | pathlib.Path, num_heads: int | None = None) -> Network:
  """The masked transformer, "t2m_transformer" (or "trans") of latest.tar."""
  what = "masked transformer"
  part = without_clip(read_part(path, choices=("t2m_transformer", "trans")))
  fields = dict(num_codes=part.shape("token_emb.weight", what, 2)[0] - 2) | _trunk(part, what, num_heads)
  net = MaskedCodeTransformer(**fields)
  return network(what, part, net, fields, masked_shapes(net), masked_names(net.depth), (POSITIONS,))


def residual(path: str | pathlib.Path, num_heads: int | None = None) -> Network:
  """The residual transformer, "res_transformer" of net_best_fid.tar; whether its tables are shared its names tell."""
  what, part = "residual transformer", without_clip(read_part(path, choices=("res_transformer",)))
  shared = "token_embed_weight_" in part.state
  table = part.shape("embed_proj_shared_weight" if shared else "token_embed_weight", what, 3)
  fields = dict(num_codes=table[1] - 1, num_levels=table[0] + (2 if shared else 1), shared_tables=shared) | _trunk(
      part, what, num_heads)
  net = ResidualCodeTransformer(**fields)
  return network(what, part, net, fields, residual_shapes(net), residual_names(net.depth, shared), (POSITIONS,))


def write_momask(out: str | pathlib.Path, tokenizer_file: str | pathlib.Path, stats: Any,
                 masked_file: str | pathlib.Path | None = None, residual_file: str | pathlib.Path | None = None,
                 length_file: str | pathlib.Path | None = None, text: str | None = None, num_heads: int | None = None
                 ) -> list[Network]:
  """The run folder of a released MoMask -> the Networks; without a masked transformer, that of its RVQ-VAE.

  stats: a folder with the statistics of training, meta/mean.npy and std.npy beside the RVQ-VAE. text: folder of the
  text encoder; without one the run names CLIP ViT-B/32, and loading says where to put it.
  """
  check_free(out)
  codes = rvq(tokenizer_file)
  stats = stats_of(stats, codes.fields["features"], means=("mean.npy", "Mean.npy"))
  if masked_file is None:
    if residual_file or length_file:
      raise ValueError("a residual transformer or a length estimator makes no motion without --masked; give it, too")
    return write_tokenizer(out, codes, stats, "momask.rvq")
  transformer, networks = masked(masked_file, num_heads), [codes]
  tokenizer = dict(codes.fields)
  quantizer = {name: tokenizer.pop(name) for name in ("num_levels", "num_codes")}
  kit = stats.layout.skeleton.name == "kit"
  config: dict[str, Any] = dict(
      stage="momask.masked", tokenizer=tokenizer, quantizer=quantizer, model=transformer.fields, residual={}, length={},
      data=dict(layout=stats.layout.name, mode="benchmark", min_frames=24 if kit else 40, max_frames=196),
      sampler=dict(num_iterations=10, guidance_scale=2.0 if kit else 4.0, residual_scale=5.0))
  frozen = {TOKENIZER: codes.params}
  _demand_codes(transformer, quantizer)
  networks.append(transformer)
  if residual_file is not None:
    more = residual(residual_file, num_heads)
    _demand_codes(more, quantizer)
    if more.fields["num_levels"] != quantizer["num_levels"]:
      raise ValueError(f"the residual transformer knows {more.fields['num_levels']} levels of codes, the RVQ-VAE has "
                       f"{quantizer['num_levels']}; they are of different trainings")
    _demand_text(more.what, more.fields["text_dim"], transformer)
    frozen["residual"], config["residual"] = more.params, more.fields
    networks.append(more)
  if length_file is not None:
    estimator = length_estimator(length_file)
    _demand_text(estimator.what, estimator.params["params"]["layer0"]["kernel"].shape[0], transformer)
    frozen["length"], config["length"] = estimator.params, estimator.fields
    networks.append(estimator)
  files = text_files(text, transformer.fields["text_dim"], "masked transformer", f"{TEXT} has 512", level="sentence")
  config["frozen"] = dict(text=str(text or TEXT), text_level="sentence", tokenizer=checkpoint.FROZEN)
  write(out, config, networks, transformer.params, stats, frozen, files)
  return networks


def _demand_text(what, text_dim, net):
  if text_dim != net.fields["text_dim"]:
    raise ValueError(f"the {what} reads {text_dim} numbers of text, the {net.what} {net.fields['text_dim']}; they "
                     "are of different trainings, or leave it out")


def _demand_codes(net, quantizer):
  if net.fields["num_codes"] != quantizer["num_codes"]:
    raise ValueError(f"the {net.what} knows {net.fields['num_codes']} codes, the RVQ-VAE has "
                     f"{quantizer['num_codes']}; they are of different trainings")
