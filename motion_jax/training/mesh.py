"""Where a training step runs: over the devices of one process by `jax.pmap`, or over those of all by a mesh.

Both are two ways to map the same pure `train_step`: each device is given its rows of the batch, and the sums over
devices inside the step, over the axis `stage.DEVICES`, make them agree.
"""
import jax
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

from motion_jax.training.stage import DEVICES

MAPS = ("auto", "pmap", "shard_map")


def make_mesh(config):
  """`Pmap` or `Mesh` as the section `mesh` of a config says; "auto": the first, or the second where processes are
  several."""
  if config.map not in MAPS:
    raise ValueError(f"got mesh.map {config.map!r}, expected one of {', '.join(MAPS)}")
  several = jax.process_count() > 1
  if several and config.map == "pmap":
    raise ValueError(f"got mesh.map 'pmap' in a run of {jax.process_count()} processes, expected 'shard_map' or 'auto'")
  return Mesh() if several or config.map == "shard_map" else Pmap()


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
    size = rows_per_device(batch, self.num_devices)
    return {k: np.reshape(v, (self.num_devices, size) + np.shape(v)[1:]) for k, v in batch.items()}

  def compiled(self, train_step):
    """A pure step of `train_step.make_train_step`, over all devices; its first argument is used up."""
    return jax.pmap(train_step, DEVICES, in_axes=(None, None, 0, None), out_axes=None, donate_argnums=0)


class Mesh:
  """The devices of all processes, each of which holds those rows of a batch that its own devices take."""

  def __init__(self):
    self.mesh = jax.sharding.Mesh(np.array(jax.devices()), (DEVICES,))
    self.num_devices = self.mesh.size
    self._everywhere, self._by_rows = (NamedSharding(self.mesh, spec)
                                       for spec in (PartitionSpec(), PartitionSpec(DEVICES)))

  def put(self, tree):
    """See `Pmap.put`; every process gives the same arrays."""
    return jax.tree.map(lambda a: jax.device_put(a, self._everywhere), tree)

  def rows(self, batch):
    """Arrays (B, ...) of a batch, of which each process keeps its own rows."""
    size = rows_per_device(batch, self.num_devices) * jax.local_device_count()
    mine = slice(jax.process_index() * size, (jax.process_index() + 1) * size)
    return {k: jax.make_array_from_process_local_data(self._by_rows, np.asarray(v)[mine]) for k, v in batch.items()}

  def compiled(self, train_step):
    """See `Pmap.compiled`."""
    everywhere, by_rows = PartitionSpec(), PartitionSpec(DEVICES)
    # The step says itself what it sums over the devices, and what comes out of it is the same on all.
    mapped = jax.shard_map(train_step, mesh=self.mesh, in_specs=(everywhere, everywhere, by_rows, everywhere),
                           out_specs=everywhere, check_vma=False)
    return jax.jit(mapped, donate_argnums=0)


def rows_per_device(batch, num_devices):
  """How many rows of a batch each device takes; raises ValueError where they do not share them out evenly."""
  size = len(batch["index"])
  if size % num_devices:
    raise ValueError(f"got batches of {size} on {num_devices} devices; data.batch_size must be a multiple of them")
  return size // num_devices
