"""Masks are the drawings in their docstrings, and those of CDAMD the reference's."""
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.nets.masks import (
  LATENT_MASKS,
  block_causal_mask,
  latent_mask,
  padding_mask,
  sliding_mask,
  two_way_mask,
  with_text,
)
from tests import fixtures
from tests.golden import check, golden


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


def test_two_way():
  """Active latents see one another in both directions; no one sees padding or what the mask keeps apart."""
  active = jnp.array([[0, 0, 1, 1, 1, 0]], bool)
  causal = block_causal_mask(6, 1)
  assert draw(two_way_mask(causal, active)[0, 0]) == drawn("1..... 11.... 11111. 11111. 11111. 111111")
  real = padding_mask(jnp.array([4]), 6)[:, None, None, :]
  assert draw(two_way_mask(causal & real, active)[0, 0]) == drawn("1..... 11.... 1111.. 1111.. 1111.. 1111..")
  apart = causal & (jnp.arange(6)[:, None] < 4) | jnp.eye(6, dtype=bool)  # latents 4 and 5 see themselves alone
  assert draw(two_way_mask(apart, active)[0, 0]) == drawn("1..... 11.... 1111.. 1111.. ....1. .....1")
  # Of two cached latents and the blocks behind them, only the latter change.
  cached = jnp.concatenate([jnp.ones((1, 1, 4, 2), bool), block_causal_mask(4, 2)], axis=-1)
  assert draw(two_way_mask(cached, jnp.array([[0, 1, 1, 0]], bool))[0, 0]) == drawn("1111.. 11111. 111111 111111")
  assert bool((two_way_mask(cached, jnp.zeros((1, 4), bool)) == cached).all())


def test_padding():
  assert draw(padding_mask(jnp.array([2, 4, 0]), 4)) == drawn("11.. 1111 ....")


# --- CDAMD -------------------------------------------------------------------------------------------------------


@golden("masks", bounds={"": (0, 0)})
def run_masks(fixture, dtype):
  made = {}
  for case in sorted({name.split("/")[0] for name in fixture.under("in/")}):
    masked, lengths = fixture[f"in/{case}/masked"], fixture[f"in/{case}/lengths"]
    length, word = masked.shape[1], jnp.ones((len(masked), 1), bool)
    real = padding_mask(jnp.asarray(lengths), length)
    known = real & ~masked
    made[f"{case}/condition"] = known
    for kind, build in LATENT_MASKS.items():
      for suffix, mask in (("", jnp.broadcast_to(build(known), (len(masked), 1, length, length))),
                           ("_padded", latent_mask(kind, known, real))):
        made[f"{case}/self_{kind}{suffix}"] = mask[:, 0]
        made[f"{case}/cross_{kind}{suffix}"] = with_text(mask, word)[:, 0]
  return made


def test_golden():
  assert not check(fixtures.path("cdamd/masks.npz")).failures


KNOWN, REAL = jnp.array([[1, 0, 1, 0, 1, 0]], bool), jnp.array([[1, 1, 1, 1, 1, 0]], bool)


def test_cdamd_masks():
  """The example of docs/papers/cdamd.md#masks: known 0, 2 and 4, to be generated 1 and 3, padding 5."""
  for kind, drawing in (("dccm", "1.1.1. 11.... 1.1.1. 1111.. 1.1.1. 11111."), ("causal", "1..... 11.... 111... 1111.. "
                        "11111. 11111."), ("bcm", "1.1.1. 111.1. 1.1.1. 11111. 1.1.1. 11111."),
                        ("bidirectional", " ".join(["11111."] * 6))):
    mask = latent_mask(kind, KNOWN, REAL)
    assert mask.dtype == bool and draw(jnp.broadcast_to(mask, (1, 1, 6, 6))[0, 0]) == drawn(drawing), kind
  words = with_text(latent_mask("dccm", KNOWN, REAL), jnp.array([[1, 1, 1, 0]], bool))
  assert draw(words[0, 0]) == drawn("111.1.1.1. 111.11.... 111.1.1.1. 111.1111.. 111.1.1.1. 111.11111.")
  with pytest.raises(ValueError, match="'dcm'.*dccm, causal, bcm, bidirectional"):
    latent_mask("dcm", KNOWN, REAL)
