"""Random keys of motions from seeds, and values given once for all prompts or once for each."""
import operator
from collections.abc import Iterable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import SEEDS, checked, format_value


def each(value: Any, prompts: Sequence[str]) -> list[Any]:
  """A list with one value per prompt, from a single value or from a sequence of one per prompt."""
  several = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes)
  values = list(value) if several else [value] * len(prompts)
  if len(values) != len(prompts):
    raise InputError(f"got {len(values)} lengths for {len(prompts)} prompts; give one number or one per prompt")
  return values


def random_keys(seeds: Sequence[int]) -> jax.Array:
  """Keys (N,) of seeds as of `jax.random.key`; keys of the default kind are made without compiling anything."""
  config: Any = jax.config
  if config.jax_default_prng_impl != "threefry2x32" or config.jax_enable_x64:
    return jnp.stack([jax.random.key(seed) for seed in seeds])
  data: Any = np.array([[0, seed & 0xffffffff] for seed in seeds], np.uint32)
  return jax.random.wrap_key_data(data, impl="threefry2x32")


def select_keys(keys: jax.Array, rows: Sequence[int]) -> jax.Array:
  """Some of the keys (N,), without compiling anything."""
  chosen: Any = np.asarray(rows, int)
  if not jnp.issubdtype(keys.dtype, jax.dtypes.prng_key):
    return jax.device_put(np.asarray(keys)[chosen])
  data: Any = np.asarray(jax.random.key_data(keys))[chosen]
  return jax.random.wrap_key_data(data, impl=jax.random.key_impl(keys))


def keys_of(rng: jax.Array | None, seeds: Iterable[int] | None, count: int, seed: int | None = None
            ) -> tuple[jax.Array, list[Any]]:
  """(keys (count,), seeds or Nones): from seeds, from seed, seed + 1, ..., or from a key folded with each motion's
  place."""
  if sum(choice is not None for choice in (rng, seeds, seed)) > 1:
    raise InputError("got more than one of rng, seeds and seed; give one of them")
  if seed is not None:
    try:
      seeds = [operator.index(seed) + i for i in range(count)]
    except TypeError:
      raise TypeError(f"got the seed {format_value(seed)}, expected an integer") from None
  if seeds is not None:
    if isinstance(seeds, str | bytes) or not isinstance(seeds, Iterable):
      raise TypeError(f"got {format_value(seeds)} as seeds, expected one integer per motion, as in seeds=[5]")
    seeds = list(seeds)
    for seed in seeds:
      try:
        operator.index(seed)
      except TypeError:
        raise TypeError(f"got the seed {format_value(seed)}, expected an integer") from None
    if len(seeds) != count:
      raise InputError(f"got {len(seeds)} seeds for {count} motions")
    seeds = [checked(seed, -SEEDS[1], SEEDS[1], "seed") for seed in seeds]
    return random_keys(seeds), seeds
  rng = jax.random.key(0) if rng is None else rng
  is_array = isinstance(rng, jax.Array | np.ndarray)
  if not (is_array and (jnp.issubdtype(rng.dtype, jax.dtypes.prng_key) and rng.shape == ()
                        or rng.dtype == np.uint32 and rng.ndim == 1)):
    raise TypeError(f"got {format_value(rng)} as rng, expected a key such as jax.random.key(5)")
  return jax.vmap(lambda i: jax.random.fold_in(rng, i))(jnp.arange(count)), [None] * count
