"""Attention masks as explicit boolean arrays: True = may attend."""
import jax.numpy as jnp

from motion_jax.shapes import Array, Bool, Int, Whole


def block_causal_mask(length: Whole, block: Whole | None = 1) -> Bool[Array, "1 1 {length} {length}"]:
  """(1, 1, L, L): a query sees all earlier blocks and its whole own block, in both directions.

  length 6, block 3      length 4, block 1      block 0: everything
    1 1 1 . . .            1 . . .
    1 1 1 . . .            1 1 . .
    1 1 1 . . .            1 1 1 .
    1 1 1 1 1 1            1 1 1 1
    1 1 1 1 1 1
    1 1 1 1 1 1
  """
  if not block:
    return jnp.ones((1, 1, length, length), bool)
  place = jnp.arange(length) // block
  return (place[None, :] <= place[:, None])[None, None]


def sliding_mask(length: Whole, block: Whole, context: Whole) -> Bool[Array, "1 1 {length} {length}"]:
  """(1, 1, L, L): block-causal, and no block more than context tokens back counting its own: constant cost per token.

  length 6, block 1, context 3      block 2, context 4
    1 . . . . .                       1 1 . . . .
    1 1 . . . .                       1 1 . . . .
    1 1 1 . . .                       1 1 1 1 . .
    . 1 1 1 . .                       1 1 1 1 . .
    . . 1 1 1 .                       . . 1 1 1 1
    . . . 1 1 1                       . . 1 1 1 1
  """
  if context % block:
    raise ValueError(f"got a context of {context} tokens, expected whole blocks of {block}")
  place = jnp.arange(length) // block
  near = place[:, None] - place[None, :] < context // block
  return block_causal_mask(length, block) & near[None, None]


def two_way_mask(attn_mask: Bool[Array, "#b 1 l k"], active_mask: Bool[Array, "#b l"]) -> Bool[Array, "b 1 l k"]:
  """(B, 1, L, P + L): attn_mask, and any two active latents of the last L see each other if one sees the other.

  active_mask (B, L): True = in denoising. Clean latents still see the past alone, so that their keys and values can be
  cached. A latent that attn_mask does not let see itself is padding, which stays unseen. Causal, 2 to 4 active:

    1 . . . . .
    1 1 . . . .
    1 1 1 1 1 .
    1 1 1 1 1 .
    1 1 1 1 1 .
    1 1 1 1 1 1
  """
  length = active_mask.shape[1]
  square = attn_mask[..., -length:]
  is_real = jnp.diagonal(square, axis1=-2, axis2=-1)[..., None, :]
  both = active_mask[:, None, :, None] & active_mask[:, None, None, :]
  square = square | (both & square.swapaxes(-1, -2) & is_real)
  before = jnp.broadcast_to(attn_mask[..., :-length], (*square.shape[:-1], attn_mask.shape[-1] - length))
  return jnp.concatenate([before, square], axis=-1)


def padding_mask(lengths: Int[Array, " b"], max_length: Whole) -> Bool[Array, "b {max_length}"]:
  """(B, L): True where position < lengths (B,).

  lengths (2, 4), L 4:   1 1 . .
                         1 1 1 1
  """
  return jnp.arange(max_length)[None, :] < lengths[:, None]


# --- which latents may look at which: some are known, others are to be generated (docs/papers/cdamd.md#masks) -----
#
# known_mask (B, L): True = a condition, given and real; the others are to be generated (or padding). The drawings have
# 6 positions, known 0, 2 and 4; rows are queries.


def dual_causal_mask(known_mask: Bool[Array, "b l"]) -> Bool[Array, "b 1 l l"]:
  """(B, 1, L, L), DCCM: a known latent sees all known ones, one to be generated sees the past, known or not.

    1 . 1 . 1 .
    1 1 . . . .
    1 . 1 . 1 .
    1 1 1 1 . .
    1 . 1 . 1 .
    1 1 1 1 1 1
  """
  # Parity: equation 11 of the paper, read as an intersection, is the causal mask; this is the code's, in training.
  query, key = known_mask[:, None, :, None], known_mask[:, None, None, :]
  return jnp.where(query, key, block_causal_mask(known_mask.shape[1]))


def known_or_past_mask(known_mask: Bool[Array, "b l"]) -> Bool[Array, "b 1 l l"]:
  """(B, 1, L, L), BAMM's bidirectional causal mask: like DCCM, and one to be generated also sees all known ones.

    1 . 1 . 1 .
    1 1 1 . 1 .
    1 . 1 . 1 .
    1 1 1 1 1 .
    1 . 1 . 1 .
    1 1 1 1 1 1
  """
  return dual_causal_mask(known_mask) | known_mask[:, None, None, :]


LATENT_MASKS = {
    "dccm": dual_causal_mask,
    "causal": lambda known_mask: block_causal_mask(known_mask.shape[1]),
    "bcm": known_or_past_mask,
    "bidirectional": lambda known_mask: block_causal_mask(known_mask.shape[1], 0),
}


def latent_mask(kind: str, known_mask: Bool[Array, "b l"], real_mask: Bool[Array, "b l"]) -> Bool[Array, "b 1 l l"]:
  """(B, 1, L, L): the mask of that name less the keys that are padding, real_mask (B, L) False.

  No row is empty as long as position 0 is real: a real query sees itself, a padded one sees position 0. DCCM with
  position 5 padding:

    1 . 1 . 1 .
    1 1 . . . .
    1 . 1 . 1 .
    1 1 1 1 . .
    1 . 1 . 1 .
    1 1 1 1 1 .
  """
  if kind not in LATENT_MASKS:
    raise ValueError(f"got mask {kind!r}, expected one of {', '.join(LATENT_MASKS)}")
  return LATENT_MASKS[kind](known_mask & real_mask) & real_mask[:, None, None, :]


def with_text(attn_mask: Bool[Array, "#b 1 l k"], text_mask: Bool[Array, "b s"]) -> Bool[Array, "b 1 l s+k"]:
  """(B, 1, L, S + L): columns for words in front, text_mask (B, S), which every query sees; for cross-attention to
  words and one prior token per latent.

  One word, DCCM as above:   1 | 1 . 1 . 1 .
                             1 | 1 1 . . . .
                             1 | 1 . 1 . 1 .
                             1 | 1 1 1 1 . .
                             1 | 1 . 1 . 1 .
                             1 | 1 1 1 1 1 .
  """
  batch, num_words = text_mask.shape
  words = jnp.broadcast_to(text_mask[:, None, None, :], (batch, 1, attn_mask.shape[2], num_words))
  return jnp.concatenate([words, jnp.broadcast_to(attn_mask, (batch,) + attn_mask.shape[1:])], axis=-1)
