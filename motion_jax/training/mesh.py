"""How a training step is mapped over devices (docs/pods.md): the rows of a batch are split, states are placed.

`make_mesh` chooses by the section `mesh` of a config. All map the same step:

  Pmap         devices of one process; every device holds the whole state
  Mesh         devices of all processes; the same by jit(shard_map), or with rules a state that is sharded, by jit
"""
import jax
import numpy as np
from jax.sharding import NamedSharding, PartitionSpec

from motion_jax.nets.partitioning import DATA, LAYOUTS, MODEL, axes_of, shardings
from motion_jax.training.compiling import quick_options
from motion_jax.training.stage import DEVICES
from motion_jax.utils.errors import InputError

MAPS = ("auto", "pmap", "shard_map")


def make_mesh(config):
  """`Pmap` or `Mesh` by the section `mesh` of a config: map, layout, rules and the sizes data and model.

  map "auto": `Mesh` with several processes or a layout that shards. data 0: all devices that model leaves.
  """
  if config.map not in MAPS:
    raise InputError(f"got mesh.map {config.map!r}, expected one of {', '.join(MAPS)}")
  if config.layout not in LAYOUTS:
    raise InputError(f"got mesh.layout {config.layout!r}, expected one of {', '.join(LAYOUTS)}; for others give "
                     "mesh.rules")
  rules = tuple((name, axis) for name, axis in config.rules or LAYOUTS[config.layout])
  if wrong_axis := next((axis for _, axis in rules if axis not in (DATA, MODEL)), ""):
    raise InputError(f"got mesh.rules that place an axis on {wrong_axis!r}, expected pairs of a name "
                     f"(motion_jax/nets/partitioning.py) and {DATA!r} or {MODEL!r}")
  if config.model != 1 and not rules:
    raise InputError(f"got mesh.model {config.model} and mesh.layout 'replicated', which shards nothing; expected "
                     "mesh.model 1, or mesh.layout 'tensor' or 'fully_sharded'")
  needed = "several processes" if jax.process_count() > 1 else "a sharded state" if rules else (
      "a part of the devices" if config.data not in (0, jax.device_count()) else "")
  if needed and config.map == "pmap":
    raise InputError(f"got mesh.map 'pmap' with {needed}, which needs a mesh; expected 'auto'")
  return Mesh(config.data, config.model, rules) if needed or config.map == "shard_map" else Pmap()


class Pmap:
  """The devices of this process: rows of a batch are split over them, everything else is replicated."""

  def __init__(self):
    self.num_devices = jax.local_device_count()
    self._copy = jax.pmap(lambda tree, _: tree, DEVICES, in_axes=(None, 0), out_axes=None)

  def init(self, init, *args):
    """The result of a pure function, as `put` places it."""
    return self.put(jax.jit(init, compiler_options=quick_options())(*args))

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
  """The devices of all processes, data x model; each process holds the rows of a batch that its own devices take.

  Rows are split over data. rules: how the state that `init` makes is sharded (`nets.partitioning`); parameters,
  optimizer state and average alike, so that no device holds a whole one at any time. Without rules all hold it.
  """

  def __init__(self, data=0, model=1, rules=(), num_devices=0):
    """num_devices: of a machine that is not there, for which `compiled` can be lowered, and `init` not be run."""
    count = num_devices or jax.device_count()
    if model < 1 or count % model or data and data * model != count:
      fits = max(size for size in range(1, max(model, 1) + 1) if count % size == 0)
      raise InputError(f"got mesh.data {data} and mesh.model {model} on {count} devices, expected a product of {count} "
                       f"or mesh.data 0, which takes all that mesh.model leaves; try mesh.data 0, mesh.model {fits}")
    self._data, names = count // model, (DATA if rules else DEVICES, MODEL)
    self.rules, self._shardings = rules, None
    if num_devices:
      self.mesh = jax.sharding.AbstractMesh((self._data, model), names)
    else:
      devices = sorted(jax.devices(), key=lambda device: (device.process_index, device.id))  # as `rows` splits
      self.mesh = jax.sharding.Mesh(np.array(devices).reshape(-1, model), names)
      places = [place for place, device in enumerate(devices) if device.process_index == jax.process_index()]
      self._first, self._last = places[0] // model, places[-1] // model  # of the data axis, in this process
    self._everywhere = NamedSharding(self.mesh, PartitionSpec())
    self._by_rows = NamedSharding(self.mesh, PartitionSpec(self.mesh.axis_names[0]))

  def init(self, init, *args):
    """The result of a pure function, computed as it is sharded; every process passes the same arguments."""
    return jax.jit(init, out_shardings=self.shapes(init, *args)[1], compiler_options=quick_options())(*args)

  def shapes(self, init, *args):
    """(shapes, shardings) of what `init` gives."""
    shapes = jax.eval_shape(init, *args)
    if self.rules:
      self._shardings = shardings(axes_of(init, *args), shapes, self.mesh, self.rules)
    else:
      self._shardings = jax.tree.map(lambda _: self._everywhere, shapes)
    return shapes, self._shardings

  def shapes_of_rows(self, batch):
    """Shapes and shardings of a batch, as `rows` places it."""
    return jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape, a.dtype, sharding=self._by_rows), batch)

  def put(self, tree):
    """See `Pmap.put`; a state as `init` sharded it. Every process passes the same arrays."""
    def place(array, sharding):
      if jax.process_count() == 1 or isinstance(array, jax.Array) and not array.is_fully_addressable:
        return jax.device_put(array, sharding)
      array = np.asarray(array)
      return jax.make_array_from_callback(array.shape, sharding, lambda index: array[index])

    sharded = self._shardings is not None and jax.tree.structure(tree) == jax.tree.structure(self._shardings)
    return jax.tree.map(place, tree, self._shardings if sharded else jax.tree.map(lambda _: self._everywhere, tree))

  def own_rows(self, batch_size):
    """The rows of a batch that the devices of this process take."""
    size = rows_per_device(batch_size, self._data)
    return slice(self._first * size, (self._last + 1) * size)

  def rows(self, batch):
    """A batch on all devices, from this process's rows of it, arrays (B / processes, ...)."""
    size = rows_per_device(len(batch["index"]), self._last + 1 - self._first)
    first, total = self._first * size, self._data * size

    def place(array):
      def part(index):
        start, stop, _ = index[0].indices(total)
        return array[start - first:stop - first]

      return jax.make_array_from_callback((total, *array.shape[1:]), self._by_rows, part)

    return {k: place(np.asarray(v)) for k, v in batch.items()}

  def compiled(self, train_step):
    """See `Pmap.compiled`."""
    if not self.rules:  # the step itself sums over the devices, and its results are the same on all
      everywhere, by_rows = PartitionSpec(), PartitionSpec(DEVICES)
      step = jax.shard_map(train_step.__call__, mesh=self.mesh, check_vma=False, out_specs=everywhere,
                           in_specs=(everywhere, everywhere, by_rows, everywhere))
      return jax.jit(step, donate_argnums=0)
    # To the step, the mesh is one device with all rows: XLA splits its arithmetic as state and rows are sharded.
    on_one = jax.vmap(train_step.gradients, (None, None, 0, None), axis_name=DEVICES, axis_size=1)

    def step(state, frozen, batch, rng):
      seen = state.replace(opt_state=None, ema_params=None)
      grads, metrics, extra = jax.tree.map(lambda a: a[0], on_one(
          seen, frozen, jax.tree.map(lambda a: a[None], batch), rng))
      grads = jax.lax.with_sharding_constraint(grads, self._shardings.params)
      return train_step.update(state, grads, metrics, extra)

    return jax.jit(step, donate_argnums=0, out_shardings=(self._shardings, self._everywhere))


def rows_per_device(size, num_devices):
  """Number of rows of a batch for each device; raises ValueError where they cannot be split evenly."""
  if size % num_devices:
    raise ValueError(f"got batches of {size} on {num_devices} devices; data.batch_size must be a multiple of them")
  return size // num_devices
