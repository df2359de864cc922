"""Parts of a motion made anew by CDAMD, the others kept."""

import jax.numpy as jnp

from motion_jax.models.cdamd.sampling import make_latents
from motion_jax.models.cdamd.stages import decode_latents, latents_of


def edit(net, autoencoder, plan, params, frozen, features, text_emb, edited, hidden, real_mask, scale, draw,
         paste=False, text_mask=None):
  """Normalized features (B, 4 L, F): the given ones, of which the latents edited (B, L) are made anew. Pure.

  paste: put the frames of kept latents back as they came. They have been through the autoencoder otherwise.
  """
  # Parity: the released code decodes everything and pastes nothing back.
  latents = latents_of(autoencoder, frozen, features, real_mask)
  made = make_latents(net, plan, params, text_emb, latents, hidden, real_mask, scale, draw, text_mask)[-1]
  y = decode_latents(autoencoder, frozen, made, real_mask)
  if not paste:
    return y
  kept = jnp.repeat(~edited & real_mask, autoencoder.frames_per_latent, axis=1)
  return jnp.where(kept[..., None], features[:, :y.shape[1]], y)
