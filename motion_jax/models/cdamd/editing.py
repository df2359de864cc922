"""Edit a motion with CDAMD: regenerate parts of it, keep the others."""
from typing import Any

from jaxtyping import Bool, Float

from motion_jax.latents import AutoencoderCodec
from motion_jax.models.cdamd.sampling import Plan, make_latents
from motion_jax.shapes import Array, Net


def edit(net: Net, plan: Plan, params: Any, codec: AutoencoderCodec, features: Float[Array, "b t f"], *,
         real_mask: Bool[Array, "b l"], **given: Any) -> Float[Array, "b t f"]:
  """Normalized features (B, 4 L, F): the given ones, with the latents sampled that the schedule names. Pure.

  given: text_emb, schedule and what else `make_latents` takes. All frames have been through the autoencoder.
  """
  # Parity: the released code decodes everything and pastes nothing back.
  latents = codec.encode(features, real_mask)
  made = make_latents(net, plan, params, latents, real_mask=real_mask, **given)
  return codec.decode(made, real_mask)
