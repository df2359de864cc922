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
from motion_jax.models.captioned_batches import NO_CAPTION
from motion_jax.models.mld.stages import VAE, denoiser_shapes, vae_shapes
from motion_jax.models.mld.weight_names import UNUSED, denoiser_names, vae_names
from motion_jax.motion.representations import layout_for
from motion_jax.nets.latent_diffusion import TokenDenoiser, TokenVAE
from motion_jax.training import checkpoint
from motion_jax.training.setup import text_identity

TEXT = "clip-vit-large-patch14"


def networks(path: str | pathlib.Path, num_heads: int | None = None) -> tuple[Network, Network]:
  """(VAE, denoiser) of a Lightning checkpoint's state_dict; the networks of its evaluator are left aside."""
  whole = read_part(path, ("state_dict",), others=_lightning(path))
  heads = lambda width: heads_of(num_heads, width, 4 if width == 256 else None)

  what, part = "VAE", _below(whole, "vae.")
  count, width = part.shape("global_motion_token", what, 2)
  depth = 2 * part.count(r"encoder\.input_blocks\.(\d+)\.") + 1
  fields = dict(features=part.shape("final_layer.weight", what, 2)[0], width=width, num_tokens=count // 2, depth=depth,
                num_heads=heads(width), mlp_width=part.shape("encoder.middle_block.linear1.weight", what, 2)[0],
                max_length=part.shape("query_pos_encoder.pe", what, 3)[0])
  vae = TokenVAE(**fields)
  encoded = network(what, part, vae, fields, vae_shapes(vae), vae_names(depth))

  what, part = "MLD denoiser", _below(whole, "denoiser.")
  width, text_dim = part.shape("time_embedding.linear_1.weight", what, 2)
  depth = 2 * part.count(r"encoder\.input_blocks\.(\d+)\.") + 1
  fields = dict(width=width, depth=depth, num_heads=heads(width), text_dim=text_dim,
                mlp_width=part.shape("encoder.middle_block.linear1.weight", what, 2)[0],
                max_length=part.shape("query_pos.pe", what, 3)[0])
  net = TokenDenoiser(**fields)
  table = denoiser_names(depth, has_text_layer="emb_proj.1.weight" in part.state)
  return encoded, network(what, part, net, fields, denoiser_shapes(net, vae.num_tokens), table, UNUSED)


def _lightning(path):
  """Entries of a Lightning checkpoint beside its weights."""
  return ("callbacks", "hparams_name", "hyper_parameters", "loops", "lr_schedulers", "optimizer_states",
          "native_amp_scaling_state")


def _below(part, prefix):
  return NetworkState(select(part.state, prefix), part.source, part.left)


def write_mld(out: str | pathlib.Path, file: str | pathlib.Path, stats: Any, text: str,
              num_heads: int | None = None) -> list[Network]:
  """The run folder of a released MLD with its VAE -> the Networks.

  stats: a folder with Mean.npy and Std.npy of the training data. text: folder of the text encoder, CLIP ViT-L/14, which
  is needed: the run keeps the vector of an empty caption.
  """
  check_free(out)
  vae, made = networks(file, num_heads)
  encoder = encoder_of(text, made.fields["text_dim"], "MLD denoiser", TEXT)
  layout = layout_for(vae.fields["features"])
  config = dict(stage="mld.denoiser", model=made.fields | dict(num_steps=1000), tokenizer=vae.fields,
                frozen=dict(text=str(text), text_level="sentence", tokenizer=checkpoint.FROZEN),
                diffusion=dict(num_steps=1000, predicts="noise"), loss=dict(drop_rate=0.1),
                data=dict(layout=layout.name, mode="benchmark", max_frames=196, max_words=64),
                sampler=dict(guidance_scale=7.5, num_steps=50, solver="ddim"))
  frozen = {VAE: vae.params, NO_CAPTION: np.asarray(encoder.no_caption())}
  write(out, config, [vae, made], made.params, stats_of(stats, vae.fields["features"]), frozen,
        {checkpoint.TEXT: text_identity(encoder)})
  return [vae, made]
