"""Drawings: a cell is filled where the mask is true, as full as a latent is clean; a network's shapes are its own."""
import re
import xml.etree.ElementTree as ElementTree

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import draw
from motion_jax.diffusion import staircase
from motion_jax.nets import CausalVAE, block_causal_mask


def _filled(drawing, shape):
  """(rows, columns): the opacity of each cell, read from the rectangles."""
  rects = [one.attrib for one in ElementTree.fromstring(drawing).iter() if one.tag.endswith("rect")]
  frame = next(one for one in rects if one["class"] == "paper")
  left, top = float(frame["x"]), float(frame["y"])
  wide, high = float(frame["width"]) / shape[1], float(frame["height"]) / shape[0]
  cells = np.zeros(shape)
  for one in (rect for rect in rects if rect["class"] == "cell"):
    first, count = round((float(one["x"]) - left) / wide), round(float(one["width"]) / wide)
    cells[round((float(one["y"]) - top) / high), first:first + count] = float(one.get("opacity", 1))
  return cells


def test_masks_and_schedules_are_drawn_cell_by_cell():
  mask, times = block_causal_mask(6, 3), staircase(num_steps=5, length=8, lag=2, block=2)
  np.testing.assert_array_equal(_filled(draw.mask(mask), (6, 6)), mask[0, 0])
  np.testing.assert_allclose(_filled(draw.schedule(times), times.shape), times, atol=0.006)
  across, down = [one for one in ElementTree.fromstring(draw.mask(np.ones((2, 3)))).iter() if one.tag.endswith("text")]
  assert (across.text, down.text) == ("key 0 to 2", "query 0 to 1") and "rotate" in down.get("transform")


def test_large_tables_stay_small():
  drawing = draw.schedule(staircase(num_steps=50, length=400, lag=2, block=4))
  assert float(ElementTree.fromstring(drawing).get("width")) < 700


def test_a_network_is_drawn_with_its_own_shapes():
  vae = CausalVAE(features=6, latent_dim=4, width=8, dilations=(1,))
  x, noise = jax.ShapeDtypeStruct((1, 16, 6), jnp.float32), jax.ShapeDtypeStruct((1, 4, 4), jnp.float32)
  drawing = draw.network(vae, x, noise, title="A <small> one")
  texts = ["".join(one.itertext()) for one in ElementTree.fromstring(drawing).iter() if one.tag.endswith("text")]
  count = sum(leaf.size for leaf in jax.tree.leaves(jax.eval_shape(vae.init, jax.random.key(0), x, noise)))
  assert texts[0] == f"A <small> one, {count / 1e3:.1f} k parameters"
  assert any("(1, 16, 6) → (1, 4, 8)" in text for text in texts) and any("decoder: Decoder" in text for text in texts)


def test_what_cannot_be_drawn_is_refused():
  with pytest.raises(ValueError, match=r"got shape \(2, 3, 3\), expected a mask .*mask\[:1\]"):
    draw.mask(np.ones((2, 3, 3), bool))
  with pytest.raises(ValueError, match="got a mask with the value 0.5, expected booleans"):
    draw.mask([[0.5]])
  with pytest.raises(ValueError, match="got times from 0 to 5, expected 0 .noise. to 1 .clean."):
    draw.schedule([[0, 5]])


def test_a_drawing_is_saved_as_svg_alone(tmp_path):
  drawing = draw.mask([[True]])
  assert ElementTree.parse(drawing.save(tmp_path / "mask.svg")) and drawing._repr_svg_().startswith("<svg")
  with pytest.raises(ValueError, match=re.escape("got 'mask.png', expected a name that ends in .svg")):
    drawing.save(tmp_path / "mask.png")
