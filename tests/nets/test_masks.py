"""Masks are the drawings in their docstrings."""
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.nets.masks import block_causal_mask, padding_mask, sliding_mask


def draw(mask):
  return "\n".join("".join("1" if value else "." for value in row) for row in np.asarray(mask))


def drawn(text):
  return "\n".join(text.split())


def test_block_causal():
  mask = block_causal_mask(4, 1)
  assert mask.shape == (1, 1, 4, 4) and mask.dtype == bool
  assert draw(mask[0, 0]) == drawn("1... 11.. 111. 1111")
  assert draw(block_causal_mask(6, 3)[0, 0]) == drawn("111... 111... 111... 111111 111111 111111")
  # A length off the block ends in a partial block, which sees only what exists.
  assert draw(block_causal_mask(5, 3)[0, 0]) == drawn("111.. 111.. 111.. 11111 11111")
  assert bool(block_causal_mask(5, 0).all()) and bool(block_causal_mask(5, None).all())


def test_sliding():
  assert draw(sliding_mask(6, 1, 3)[0, 0]) == drawn("1..... 11.... 111... .111.. ..111. ...111")
  assert draw(sliding_mask(6, 2, 4)[0, 0]) == drawn("11.... 11.... 1111.. 1111.. ..1111 ..1111")
  assert bool((sliding_mask(12, 3, 12) == block_causal_mask(12, 3)).all())
  with pytest.raises(ValueError, match="whole blocks of 3"):
    sliding_mask(12, 3, 10)


def test_padding():
  assert draw(padding_mask(jnp.array([2, 4, 0]), 4)) == drawn("11.. 1111 ....")
  both = block_causal_mask(4, 1) & padding_mask(jnp.array([2, 4]), 4)[:, None, None, :]
  assert both.shape == (2, 1, 4, 4)
  assert draw(both[0, 0]) == drawn("1... 11.. 11.. 11..")
