"""How a training step is mapped over devices (docs/pods.md): the rows of a batch are split, states are placed.

`make_mesh` chooses by the section `mesh` of a config.
"""
import jax
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

from motion_jax.training.stage import DEVICES
from motion_jax.training.train_step import TrainState

MAPS = ("auto", "pmap", "shard_map")
LEAST_SHARDED = 1024  # smaller arrays are not sharded


def make_mesh(config):
  """`Pmap` or `Mesh` by the section `mesh` of a config; "auto": a mesh with several processes or a sharded state."""
  if config.map not in MAPS:
    raise ValueError(f"got mesh.map {config.map!r}, expected one of {', '.join(MAPS)}")
  needed = jax.process_count() > 1 or config.shard_state
  if needed and config.map == "pmap":
    raise ValueError(f"got mesh.map 'pmap' in a run of {jax.process_count()} processes, mesh.shard_state "
                     f"{config.shard_state}; expected 'shard_map' or 'auto'")
  return Mesh(config.shard_state) if needed or config.map == "shard_map" else Pmap()


class Pmap:
  """The devices of this process: rows of a batch are split over them, everything else is replicated."""

  def __init__(self):
    self.num_devices = jax.local_device_count()
    self._copy = jax.pmap(lambda tree, _: tree, DEVICES, in_axes=(None, 0), out_axes=None)

  def put(self, tree):
    """Arrays on every device, as the step takes and returns them, so that it is compiled once and copies nothing."""
    return self._copy(tree, np.zeros(self.num_devices))

  def rows(self, batch):
    """Arrays (B, ...) of a batch, split over the devices: (num_devices, B / num_devices, ...)."""
    size = rows_per_device(len(batch["index"]), self.num_devices)
    return {k: np.reshape(v, (self.num_devices, size) + np.shape(v)[1:]) for k, v in batch.items()}

  def compiled(self, train_step):
    """A pure step of `make_train_step` on all devices; its first argument is donated."""
    return jax.pmap(train_step.__call__, DEVICES, in_axes=(None, None, 0, None), out_axes=None, donate_argnums=0)


class Mesh:
  """The devices of all processes; each process holds the rows of a batch that its own devices take.

  shard_state: parameters, optimizer state and average are sharded over the devices, each array along its longest axis
  that the number of devices divides. Parameters are gathered for a step, the rest never is.
  """

  def __init__(self, shard_state=False):
    self.shard_state = shard_state
    devices = sorted(jax.devices(), key=lambda device: (device.process_index, device.id))  # as `rows` splits
    self.mesh = jax.sharding.Mesh(np.array(devices), (DEVICES,))
    self.num_devices = self.mesh.size
    self._everywhere, self._by_rows = (NamedSharding(self.mesh, spec)
                                       for spec in (PartitionSpec(), PartitionSpec(DEVICES)))

  def put(self, tree):
    """See `Pmap.put`; every process passes the same arrays."""
    def place(array):
      sharding = self._sharding(np.shape(array)) if isinstance(tree, TrainState) else self._everywhere
      if jax.process_count() == 1 or isinstance(array, jax.Array) and not array.is_fully_addressable:
        return jax.device_put(array, sharding)
      array = np.asarray(array)
      return jax.make_array_from_callback(array.shape, sharding, lambda index: array[index])

    return jax.tree.map(place, tree)

  def _sharding(self, shape):
    axes = [axis for axis, size in enumerate(shape) if size % self.num_devices == 0]
    if not self.shard_state or not axes or np.prod(shape) < LEAST_SHARDED:
      return self._everywhere
    longest = max(axes, key=lambda axis: shape[axis])
    return NamedSharding(self.mesh, PartitionSpec(*[None] * longest, DEVICES))

  def own_rows(self, batch_size):
    """The rows of a batch that the devices of this process take."""
    size = rows_per_device(batch_size, self.num_devices) * jax.local_device_count()
    return slice(jax.process_index() * size, (jax.process_index() + 1) * size)

  def rows(self, batch):
    """A batch on all devices, from this process's rows of it, arrays (B / processes, ...)."""
    rows_per_device(len(batch["index"]), jax.local_device_count())
    return {k: jax.make_array_from_process_local_data(self._by_rows, np.asarray(v)) for k, v in batch.items()}

  def compiled(self, train_step):
    """See `Pmap.compiled`."""
    everywhere, by_rows = PartitionSpec(), PartitionSpec(DEVICES)
    # The step itself sums over the devices, and its results are the same on all.
    mapped = lambda step: jax.shard_map(step, mesh=self.mesh, in_specs=(everywhere, everywhere, by_rows, everywhere),
                                        out_specs=everywhere, check_vma=False)
    if not self.shard_state:
      return jax.jit(mapped(train_step.__call__), donate_argnums=0)

    def step(state, frozen, batch, rng):
      seen = state.replace(opt_state=None, ema_params=None)
      new, metrics = train_step.update(state, *mapped(train_step.gradients)(seen, frozen, batch, rng))
      return jax.tree.map(lambda a: jax.lax.with_sharding_constraint(a, self._sharding(a.shape)), new), metrics

    return jax.jit(step, donate_argnums=0)


def rows_per_device(size, num_devices):
  """Number of rows of a batch for each device; raises ValueError where they cannot be split evenly."""
  if size % num_devices:
    raise ValueError(f"got batches of {size} on {num_devices} devices; data.batch_size must be a multiple of them")
  return size // num_devices
