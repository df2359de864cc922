"""Shapes of arrays: in annotations, which tests check, and at the doors of functions whose mistakes would stay unseen.

Annotations name dimensions, `x: Float[Array, "b l c"]`: b batch, t frames, l latents, j joints, f features, d width,
c latent channels, h heads, k channels of a head or codes, s tokens, q levels, n steps; *lead is any number of them, #b
is b or 1. Within one call a letter is one length. Only tests have them checked (`tests/conftest.py`), no user pays.
All rooms take `Bool`, `Float`, `Int`, `Key` and `Num` from here, so that jaxtyping is imported in tests alone.
"""
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

Whole = int | np.integer
Net = Any  # a flax module, where it is applied: flax does not say what that gives
if TYPE_CHECKING or "jaxtyping" in sys.modules:  # a test, or a program that has them checked
  from jaxtyping import Bool as Bool
  from jaxtyping import Float as Float
  from jaxtyping import Int as Int
  from jaxtyping import Key as Key
  from jaxtyping import Num as Num
else:

  class _Unchecked:
    """Stands for `Float[Array, "b t"]` and the like where annotations are not read."""

    def __class_getitem__(cls, _: Any) -> Any:
      return Any

  Bool = Float = Int = Key = Num = _Unchecked
# Of annotations; numpy's arrays are welcome wherever JAX's are. What runs needs only their shapes and types, no JAX.
if TYPE_CHECKING:
  import jax
  Array = jax.Array | np.ndarray
else:
  Array = Any
# Shapes that signatures repeat.
Latents = Float[Array, "b l c"]
AttentionMask = Bool[Array, "#b 1 l l"]  # true: the row's place attends to the column's


def check(**arrays: Any) -> None:
  """Raises ValueError unless arrays have the shapes that letters name: check(x=(x, "BLC"), t=(t, "BL")).

  A letter is one length wherever it stands; the first array that has it says which. Costs nothing once compiled.
  """
  lengths: dict[str, int] = {}
  for name, (array, letters) in arrays.items():
    shape = array.shape
    if len(shape) != len(letters) or any(lengths.get(letter, count) != count for letter, count in zip(letters, shape)):
      known = "".join(f", {letter} = {lengths[letter]}" for letter in letters if letter in lengths)
      raise ValueError(f"got {name} of shape {shape}, expected ({', '.join(letters)}){known}; the arrays of a call "
                       "belong together")
    lengths |= zip(letters, shape)
