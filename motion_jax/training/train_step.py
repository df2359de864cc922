"""One pure training step around any Stage, and the state that it changes."""
from typing import Any

import flax
import jax
import jax.numpy as jnp
import numpy as np
import optax

from motion_jax.training.stage import DEVICES


@flax.struct.dataclass
class TrainState:
  """All that changes while training, and with it all that a resumed run needs."""
  step: jax.Array
  params: Any
  opt_state: Any
  ema_params: Any
  extra: Any = None  # what changes without a gradient, of stages that have such (codebooks)


def init_state(stage, tx, batch, rng):
  params = stage.init(batch, rng)
  copy = jax.tree.map(jnp.copy, params)  # donated buffers may not be shared
  extra = stage.init_extra(batch, rng) if stage.init_extra else None
  return TrainState(jnp.zeros((), jnp.int32), params, tx.init(params), copy, extra)


def variables_of(state, average=False):
  """What a trained stage is used with: parameters, averaged ones on demand, and the extra state beside them."""
  return {**(state.ema_params if average else state.params), **(state.extra or {})}


def make_train_step(stage, tx, ema_decay, skip_loss=0.0):
  """-> train_step(state, frozen, batch, rng) -> (state, metrics), pmapped over the first axis of the batch.

  skip_loss > 0 leaves the state as it was, but for the step count, when the loss is larger or not a number.
  """

  def train_step(state, frozen, batch, rng):
    rng = jax.random.fold_in(rng, state.step)  # a resumed run replays the same noise

    def total(params):
      if stage.init_extra:
        sums, weight, extra = stage.loss(params, frozen, batch, state.step, rng, state.extra)
      else:
        (sums, weight), extra = stage.loss(params, frozen, batch, state.step, rng), None
      return sums["loss"], (sums, weight, extra)

    grads, (sums, weight, extra) = jax.grad(total, has_aux=True)(state.params)
    # Sum first, divide last: devices hold unequal numbers of real frames.
    grads, sums, weight = jax.lax.psum((grads, sums, weight), DEVICES)
    grads, metrics = jax.tree.map(lambda s: s / weight, (grads, sums))
    updates, opt_state = tx.update(grads, state.opt_state, state.params)
    params = optax.apply_updates(state.params, updates)
    ema_params = optax.incremental_update(params, state.ema_params, 1 - ema_decay)
    metrics["grad_norm"] = optax.tree.norm(grads)
    new = TrainState(state.step, params, opt_state, ema_params, extra)
    if skip_loss:
      good = (metrics["loss"] <= skip_loss) & jnp.isfinite(metrics["grad_norm"])
      new = jax.tree.map(lambda a, b: jnp.where(good, a, b), new, state)
      metrics["skipped"] = 1.0 - good
    return new.replace(step=state.step + 1), metrics

  return jax.pmap(train_step, DEVICES, in_axes=(None, None, 0, None), out_axes=None, donate_argnums=0)


def shard(batch, num_devices):
  """Arrays (B, ...) to (num_devices, B / num_devices, ...)."""
  size = len(batch["index"])
  if size % num_devices:
    raise ValueError(f"got batches of {size} on {num_devices} devices; data.batch_size must be a multiple of them")
  return {k: np.reshape(v, (num_devices, size // num_devices) + np.shape(v)[1:]) for k, v in batch.items()}
