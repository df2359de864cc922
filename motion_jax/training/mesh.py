"""Where a training step runs: over the devices of one process by `jax.pmap`, or over those of all by a mesh.

Both are two ways to map the same pure `train_step`: each device is given its rows of the batch, and the sums over
devices inside the step, over the axis `stage.DEVICES`, make them agree.
"""
import jax
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

from motion_jax.training.stage import DEVICES
from motion_jax.training.train_step import TrainState

MAPS = ("auto", "pmap", "shard_map")
LEAST_SHARDED = 1024  # numbers of an array; of a smaller one every device keeps all


def make_mesh(config):
  """`Pmap` or `Mesh` as the section `mesh` of a config says; "auto": the first, or the second where processes are
  several or the state is sharded."""
  if config.map not in MAPS:
    raise ValueError(f"got mesh.map {config.map!r}, expected one of {', '.join(MAPS)}")
  needed = jax.process_count() > 1 or config.shard_state
  if needed and config.map == "pmap":
    raise ValueError(f"got mesh.map 'pmap' in a run of {jax.process_count()} processes, mesh.shard_state "
                     f"{config.shard_state}; expected 'shard_map' or 'auto'")
  return Mesh(config.shard_state) if needed or config.map == "shard_map" else Pmap()


class Pmap:
  """The devices of this process: what is not cut by rows lies on each of them."""

  def __init__(self):
    self.num_devices = jax.local_device_count()
    self._copy = jax.pmap(lambda tree, _: tree, DEVICES, in_axes=(None, 0), out_axes=None)

  def put(self, tree):
    """Arrays to every device, as the step takes and gives them: so it is compiled once, and copies nothing."""
    return self._copy(tree, np.zeros(self.num_devices))

  def rows(self, batch):
    """Arrays (B, ...) of a batch, to be cut over the devices: (num_devices, B / num_devices, ...)."""
    size = rows_per_device(len(batch["index"]), self.num_devices)
    return {k: np.reshape(v, (self.num_devices, size) + np.shape(v)[1:]) for k, v in batch.items()}

  def compiled(self, train_step):
    """A pure step of `train_step.make_train_step`, over all devices; its first argument is used up."""
    return jax.pmap(train_step.__call__, DEVICES, in_axes=(None, None, 0, None), out_axes=None, donate_argnums=0)


class Mesh:
  """The devices of all processes, each of which holds those rows of a batch that its own devices take.

  shard_state: parameters, optimizer's state and average are cut over the devices, each array along the longest of its
  axes that they divide. Parameters are put together for a step, the rest never is.
  """

  def __init__(self, shard_state=False):
    self.shard_state = shard_state
    devices = sorted(jax.devices(), key=lambda device: (device.process_index, device.id))  # as `rows` cuts
    self.mesh = jax.sharding.Mesh(np.array(devices), (DEVICES,))
    self.num_devices = self.mesh.size
    self._everywhere, self._by_rows = (NamedSharding(self.mesh, spec)
                                       for spec in (PartitionSpec(), PartitionSpec(DEVICES)))

  def put(self, tree):
    """See `Pmap.put`; every process gives the same arrays."""
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
    """Which rows of a batch the devices of this process take."""
    size = rows_per_device(batch_size, self.num_devices) * jax.local_device_count()
    return slice(jax.process_index() * size, (jax.process_index() + 1) * size)

  def rows(self, batch):
    """A batch over all devices, of this process's rows of it, arrays (B / processes, ...)."""
    rows_per_device(len(batch["index"]), jax.local_device_count())
    return {k: jax.make_array_from_process_local_data(self._by_rows, np.asarray(v)) for k, v in batch.items()}

  def compiled(self, train_step):
    """See `Pmap.compiled`."""
    everywhere, by_rows = PartitionSpec(), PartitionSpec(DEVICES)
    # The step says itself what it sums over the devices, and what comes out of it is the same on all.
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
  """How many rows of a batch each device takes; raises ValueError where they do not share them out evenly."""
  if size % num_devices:
    raise ValueError(f"got batches of {size} on {num_devices} devices; data.batch_size must be a multiple of them")
  return size // num_devices
