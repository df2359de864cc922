"""jax.random.normal(jax.random.fold_in(jax.random.key(seed), block)) in numpy, for onnx_stream.py."""
import numpy as np

# Giles, "Approximating the erfinv function", in float32 as XLA computes it: coefficients for w < 5 and beyond.
SMALL = (2.81022636e-08, 3.43273939e-07, -3.5233877e-06, -4.39150654e-06, 0.00021858087, -0.00125372503,
         -0.00417768164, 0.246640727, 1.50140941)
LARGE = (-0.000200214257, 0.000100950558, 0.00134934322, -0.00367342844, 0.00573950773, -0.0076224613, 0.00943887047,
         1.00167406, 2.83297682)


def threefry(key, x, y):
  """The 20 rounds of Threefry-2x32 of counters x, y, uint32: what jax.random is made of."""
  keys = [np.uint32(key[0]), np.uint32(key[1]), np.uint32(key[0]) ^ np.uint32(key[1]) ^ np.uint32(0x1BD11BDA)]
  x, y = x + keys[0], y + keys[1]
  for i in range(5):
    for turn in ((13, 15, 26, 6), (17, 29, 16, 24))[i % 2]:
      x = x + y
      y = x ^ (y << np.uint32(turn) | y >> np.uint32(32 - turn))
    x, y = x + keys[(i + 1) % 3], y + keys[(i + 2) % 3] + np.uint32(i + 1)
  return x, y


def normal(seed, block, shape):
  """Standard normal numbers of a block of a stream, float32."""
  with np.errstate(over="ignore"):
    key = threefry((0, seed & 0xFFFFFFFF), np.uint32([0]), np.uint32([block]))
    count = np.arange(np.prod(shape), dtype=np.uint32)
    first, second = threefry((key[0][0], key[1][0]), 0 * count, count)
  unit = ((first ^ second) >> np.uint32(9) | np.uint32(0x3F800000)).view(np.float32) - np.float32(1)
  low = np.nextafter(np.float32(-1), np.float32(0))
  x = np.maximum(unit * (np.float32(1) - low) + low, low)
  w, value = -np.log1p(-x * x), np.zeros_like(x)
  for a, b in zip(SMALL, LARGE):
    value = value * np.where(w < 5, w - np.float32(2.5), np.sqrt(w) - np.float32(3)) + np.where(w < 5, a, b).astype("f")
  return (np.float32(2 ** 0.5) * value * x).reshape(shape)
