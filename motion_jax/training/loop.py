"""The training loop: one pure step, pmapped over the devices, around any Stage."""
import contextlib
import pathlib
import sys
import threading
import time
from typing import Any

import flax
import jax
import jax.numpy as jnp
import numpy as np
import optax
from tqdm import tqdm

from motion_jax.runtime import stopping
from motion_jax.training import checkpoint
from motion_jax.training.metrics import append_metrics, draw_curve, read_metrics, trim_metrics
from motion_jax.training.stage import DEVICES


@flax.struct.dataclass
class TrainState:
  """All that changes while training, and with it all that a resumed run needs."""
  step: jax.Array
  params: Any
  opt_state: Any
  ema_params: Any
  extra: Any = None  # what changes without a gradient, of stages that have such (codebooks)


def make_schedule(config, num_steps):
  """Learning rate by update: lr (it + 1) / (warmup + 1) while it < warmup, as both papers' code, then by name.

  "constant"; "step": times `gamma` at each of `boundaries`; "cosine": to `final_rate` at num_steps;
  "half_cosine": the first half of a cosine, to half the rate; "trapezoid": constant, then straight to 0 over the last
  `cooldown_steps`, so that a run can be prolonged before it is cooled down.
  """
  kind, peak, warmup = config.schedule, config.learning_rate, config.warmup_steps
  if kind == "constant":
    factor = optax.constant_schedule(1.0)
  elif kind == "step":
    factor = optax.piecewise_constant_schedule(1.0, {boundary: config.gamma for boundary in config.boundaries})
  elif kind == "cosine":
    cosine = optax.cosine_decay_schedule(1.0, max(num_steps - warmup, 1), config.final_rate / peak)
    factor = lambda step: cosine(jnp.maximum(step - warmup, 0))
  elif kind == "half_cosine":
    cosine = optax.cosine_decay_schedule(1.0, 2 * num_steps)
    factor = lambda step: cosine(jnp.minimum(step, num_steps))
  elif kind == "trapezoid":  # of a run shorter than its cool-down what is left of the slope
    cooldown = max(config.cooldown_steps, 1)
    factor = optax.linear_schedule(min(num_steps / cooldown, 1.0), 0.0, min(cooldown, num_steps),
                                   max(num_steps - cooldown, 0))
  else:
    raise ValueError(f"got optimizer.schedule {kind!r}, expected constant, step, cosine, half_cosine or trapezoid")
  begin = optax.linear_schedule(1 / (warmup + 1), 1.0, warmup) if warmup else optax.constant_schedule(1.0)
  return lambda step: peak * factor(step) * begin(step)


def make_optimizer(config, num_steps):
  """AdamW as a config states it: betas, decay, gradient clipping by global norm (0 = none).

  config.rates: {name: factor}, times which the parameters below that name learn; 0 holds them still.
  config.clip_parts: names of networks, each of which is clipped by the norm of its own gradient.
  """
  adamw = optax.adamw(make_schedule(config, num_steps), b1=config.beta1, b2=config.beta2,
                      weight_decay=config.weight_decay)
  parts = [_clipping(config), adamw] if config.clip_norm else [adamw]
  rates = dict(config.rates)
  if rates:
    parts.append(optax.stateless(lambda updates, _: jax.tree_util.tree_map_with_path(
        lambda path, update: update * _rate(path, rates), updates)))
  return optax.chain(*parts) if len(parts) > 1 else adamw


def _clipping(config):
  names = tuple(config.clip_parts)
  clip = optax.clip_by_global_norm(config.clip_norm)
  if not names:
    return clip
  part = lambda path: next((key.key for key in path if getattr(key, "key", None) in names), "rest")
  return optax.partition({name: clip for name in names} | {"rest": optax.identity()},
                         lambda tree: jax.tree_util.tree_map_with_path(lambda path, _: part(path), tree))


def _rate(path, rates):
  return next((rates[key.key] for key in path if getattr(key, "key", None) in rates), 1.0)


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


class _Progress:
  """A line about a run, often at first and then once a minute: step, loss, samples a second, time left."""

  def __init__(self, first, num_steps, batch_size):
    self.first, self.num_steps, self.batch_size = first, num_steps, batch_size
    self.began = self.told = time.monotonic()
    self.warm = None  # when the first step was done, which waits for the compiler
    self._patience = threading.Event()
    if first < num_steps:
      threading.Thread(target=self._wait, daemon=True).start()

  def _wait(self, every=5):
    """Says every few seconds that the first step is being compiled, until it is done."""
    while not self._patience.wait(every):
      print(f"step {self.first} of {self.num_steps}: compiling the first step, "
            f"{time.monotonic() - self.began:.0f} s so far", flush=True)

  def close(self):
    self._patience.set()

  def line(self, step, metrics) -> str | None:
    """What to say after this step, or None where something was said just now."""
    now, done = time.monotonic(), step - self.first
    often = 5 if now - self.began < 60 else 60
    if done > 2 and now - self.told < often and step < self.num_steps:
      return None
    said = f"step {step} of {self.num_steps}: loss {float(metrics['loss']):.4g}"  # waits until the step is done
    now = self.told = time.monotonic()
    if self.warm is None:
      self.close()
      self.warm = now
      return f"{said}, the first step took {now - self.began:.0f} s, most of it for the compiler"
    rate = (done - 1) / max(now - self.warm, 1e-6)
    return f"{said}, {rate * self.batch_size:.1f} samples/s, {duration((self.num_steps - step) / rate)} left"


def duration(seconds) -> str:
  """12 s, 3 min, 2 h 05 min."""
  minutes = round(seconds / 60)
  if seconds < 90:
    return f"{seconds:.0f} s"
  return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def train(config, workdir, stage, next_batch, frozen=None, resume=False, evaluate=None, max_seconds=None,
          stop=None):
  """Trains a stage in a run folder; returns the last TrainState.

  next_batch(step) -> dict of arrays with "index" (B,), a pure function of the step. frozen: arrays that the loss reads
  and nobody changes. evaluate(params) -> dict of numbers, called on the averaged parameters at every save. The folder
  gets checkpoints/, params.safetensors (averaged if there is an average), metrics.jsonl and loss.png. max_seconds ends
  a slice of a long run early; --resume goes on exactly where it ended; a signal does so, too, which
  stop (a `stopping.Stop`) then tells. config.train.best, such as "min held_out_loss"
  or "max r1", keeps in params.safetensors those for which that number of `evaluate` was best at a save, the later one
  of equals; the last ones are in last.safetensors then. "min held_out_fid|held_out_mm" takes the first number that
  `evaluate` gives. A slice that ends between two saves chooses nothing, so that slices make no difference.
  """
  workdir = pathlib.Path(workdir)
  devices = jax.local_device_count()
  num_steps, optimizer = config.train.num_steps, config.optimizer
  tx = make_optimizer(optimizer, num_steps)
  rng = jax.random.key(config.seed)
  init_rng = jax.random.fold_in(rng, 2**31 - 1)  # no step folds in this number
  example = next_batch(0)
  state = jax.jit(lambda batch, key: init_state(stage, tx, batch, key))(example, init_rng)
  # Placed as the step places it, so that the step is compiled once and not again for its own output.
  place = jax.pmap(lambda state, _: state, DEVICES, in_axes=(None, 0), out_axes=None)
  state = place(state, np.zeros(devices))
  saver = checkpoint.Saver(workdir)
  use_average = optimizer.ema_decay > 0

  def keep(state):
    checkpoint.save_params(workdir, variables_of(state, use_average))
    if use_average:  # references that have no average are judged without one
      checkpoint.save_params(workdir, variables_of(state), name=checkpoint.RAW)

  if saver.latest is not None:
    if not resume:
      raise ValueError(f"{workdir} holds a run at step {saver.latest}; --resume continues it, or choose another folder")
    state = place(saver.restore(state), np.zeros(devices))
    if _is_best(config, workdir, saver.latest):  # the run may have ended between its checkpoint and this file
      keep(state)
  elif resume and not checkpoint.is_fresh(workdir):
    raise FileNotFoundError(f"{workdir} has no checkpoint to resume from; start without --resume in an empty folder")
  trim_metrics(workdir, int(state.step))
  frozen = jax.tree.map(jnp.asarray, frozen or {})
  train_step = make_train_step(stage, tx, optimizer.ema_decay, optimizer.skip_loss)
  start = began = time.time()
  first = int(state.step)
  numbers = {}
  logged = []

  def check_finite(step):
    """Neither logged nor saved is what came of a step without a finite loss and gradient."""
    bad = [m for m in logged if not np.isfinite([float(m["loss"]), float(m["grad_norm"])]).all()]
    if bad and not optimizer.skip_loss:  # which leaves such steps out
      raise FloatingPointError(f"the loss is {float(bad[0]['loss'])}, its gradient {float(bad[0]['grad_norm'])} near "
                               f"step {step}; the last good state is step {saver.latest}. Try a lower "
                               "optimizer.learning_rate, and `motion-jax data doctor`")

  def save(step):
    check_finite(step)
    params = variables_of(state, use_average)
    if evaluate is not None:
      numbers.update(evaluate(params))
      append_metrics(workdir, {"step": step, **numbers})
    saver.save(step, state)
    if config.train.best:
      checkpoint.save_params(workdir, params, name=checkpoint.LAST)
    if _is_best(config, workdir, step) or not (workdir / checkpoint.PARAMS).is_file():  # something is there at any time
      keep(state)

  progress = _Progress(first, num_steps, len(example["index"]))
  bar = tqdm(total=num_steps, initial=first, unit="step", dynamic_ncols=True, disable=None)
  with contextlib.closing(progress), (stop or stopping.Stop()) as interrupt, bar:
    step = first
    while step < num_steps:
      state, metrics = train_step(state, frozen, shard(next_batch(step), devices), rng)
      step += 1
      logged.append(metrics)
      if line := progress.line(step, metrics):
        tqdm.write(line)
        sys.stdout.flush()
      if step % config.train.log_every == 0 or step == num_steps:
        check_finite(step)
        means = {k: float(np.mean([float(m[k]) for m in logged])) for k in logged[0]}
        logged.clear()
        append_metrics(workdir, {"step": step, "seconds": round(time.time() - began, 1), **means})
        bar.set_postfix({k: f"{v:.4g}" for k, v in means.items() if k in ("loss", "mse")} |
                        {k: f"{v:.4g}" for k, v in numbers.items()})
      bar.update(1)
      out_of_time = max_seconds is not None and time.time() - start > max_seconds
      if step % config.train.save_every == 0 or step == num_steps or interrupt.raised or out_of_time:
        save(step)
      if interrupt.raised or out_of_time:
        tqdm.write(f"stopped and saved at step {step}; --resume goes on from there")
        break
  saver.close()
  draw_curve(workdir)
  return state


def _is_best(config, workdir, step):
  """Whether the parameters of this step are those to keep, by the number that config.train.best names, if any."""
  if not config.train.best:
    return True
  way, _, names = config.train.best.partition(" ")
  rows = [row for row in read_metrics(workdir) if row["step"] <= step]
  given = [name for name in names.split("|") if any(name in row for row in rows if row["step"] == step)]
  if not given:
    raise ValueError(f"config.train.best names {names!r}, which the evaluation at step {step} did not give")
  every = {row["step"]: row[given[0]] for row in rows if given[0] in row}
  saves = {at: value for at, value in every.items()
           if at % config.train.save_every == 0 or at == config.train.num_steps}
  return step in saves and saves[step] == {"min": min, "max": max}[way](saves.values())
