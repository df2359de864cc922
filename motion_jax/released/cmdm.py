"""CMDM's released weights: tokenizer, denoiser, teacher (names in facts: cmdm 9)."""
import re

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax import checkpoint, cmdm, convert
from motion_jax.motion.features import layout_for
from motion_jax.motion.stats import load_stats
from motion_jax.nets.causal_dit import SIZES, CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.recipes.cmdm import bert_fields_of, text_identity
from motion_jax.released.parts import Network, check_free, heads_of, network, read_part, text_files, write
from motion_jax.teacher import make_teacher
from motion_jax.text.encoder import load_text_encoder

# (width, depth) -> heads: the paper's sizes, and the code's dit_large.
HEADS = {(size["width"], size["depth"]): size["num_heads"] for size in SIZES.values()} | {(512, 20): 4}
WEIGHTS = {"ema": "ema_model", "model": "model"}
TEXT = "distilbert-base-uncased"


def tokenizer(path) -> Network:
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
  table = convert.causal_vae_names(halvings, depth, bool(vae.teacher_dim), reversed_too)
  return network(what, part, vae, fields, cmdm.frozen_shapes(vae)["tokenizer"], table)


def denoiser(path, weights="ema", num_heads=None, block=3) -> Network:
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
  return network(what, part, dit, fields, cmdm.denoiser_shapes(dit), convert.causal_dit_names(depth))


def teacher(path, layout, num_heads=None, text_fields=None) -> Network:
  """A released Part-TMR with its text transformer; params are {"motion": ..., "text": ...}.

  text_fields: of its `Bert`; without them, DistilBERT's sizes.
  """
  what, part = "teacher", read_part(path)
  stack = "motion_encoder.seqTransEncoder_Root.layers"
  width, _ = part.shape("motion_encoder.skel_embedding_Root.weight", what, 2)
  depth = part.count(re.escape(stack) + r"\.(\d+)\.")
  fields = dict(kind="part_tmr", width=width, depth=depth, num_heads=heads_of(num_heads, width, 4),
                mlp_width=part.shape(f"{stack}.0.linear1.weight", what, 2)[0],
                dim=part.shape("motion_projection.projection.weight", what, 2)[0], dropout=0.1, head_dropout=0.5,
                pool="all")
  text_fields = text_fields or _distilbert_fields(part)
  module = make_teacher(fields, layout)
  shapes = jax.eval_shape(lambda: module.init(jax.random.key(0), jnp.zeros((1, 4, layout.dim)),
                                              jnp.zeros((1, text_fields["width"]))))
  params = convert.part_tmr_from_torch(part.state, text_fields, depth)
  checkpoint.check_fits(params["motion"], shapes["params"], f"{part.source['file']} does not fit a {what}")
  return Network(what, module, fields | {"text": text_fields}, params, part)


def _distilbert_fields(part):
  what, prefix = "Part-TMR with DistilBERT", "text_encoder.text_model."
  vocab_size, width = part.shape(f"{prefix}embeddings.word_embeddings.weight", what, 2)
  if width != 768:
    raise ValueError(f"the teacher's text transformer has width {width}, DistilBERT has 768; the tensors do not tell "
                     "its number of heads, give the folder that it started from with --text")
  return dict(vocab_size=vocab_size, width=width, num_heads=12,
              num_layers=part.count(re.escape(prefix) + r"transformer\.layer\.(\d+)\."),
              mlp_width=part.shape(f"{prefix}transformer.layer.0.ffn.lin1.weight", what, 2)[0],
              max_positions=part.shape(f"{prefix}embeddings.position_embeddings.weight", what, 2)[0])


def write_cmdm(out, tokenizer_file, stats, denoiser_file=None, text=None, weights="ema", num_heads=None, block=3):
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
                sampler=dict(num_steps=50, lag=2, guidance_scale=3.0))  # facts: cmdm 8, inference
  zeros = np.zeros(vae.fields["latent_dim"], np.float32)  # Parity: released latents are not scaled
  frozen = {"tokenizer": vae.params, "latent_mean": zeros, "latent_std": zeros + 1}
  write(out, config, [vae, dit], dit.params, stats, frozen, files)
  return [vae, dit]


def write_teacher(out, file, stats, text=None, num_heads=None):
  """The run folder of a released Part-TMR -> the Networks. text: folder of the text encoder that it started from,
  whose word pieces it reads; its own weights are those of the file."""
  check_free(out)
  stats = load_stats(stats)
  encoder = None if text is None else load_text_encoder(text)
  made = teacher(file, stats.layout, num_heads, encoder and bert_fields_of(encoder.model))
  fields = dict(made.fields)
  config = dict(stage="cmdm.teacher", text=fields.pop("text"), model=fields, frozen=dict(text=str(text or TEXT)),
                loss=dict(text_pool="first"), data=dict(layout=stats.layout.name, max_frames=196, max_words=77))
  files = {checkpoint.TEXT: text_identity(encoder)} if encoder else {}
  write(out, config, [made], made.params, stats, files=files)
  return [made]
