"""Parts of a motion made anew by CDAMD, the others kept."""
from typing import Any

import jax.numpy as jnp
from jaxtyping import Bool, Float

from motion_jax.latents import AutoencoderCodec
from motion_jax.models.cdamd.sampling import Plan, make_latents
from motion_jax.shapes import Array, Net


def edit(net: Net, plan: Plan, params: Any, codec: AutoencoderCodec, features: Float[Array, "b t f"], *,
         edited: Bool[Array, "b l"], real_mask: Bool[Array, "b l"], paste: bool = False, **given: Any
         ) -> Float[Array, "b t f"]:
  """Normalized features (B, 4 L, F): the given ones, of which the latents edited (B, L) are made anew. Pure.

  given: text_emb, masked and what else `make_latents` takes. paste: put the frames of kept latents back as they came.
  They have been through the autoencoder otherwise.
  """
  # Parity: the released code decodes everything and pastes nothing back.
  latents = codec.encode(features, real_mask)
  made = make_latents(net, plan, params, latents, real_mask=real_mask, **given)[-1]
  y = codec.decode(made, real_mask)
  if not paste:
    return y
  kept = codec.real_frames(~edited & real_mask)
  return jnp.where(kept[..., None], features[:, :y.shape[1]], y)
