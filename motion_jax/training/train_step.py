"""One pure training step around any Stage, and the state that it changes.

`training.mesh` maps it over devices: each gets its rows of the batch, and sums over the axis `stage.DEVICES` inside the
step make the devices agree.
"""
from collections.abc import Callable
from typing import Any, NamedTuple

import chex
import flax
import jax
import jax.numpy as jnp
import optax

from motion_jax.training.stage import DEVICES


@flax.struct.dataclass
class TrainState:
  """Everything that changes while training, which is what a resumed run needs."""
  step: jax.Array
  params: Any
  opt_state: Any
  ema_params: Any  # None if config.optimizer.ema_decay is 0
  extra: Any = None  # state that changes without a gradient (codebooks)
  norms: Any = None  # of the last gradients, for optimizer.skip_spikes


def init_state(stage, tx, batch, rng, average=True, norms=False):
  """The state before the first step; average: with an average of the parameters; norms: with the norms of the last 64
  gradients, nan where there was none."""
  params = stage.init(batch, rng)
  copy = jax.tree.map(jnp.copy, params) if average else None  # donated buffers may not be shared
  extra = stage.init_extra(batch, rng) if stage.init_extra else None
  return TrainState(jnp.zeros((), jnp.int32), params, tx.init(params), copy, extra,
                    jnp.full(64, jnp.nan) if norms else None)


def variables_of(state, average=False):
  """The variables that a trained stage is used with: parameters, optionally the averaged ones, and the extra state."""
  return {**(state.ema_params if average else state.params), **(state.extra or {})}


def is_below(path, names):
  """Whether a path of jax.tree_util in a tree of parameters goes through one of these names."""
  return any(getattr(key, "key", None) in names for key in path)


class TrainStep(NamedTuple):
  """(state, frozen, batch, rng) -> (state, metrics), to be mapped over DEVICES by `training.mesh`.

  The batch has the rows of one device; state, frozen and rng are the same on all devices, and so are the results. The
  step has two parts, of which the second does not depend on devices:
  gradients(state, frozen, batch, rng) -> (grads, metrics, extra), update(state, grads, metrics, extra).
  """
  gradients: Callable
  update: Callable

  def __call__(self, state, frozen, batch, rng):
    return self.update(state, *self.gradients(state, frozen, batch, rng))


def _in_parts(of_rows, batch, count):
  """The sum of of_rows(part) over `count` parts of a batch, computed one after the other."""
  num_rows = len(batch["index"])
  if num_rows % count:
    raise ValueError(f"got {num_rows} rows on each device and optimizer.accumulate_steps = {count}; data.batch_size "
                     "must be a multiple of their product")
  parts = jax.tree.map(lambda a: a.reshape((count, -1) + a.shape[1:]), batch)
  shapes = jax.eval_shape(of_rows, jax.tree.map(lambda a: a[0], parts))
  nothing = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)
  return jax.lax.scan(lambda found, rows: (jax.tree.map(jnp.add, found, of_rows(rows)), None), nothing, parts)[0]


def _frozen_or(freeze, old, new):
  """The tree new, with the leaves of old below these names."""
  return jax.tree_util.tree_map_with_path(
      lambda path, a, b: a if is_below(path, freeze) else b, old, new) if freeze else new


def _check_parts(stage, accumulate_steps):
  if accumulate_steps > 1 and not stage.in_parts:
    raise ValueError(f"got optimizer.accumulate_steps = {accumulate_steps}, but the items of a batch interact in "
                     "this stage's loss, so it cannot be split into parts; leave it at 1")


def _loss(stage, params, frozen, rows, state, rng):
  """(sum of the loss, (sums, weight, the stage's extra state)) of rows of a batch."""
  if stage.init_extra:
    sums, weight, extra = stage.loss(params, frozen, rows, state.step, rng, state.extra)
  else:
    (sums, weight), extra = stage.loss(params, frozen, rows, state.step, rng), None
  return sums["loss"], (sums, weight, extra)


def _with_norm(norms, norm):
  """The norms of the last gradients with a new one; nan where it is not finite."""
  return jnp.append(norms[1:], jnp.where(jnp.isfinite(norm), norm, jnp.nan))


def _check_scalars(**values):
  for name, value in values.items():  # a weight for each row would broadcast
    chex.assert_shape(value, (), custom_message=f"{name!r}: a stage's loss returns sums over the rows and one weight",
                      exception_type=ValueError)


def _average_share(step, ema_decay, debias):
  """Weight of a step's parameters in their average; debias: 1 in the first step, as Adam's means divided by
  1 - ema_decay ** n."""
  share = 1 - ema_decay
  return jnp.minimum(share / -jnp.expm1((step + 1) * jnp.log(ema_decay)), 1.0) if debias else share


def _is_good(metrics, norms, skip_loss, skip_spikes):
  """Whether a step is applied, by its loss, the norm of its gradient, and the norms before it."""
  good = (metrics["loss"] <= (skip_loss or jnp.inf)) & jnp.isfinite(metrics["grad_norm"])
  if skip_spikes:
    enough = jnp.isfinite(norms).sum() >= 16
    good &= ~(enough & (metrics["grad_norm"] > skip_spikes * jnp.nanmedian(norms)))
  return good


def make_train_step(stage, tx, ema_decay, skip_loss=0.0, skip_spikes=0.0, accumulate_steps=1, freeze=(),
                    ema_debias=False) -> TrainStep:
  """The step of a stage.

  skip_loss > 0: a step whose loss is larger, or not finite, changes nothing but the step count; skip_spikes > 0: the
  same for a gradient norm above skip_spikes times the median of the last ones (16 at least).
  accumulate_steps: number of parts of a device's rows whose gradients are computed one after the other and added; it is
  still one step on the whole batch. freeze: names below which parameters stay the same to the bit, without a gradient.
  ema_debias: the average of parameters leaves out the random start. Without it the average begins as a copy of the
  start, of which ema_decay ** n is left after n steps.

  Shapes are checked while the step is traced, which costs nothing when it runs: ValueError for a loss whose sums or
  weight are not scalars, AssertionError where gradients or updated parameters do not match the parameters.
  """
  frozen_or = lambda old, new: _frozen_or(freeze, old, new)
  _check_parts(stage, accumulate_steps)

  def gradients(state, frozen, batch, rng):
    """-> means of gradient and metrics over the batches of all devices, and the stage's extra state."""
    rng = jax.random.fold_in(rng, state.step)  # a resumed run replays the same noise

    def total(params, rows):
      params = frozen_or(jax.lax.stop_gradient(params), params)
      return _loss(stage, params, frozen, rows, state, rng)

    of_rows = lambda rows: jax.grad(total, has_aux=True)(state.params, rows)
    grads, (sums, weight, extra) = of_rows(batch) if accumulate_steps == 1 else _in_parts(
        of_rows, batch, accumulate_steps)
    chex.assert_trees_all_equal_shapes_and_dtypes(grads, state.params)
    _check_scalars(**sums, weight=weight)
    # Sum first, divide last: devices hold unequal numbers of real frames.
    grads, sums, weight = jax.lax.psum((grads, sums, weight), DEVICES)
    return *jax.tree.map(lambda s: s / weight, (grads, sums)), extra

  def updated(state, grads, extra):
    updates, opt_state = tx.update(grads, state.opt_state, state.params)
    params = frozen_or(state.params, optax.apply_updates(state.params, updates))
    ema_params = state.ema_params
    if ema_params is not None:
      share = _average_share(state.step, ema_decay, ema_debias)
      ema_params = frozen_or(ema_params, optax.incremental_update(params, ema_params, share))
    # Updates of another shape would broadcast, and another type would compile every step.
    chex.assert_trees_all_equal_shapes_and_dtypes((params, ema_params, extra),
                                                  (state.params, state.ema_params, state.extra))
    return TrainState(state.step, params, opt_state, ema_params, extra, state.norms)

  def update(state, grads, metrics, extra):
    metrics = metrics | {"grad_norm": optax.tree.norm(grads)}
    if skip_loss or skip_spikes:
      good = _is_good(metrics, state.norms, skip_loss, skip_spikes)
      # A branch: selecting between results would read and write the whole state once more.
      new = jax.lax.cond(good, updated, lambda state, grads, extra: state, state, grads, extra)
      metrics["skipped"] = 1.0 - good
    else:
      new = updated(state, grads, extra)
    if skip_spikes:
      new = new.replace(norms=_with_norm(state.norms, metrics["grad_norm"]))
    return new.replace(step=state.step + 1), metrics

  return TrainStep(gradients, update)
