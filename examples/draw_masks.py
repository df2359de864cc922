"""Draw the attention masks of both papers: rows are queries, columns keys, # may attend."""
import jax.numpy as jnp
import numpy as np

from motion_jax.nets import block_causal_mask, dual_causal_mask, known_or_past_mask, padding_mask, sliding_mask

known = jnp.array([[True, False, True, False, True, False]])
masks = {
    "CMDM, block-causal, blocks of 3": block_causal_mask(6, 3),
    "CMDM, sliding, context 4 of blocks of 2": sliding_mask(6, 2, 4),
    "padding, lengths 4": padding_mask(jnp.array([4]), 6)[:, None, None, :] & block_causal_mask(6),
    "CDAMD, dual-constrained, known 0, 2, 4": dual_causal_mask(known),
    "CDAMD, known or past": known_or_past_mask(known),
}
for name, mask in masks.items():
  print(name)
  for row in np.asarray(mask)[0, 0]:
    print("  " + " ".join("#" if seen else "." for seen in row))
