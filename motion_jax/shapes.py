"""Shapes of arrays at the doors of pure functions: wrong ones would broadcast and give a number that means nothing."""
import chex


def check(**arrays):
  """Raises ValueError unless arrays have the shapes that letters name: check(x=(x, "BLC"), t=(t, "BL")).

  A letter is one length wherever it stands; the first array that has it says which. Costs nothing once compiled.
  """
  lengths = {}
  for name, (array, letters) in arrays.items():
    shape = array.shape
    try:
      chex.assert_shape(array, tuple(lengths.get(letter) for letter in letters))  # None is any length
    except AssertionError as error:
      known = "".join(f", {letter} = {lengths[letter]}" for letter in letters if letter in lengths)
      raise ValueError(f"got {name} of shape {shape}, expected ({', '.join(letters)}){known}; the arrays of a call "
                       "belong together") from error
    lengths |= zip(letters, shape)
