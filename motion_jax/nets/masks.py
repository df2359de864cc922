"""Attention masks as explicit boolean arrays: True = may attend."""
import jax.numpy as jnp


def block_causal_mask(length, block=1):
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


def sliding_mask(length, block, context):
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


def padding_mask(lengths, max_length):
  """(B, L): True where position < lengths (B,).

  lengths (2, 4), L 4:   1 1 . .
                         1 1 1 1
  """
  return jnp.arange(max_length)[None, :] < lengths[:, None]
