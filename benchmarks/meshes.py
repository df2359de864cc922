"""Memory of a training step on each device of meshes that are not there, computed from shapes and shardings.

  python benchmarks/meshes.py              the table of docs/pods.md#memory
  python benchmarks/meshes.py --lower      also lowers each step for TPUs, which takes minutes

Nothing runs. Parameters and state (parameters, moments of the optimizer, average) follow from the shardings of
`training.mesh`. Activations are what `jax.vjp` keeps for a gradient with `train.remat`, in bfloat16, for the rows of
one device: an upper limit, as XLA fuses some of it, and as the part that the model axis splits is counted whole.
"""
import argparse
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import programs
import results

from motion_jax.models import cdamd, cmdm
from motion_jax.nets import causal_dit, diffusion_mlp, masked_transformer
from motion_jax.nets.partitioning import LAYOUTS
from motion_jax.training import mesh, optimizers, train_step

BATCH = 1024
MESHES = ((1, 1, "replicated"), (64, 1, "fully_sharded"), (16, 4, "fully_sharded"), (256, 1, "fully_sharded"),
          (64, 4, "fully_sharded"))
SIZES = (("denoiser", "XL"), ("denoiser", "1B"), ("denoiser", "3B"), ("generator", "290M"), ("generator", "1B"),
         ("generator", "3B"))
_MEBI = 2 ** 20


class Training(NamedTuple):
  """What is trained: stage, optimizer, shapes of a batch of `BATCH` rows and of the frozen parts."""
  stage: Any
  tx: Any
  decay: float
  batch: dict
  frozen: Any

  def init(self, batch, rng):
    return train_step.init_state(self.stage, self.tx, batch, rng, self.decay > 0)

  def args(self):
    return self.batch, jax.eval_shape(lambda: jax.random.key(0))


def training(network: str, size: str, tiny: bool = False) -> Training:
  """Denoiser or generator of a size; tiny: of the config `:tiny` instead."""
  config = programs.config_of(f"{'cmdm_denoiser' if network == 'denoiser' else 'cdamd_generator'}", tiny)
  with config.unlocked():
    config.train.update(remat=True, dtype="bfloat16")
    if network == "denoiser":
      config.train.scan_layers = True
      config.model.update({} if tiny else causal_dit.size(size))
    elif size != "290M" and not tiny:
      config.model.transformer.update(masked_transformer.size(size))
      config.model.head.update(diffusion_mlp.LARGER_SIZES[size])
    elif not tiny:
      config.model.transformer.update(masked_transformer.size("readme"))
  stage = (cmdm.denoiser_stage if network == "denoiser" else cdamd.generator_stage)(config)
  batch = jax.eval_shape(lambda: programs.batch_of(config, BATCH))
  return Training(stage, optimizers.make_optimizer(config.optimizer, config.train.num_steps),
                  config.optimizer.ema_decay, batch, programs.frozen_of(config))


def on_one_device(shapes: Any, placed: Any) -> int:
  """Bytes of a tree of arrays on one device."""
  return sum(math.prod(sharding.shard_shape(leaf.shape)) * leaf.dtype.itemsize
             for leaf, sharding in zip(jax.tree.leaves(shapes), jax.tree.leaves(placed), strict=True))


def activations(trained: Training) -> float:
  """Bytes for each row of a batch that a gradient keeps: the difference of what it keeps for two rows and for one."""
  params = jax.eval_shape(trained.stage.init, *trained.args())

  def kept(rows):
    batch = {name: jax.ShapeDtypeStruct((rows, *a.shape[1:]), a.dtype) for name, a in trained.batch.items()}
    step, rng = jnp.zeros((), jnp.int32), jax.random.key(0)
    loss = lambda params, frozen, batch: trained.stage.loss(params, frozen, batch, step, rng)[0]["loss"]
    found = jax.eval_shape(lambda params, *args: jax.vjp(lambda params: loss(params, *args), params)[1],
                           params, trained.frozen, batch)
    return sum(math.prod(leaf.shape) * leaf.dtype.itemsize for leaf in jax.tree.leaves(found))

  return kept(2) - kept(1)


def lowered(trained: Training, where: mesh.Mesh, platform: str = "tpu") -> Any:
  """The training step, lowered for the devices of a mesh that need not be there."""
  shapes, placed = where.shapes(trained.init, *trained.args())
  state = jax.tree.map(lambda a, s: jax.ShapeDtypeStruct(a.shape, a.dtype, sharding=s), shapes, placed)
  step = train_step.make_train_step(trained.stage, trained.tx, trained.decay)
  jitted = where.compiled(step)
  return jitted.trace(state, trained.frozen, where.shapes_of_rows(trained.batch), trained.args()[1]).lower(
      lowering_platforms=(platform,))


def rows(sizes=SIZES, meshes=MESHES, lower=False) -> Iterator[list]:
  """The lines of the table."""
  for network, size in sizes:
    trained = training(network, size)
    row_bytes = activations(trained)
    for data, model, layout in meshes:
      where = mesh.Mesh(data, model, LAYOUTS[layout], data * model)
      shapes, placed = where.shapes(trained.init, *trained.args())
      params, state = (on_one_device(*pair) for pair in ((shapes.params, placed.params), (shapes, placed)))
      if lower:
        print(network, size, data, model, len(lowered(trained, where).as_text()), "characters lowered", flush=True)
      count = sum(math.prod(leaf.shape) for leaf in jax.tree.leaves(shapes.params))
      yield [f"{network} {size}", f"{count / 1e6:,.0f} M", f"{data} x {model}", f"{params / _MEBI:,.0f}",
             f"{(state - params) / _MEBI:,.0f}", f"{row_bytes * BATCH / data / _MEBI:,.0f}" if data > 1 else "-"]


def main():
  parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
  parser.add_argument("--lower", action="store_true", help="also lower each step for TPUs")
  args = parser.parse_args()
  columns = ["network", "parameters", "mesh, data x model", "parameters, MiB", "optimizer and average, MiB",
             f"activations of {BATCH} rows, MiB"]
  found = []
  for row in rows(lower=args.lower):
    print(*row, sep=", ", flush=True)
    found.append(row)
  print(results.markdown(columns, found))


if __name__ == "__main__":
  main()
