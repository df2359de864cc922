"""T2M-GPT's released weights: VQ-VAE and GPT (docs/papers/t2m_gpt.md)."""
import pathlib
from typing import Any

from motion_jax.convert.parts import Network, check_free, heads_of, network, read_part, stats_of, text_files, write
from motion_jax.latents import TOKENIZER
from motion_jax.models.shared.autoencoder_weights import one_level, rvq, write_tokenizer
from motion_jax.models.t2m_gpt.stages import gpt_shapes
from motion_jax.models.t2m_gpt.weight_names import UNUSED, gpt_names
from motion_jax.nets.token_gpt import CodeGPT
from motion_jax.training import checkpoint

TEXT = "clip-vit-base-patch32"
HEADS = {1024: 16, 512: 8}  # by width: the released model's, the options' default


def gpt(path: str | pathlib.Path, num_heads: int | None = None) -> Network:
  """The GPT, "trans" of net_best_fid.pth. Tables of positions, one unused and one a formula, and masks are left out."""
  what, part = "GPT", read_part(path, choices=("trans",))
  rows, width = part.shape("trans_base.tok_emb.weight", what, 2)
  length = part.shape("trans_base.pos_embedding.weight", what, 2)[0]
  half = part.count(r"trans_base\.blocks\.(\d+)\.")
  if half != part.count(r"trans_head\.blocks\.(\d+)\."):
    raise ValueError(f"{part.source['file']} has {half} blocks in trans_base and another number in trans_head, "
                     "expected two equal halves")
  fields = dict(num_codes=rows - 2, width=width, depth=2 * half,
                num_heads=heads_of(num_heads, width, HEADS.get(width)),
                ff_width=part.shape("trans_base.blocks.0.mlp.0.weight", what, 2)[0],
                text_dim=part.shape("trans_base.cond_emb.weight", what, 2)[1], max_length=length, dropout=0.1)
  net = CodeGPT(**fields)
  unused = tuple(name for name in part.state if UNUSED.fullmatch(name))
  return network(what, part, net, fields, gpt_shapes(net), gpt_names(half), unused)


def write_t2m_gpt(out: str | pathlib.Path, tokenizer_file: str | pathlib.Path, stats: Any,
                  gpt_file: str | pathlib.Path | None = None, text: str | None = None, num_heads: int | None = None
                  ) -> list[Network]:
  """The run folder of a released T2M-GPT -> the Networks; without a GPT, that of its VQ-VAE.

  stats: a folder with the statistics of training, VQVAEV3_CB1024_CMT_H1024_NRES3/meta. text: folder of the text
  encoder; without one the run names CLIP ViT-B/32, and loading says where to put it.
  """
  check_free(out)
  codes = rvq(tokenizer_file, choices=("net",), turn=one_level)
  stats = stats_of(stats, codes.fields["features"], means=("mean.npy", "Mean.npy"))
  if gpt_file is None:
    return write_tokenizer(out, codes, stats, "t2m_gpt.vq")
  net, tokenizer = gpt(gpt_file, num_heads), dict(codes.fields)
  quantizer = {name: tokenizer.pop(name) for name in ("num_levels", "num_codes")}
  if net.fields["num_codes"] != quantizer["num_codes"]:
    raise ValueError(f"the GPT knows {net.fields['num_codes']} codes, the VQ-VAE has {quantizer['num_codes']}; they "
                     "are of different trainings")
  kit = stats.layout.skeleton.name == "kit"
  config = dict(
      stage="t2m_gpt.gpt", tokenizer=tokenizer, quantizer=quantizer, model=net.fields,
      data=dict(layout=stats.layout.name, mode="benchmark", min_frames=24 if kit else 40, max_frames=196),
      sampler=dict(guidance_scale=1.0, draw="categorical", temperature=1.0),
      frozen=dict(text=str(text or TEXT), text_level="sentence", tokenizer=checkpoint.FROZEN))
  files = text_files(text, net.fields["text_dim"], "GPT", f"{TEXT} has 512", level="sentence")
  write(out, config, [codes, net], net.params, stats, {TOKENIZER: codes.params}, files)
  return [codes, net]
