"""MLD's released weights as run folders (docs/papers/mld.md#files)."""
import pathlib
from typing import Any

import numpy as np

from motion_jax.convert.parts import (
  Network,
  NetworkState,
  check_free,
  encoder_of,
  heads_of,
  network,
  read_part,
  stats_of,
  write,
)
from motion_jax.convert.state import select
from motion_jax.models.mld.stages import VAE, denoiser_shapes, vae_shapes
from motion_jax.models.mld.weight_names import UNUSED, denoiser_names, vae_names
from motion_jax.models.shared.captioned_batches import NO_CAPTION
from motion_jax.motion.representations import layout_for
from motion_jax.nets.latent_diffusion import TokenDenoiser, TokenVAE
from motion_jax.training import checkpoint
from motion_jax.training.setup import text_identity

TEXT = "clip-vit-large-patch14"


def networks(path: str | pathlib.Path, num_heads: int | None = None) -> list[Network]:
  """[VAE, denoiser] of a Lightning checkpoint's state_dict, or [denoiser] of frames where it has no VAE; the networks
  of its evaluator are left aside."""
  whole = read_part(path, ("state_dict",), others=_lightning(path))
  if "denoiser.pose_embd.weight" in whole.state:
    return [_denoiser(whole, 1, num_heads)]
  what, part = "VAE", _below(whole, "vae.")
  count, width = part.shape("global_motion_token", what, 2)
  depth = 2 * part.count(r"encoder\.input_blocks\.(\d+)\.") + 1
  fields = dict(features=part.shape("final_layer.weight", what, 2)[0], width=width, num_tokens=count // 2, depth=depth,
                num_heads=_heads(num_heads, width),
                mlp_width=part.shape("encoder.middle_block.linear1.weight", what, 2)[0],
                max_length=part.shape("query_pos_encoder.pe", what, 3)[0])
  vae = TokenVAE(**fields)
  return [network(what, part, vae, fields, vae_shapes(vae), vae_names(depth)),
          _denoiser(whole, vae.num_tokens, num_heads)]


def _heads(num_heads, width):
  return heads_of(num_heads, width, 4 if width in (256, 512) else None)


def _denoiser(whole, num_tokens, num_heads):
  """The denoiser of latents, or of frames, which has layers for them."""
  what, part = "MLD denoiser", _below(whole, "denoiser.")
  width, text_dim = part.shape("time_embedding.linear_1.weight", what, 2)
  framewise = "pose_embd.weight" in part.state
  depth = part.count(r"decoder\.layers\.(\d+)\.") if framewise else 2 * part.count(
      r"encoder\.input_blocks\.(\d+)\.") + 1
  layer = "decoder.layers.0" if framewise else "encoder.middle_block"
  features = part.shape("pose_embd.weight", what, 2)[1] if framewise else 0
  fields = dict(width=width, depth=depth, num_heads=_heads(num_heads, width), text_dim=text_dim, features=features,
                mlp_width=part.shape(f"{layer}.linear1.weight", what, 2)[0],
                max_length=part.shape("query_pos.pe", what, 3)[0])
  net = TokenDenoiser(**fields)
  table = denoiser_names(depth, features, "emb_proj.1.weight" in part.state)
  return network(what, part, net, fields, denoiser_shapes(net, num_tokens), table, () if framewise else UNUSED)


def _lightning(path):
  """Entries of a Lightning checkpoint besides its weights."""
  return ("callbacks", "hparams_name", "hyper_parameters", "loops", "lr_schedulers", "optimizer_states",
          "native_amp_scaling_state")


def _below(part, prefix):
  return NetworkState(select(part.state, prefix), part.source, part.left)


def write_mld(out: str | pathlib.Path, file: str | pathlib.Path, stats: Any, text: str,
              num_heads: int | None = None) -> list[Network]:
  """The run folder of a released MLD with its VAE, or of the one without -> the Networks.

  stats: a folder with Mean.npy and Std.npy of the training data. text: folder of the text encoder, CLIP ViT-L/14, which
  is needed: the run keeps the vector of an empty caption.
  """
  check_free(out)
  *vaes, denoiser = parts = networks(file, num_heads)
  encoder = encoder_of(text, denoiser.fields["text_dim"], "MLD denoiser", TEXT)
  features = (vaes or parts)[0].fields["features"]
  frozen: dict[str, Any] = {NO_CAPTION: np.asarray(encoder.no_caption())}
  config: dict[str, Any] = dict(
      stage="mld.frames", model=denoiser.fields | dict(num_steps=1000),
      frozen=dict(text=str(text), text_level="sentence"),
      diffusion=dict(num_steps=1000, predicts="noise"), loss=dict(drop_rate=0.1, mask_frames=False),
      data=dict(layout=layout_for(features).name, mode="benchmark", max_frames=196, max_words=64),
      sampler=dict(guidance_scale=7.5, num_steps=1000, solver="ancestral"))
  if vaes:
    config |= dict(stage="mld.denoiser", tokenizer=vaes[0].fields, loss=dict(drop_rate=0.1),
                   sampler=dict(guidance_scale=7.5, num_steps=50, solver="ddim"))
    config["frozen"] |= dict(tokenizer=checkpoint.FROZEN)
    frozen[VAE] = vaes[0].params
  write(out, config, parts, denoiser.params, stats_of(stats, features), frozen,
        {checkpoint.TEXT: text_identity(encoder)})
  return parts
