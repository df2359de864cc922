"""CMDM's released weights: tokenizer and denoiser (docs/papers/cmdm.md#checkpoint-names)."""
import pathlib
from typing import Any

from ml_collections import ConfigDict

from motion_jax import paper_tables, runs
from motion_jax.convert.parts import Network, check_free, heads_of, network, read_part, text_files, write
from motion_jax.latents import TOKENIZER, VaeCodec
from motion_jax.models import cmdm
from motion_jax.models.cmdm.weight_names import causal_dit_names, causal_vae_names
from motion_jax.motion.representations import layout_for
from motion_jax.motion.stats import load_stats
from motion_jax.nets.causal_dit import SIZES, CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.training import checkpoint

# (width, depth) -> heads: the paper's sizes, and the code's dit_large.
HEADS = {(size["width"], size["depth"]): size["num_heads"] for size in SIZES.values()} | {(512, 20): 4}
WEIGHTS = {"ema": "ema_model", "model": "model"}
TEXT = "distilbert-base-uncased"
# The model whose numbers the paper prints; what is converted of other sizes is in none of its rows.
PAPERS_VAE = dict(features=263, latent_dim=64, width=1024, num_halvings=2, dilations=(9, 3, 1), teacher_dim=256)
PAPERS_DIT = dict(latent_dim=64, width=512, depth=8, num_heads=4, ff_width=1024, block=3, text_dim=768)


def tokenizer(path: str | pathlib.Path) -> Network:
  """A released MAC-VAE, "ae" of net_best_fid.tar."""
  what, part = "tokenizer", read_part(path, ("ae",))
  width, features, _ = part.shape("encoder.model.0.conv.weight", what, 3)
  _, latent_dim = part.shape("decode_proj.weight", what, 2)
  halvings = part.count(r"encoder\.model\.(\d+)\.0\.conv\.weight")
  depth = part.count(r"encoder\.model\.2\.1\.model\.(\d+)\.conv1\.weight")
  fields = dict(features=features, latent_dim=latent_dim, width=width, num_halvings=halvings,
                dilations=tuple(3 ** b for b in reversed(range(depth))))
  reversed_too = "linear_proj_aux.weight" in part.state
  if reversed_too:
    fields |= dict(teacher_dim=part.shape("linear_proj_aux.weight", what, 2)[1], teacher_to_latent=True)
  elif "linear_proj_z.weight" in part.state:
    fields |= dict(teacher_dim=part.shape("linear_proj_z.weight", what, 2)[0])
  vae = CausalVAE(**fields)
  table = causal_vae_names(halvings, depth, bool(vae.teacher_dim), reversed_too)
  return network(what, part, vae, fields, cmdm.frozen_shapes(vae)[TOKENIZER], table)


def denoiser(path: str | pathlib.Path, weights: str = "ema", num_heads: int | None = None, block: int = 3) -> Network:
  """A released Causal-DiT, "ema_model" (the one that is evaluated) or "model" of latest.tar.

  num_heads: without it, that of the paper's size with this width and depth.
  """
  if weights not in WEIGHTS:
    raise ValueError(f"got weights {weights!r}, expected one of {', '.join(WEIGHTS)}")
  if block < 1:
    raise ValueError(f"got --block {block}, expected a number of latents such as 3")
  what, part = "denoiser", read_part(path, (WEIGHTS[weights],), others=WEIGHTS.values())
  width, latent_dim = part.shape("x_embedder.weight", what, 2)
  ff_width, _ = part.shape("blocks.0.ffn.0.weight", what, 2)
  depth = part.count(r"blocks\.(\d+)\.")
  heads = heads_of(num_heads, width, HEADS.get((width, depth)))
  fields = dict(latent_dim=latent_dim, width=width, depth=depth, num_heads=heads, ff_width=ff_width, block=block,
                text_dim=part.shape("y_embedder.weight", what, 2)[1])
  dit = CausalDiT(**fields)
  return network(what, part, dit, fields, cmdm.denoiser_shapes(dit), causal_dit_names(depth))


def write_cmdm(out: str | pathlib.Path, tokenizer_file: str | pathlib.Path, stats: Any,
               denoiser_file: str | pathlib.Path | None = None, text: str | None = None, weights: str = "ema",
               num_heads: int | None = None, block: int = 3) -> list[Network]:
  """The run folder of a released CMDM; without a denoiser, that of its tokenizer -> the Networks.

  stats: a folder with the Mean.npy and Std.npy of the training data, which the checkpoints do not hold. text: folder
  of the text encoder; without one the run names DistilBERT, and loading says where to put it.
  """
  check_free(out)
  vae = tokenizer(tokenizer_file)
  layout = layout_for(vae.fields["features"])
  stats = load_stats(stats, layout)
  if denoiser_file is None:
    config = dict(stage="cmdm.tokenizer", model=vae.fields, frozen={}, data=dict(layout=layout.name))
    rows = {table: paper_tables.CMDM[table] for table in ("cmdm 8", "cmdm 9")} if vae.fields == PAPERS_VAE else {}
    config["paper_row"] = paper_tables.claim(runs.with_defaults(ConfigDict(config)), rows)
    write(out, config, [vae], vae.params, stats)
    return [vae]
  dit = denoiser(denoiser_file, weights, num_heads, block)
  if dit.fields["latent_dim"] != vae.fields["latent_dim"]:
    raise ValueError(f"the denoiser makes latents of {dit.fields['latent_dim']} numbers, those of the tokenizer have "
                     f"{vae.fields['latent_dim']}; they are of different trainings")
  files = text_files(text, dit.fields["text_dim"], "denoiser", f"{TEXT} has 768")
  config = dict(stage="cmdm.denoiser", tokenizer=vae.fields, model=dit.fields,
                frozen=dict(text=str(text or TEXT), tokenizer=checkpoint.FROZEN),
                data=dict(layout=layout.name, max_frames=192, max_words=64),
                sampler=dict(num_steps=50, lag=2, guidance_scale=3.0))  # docs/papers/cmdm.md#fss, #guidance
  as_paper = vae.fields == PAPERS_VAE and dit.fields == PAPERS_DIT
  config["paper_row"] = paper_tables.claim(runs.with_defaults(ConfigDict(config)),
                                           paper_tables.CMDM if as_paper else {})
  frozen = VaeCodec(vae.module, vae.params).unscaled().parts  # Parity: released latents are not scaled
  write(out, config, [vae, dit], dit.params, stats, frozen, files)
  return [vae, dit]
