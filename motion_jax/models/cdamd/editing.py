"""Parts of a motion made anew by CDAMD, the others kept."""

import jax.numpy as jnp

from motion_jax.models.cdamd.sampling import make_latents


def edit(net, plan, params, codec, features, *, edited, real_mask, paste=False, **given):
  """Normalized features (B, 4 L, F): the given ones, of which the latents edited (B, L) are made anew. Pure.

  given: text_emb, hidden and what else `make_latents` takes. paste: put the frames of kept latents back as they came.
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
