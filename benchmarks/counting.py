"""Work of a program, counted from its jaxpr: matrix products and convolutions, their operands, how many there are.

XLA's own count (`lowered.cost_analysis()`) takes the body of a loop once; this one takes it as often as it runs. What
lies between the products (norms, activations, softmax, rotations) is left out: a compiler fuses it into them, so times
that follow from these counts are lower limits.
"""
import collections
import math
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import numpy as np

COLLECTIVES = ("all_reduce", "all_gather", "reduce_scatter", "collective_permute", "all_to_all")


class Product(NamedTuple):
  """One matrix product or convolution: floating-point operations, bytes of operands and result, their type."""
  flops: float
  bytes: float
  dtype: str


class Work(NamedTuple):
  """products: {Product: how often it runs}; state_bytes: of arrays that a call takes and gives back, such as parameters
  and moments of an optimizer."""
  products: dict[Product, int]
  state_bytes: float = 0.0

  @property
  def flops(self) -> float:
    return sum(product.flops * count for product, count in self.products.items())

  @property
  def bytes(self) -> float:
    return sum(product.bytes * count for product, count in self.products.items()) + self.state_bytes

  @property
  def count(self) -> int:
    return sum(self.products.values())


def work(function, *shapes, carried=False, loops=None) -> Work:
  """The Work of function(*shapes), arrays or shapes; carried: its first argument is a state that it gives back.

  loops: how often loops run whose number of iterations depends on data; without it such a loop is a ValueError.
  """
  state = sum(size_of(leaf) for leaf in jax.tree.leaves(shapes[0])) if carried else 0.0
  # The new state is written once, the old one read once.
  return Work(dict(collections.Counter(_totals(jax.make_jaxpr(function)(*shapes).jaxpr, loops))), 2 * state)


def collectives(program: str) -> dict[str, int]:
  """{operation: how often the text of a lowered program has it}, those of loops once."""
  found = {name: len(re.findall(rf"\bstablehlo\.{name}\b", program)) for name in COLLECTIVES}
  return {name: count for name, count in found.items() if count}


def transfers(program: str) -> dict[str, tuple[int, int]]:
  """{operation: (how often, bytes of its results on one device)} of the text of a compiled program, loops once.

  Where a lowered program is sharded by jit, it has no collectives yet: XLA's partitioner adds them.
  """
  found: dict[str, tuple[int, int]] = {}
  for line in program.splitlines():
    if call := _CALL.search(line):
      count, size = found.get(call[2], (0, 0))
      found[call[2]] = count + 1, size + sum(
          math.prod(map(int, filter(None, dims.split(",")))) * int(bits or 8) // 8
          for bits, dims in _ARRAY.findall(call[1]))
  return found


_CALL = re.compile(rf"= (.*?) ({'|'.join(name.replace('_', '-') for name in COLLECTIVES)})(?:-start)?\(")
_ARRAY = re.compile(r"\b(?:pred|[a-z]+?)(\d*)\[([\d,]*)\]")


def size_of(leaf) -> float:
  """Bytes of an array or shape; a random key is 8."""
  itemsize = 8 if jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key) else np.dtype(leaf.dtype).itemsize
  return float(np.prod(leaf.shape)) * itemsize


def _totals(jaxpr, loops) -> dict[Product, int]:
  total: collections.Counter = collections.Counter()
  for eqn in jaxpr.eqns:
    if eqn.primitive.name in _FLOPS:
      operands = [var.aval for var in (*eqn.invars[:2], *eqn.outvars[:1])]
      total[Product(_FLOPS[eqn.primitive.name](eqn), sum(map(size_of, operands)), str(operands[0].dtype))] += 1
      continue
    inner = [_totals(one, loops) for one in _jaxprs(eqn.params)]
    if eqn.primitive.name == "cond":  # one of several: the one with most to do
      inner = [max(inner, key=lambda one: Work(one).flops)]
    times = eqn.params["length"] if eqn.primitive.name == "scan" else 1
    if eqn.primitive.name == "while" and any(inner):
      if loops is None:
        raise ValueError("got a while loop with matrix products, whose iterations depend on data; pass loops")
      times = loops
    for one in inner:
      for product, count in one.items():
        total[product] += count * times
  return total


def _jaxprs(value: Any) -> Iterator[Any]:
  """All programs among the parameters of an operation."""
  if hasattr(value, "eqns"):
    yield value
  elif hasattr(value, "jaxpr"):
    yield from _jaxprs(value.jaxpr)
  elif isinstance(value, dict):
    for one in value.values():
      yield from _jaxprs(one)
  elif isinstance(value, (tuple, list)):
    for one in value:
      yield from _jaxprs(one)


def _dot_flops(eqn):
  (contracted, _), _ = eqn.params["dimension_numbers"]
  inner = np.prod([eqn.invars[0].aval.shape[axis] for axis in contracted])
  return 2.0 * float(np.prod(eqn.outvars[0].aval.shape)) * float(inner)


def _conv_flops(eqn):
  """Twice the kernel for each number of the result, zeros that stand between dilated inputs left out."""
  kernel, spec = eqn.invars[1].aval.shape, eqn.params["dimension_numbers"].rhs_spec
  taps = float(np.prod(kernel)) / kernel[spec[0]]
  dilated = float(np.prod(eqn.params["lhs_dilation"]))
  return 2.0 * float(np.prod(eqn.outvars[0].aval.shape)) * taps / dilated


_FLOPS = {"dot_general": _dot_flops, "conv_general_dilated": _conv_flops}
