"""Optimizers and learning rates as a config states them: ours and optax's, by name and fields (docs/training.md)."""
import functools
import inspect
import re

import jax
import jax.numpy as jnp
import optax
import optax.contrib

from motion_jax.utils.errors import InputError, reason
from motion_jax.utils.nearest import did_you_mean

SHORT_NAMES = {"schedule_free": "schedule_free_adamw"}  # names in configs of optax functions that are longer
# Fields of a config and what optax calls them, where an optimizer has them.
_SHARED = {"beta1": ("b1", "adam_b1"), "beta2": ("b2", "adam_b2"),
           "weight_decay": ("weight_decay", "weight_decay_rate")}
# Functions of optax that need more than gradients in each step, and those that are only parts of an optimizer.
_OTHERS = re.compile(r"_\w*|scale_by_\w+|lbfgs|momo|momo_adam|dpsgd")


# --- learning rates -----------------------------------------------------------------------------------------------


def make_schedule(config, num_steps):
  """Learning rate by update: lr (it + 1) / (warmup + 1) while it < warmup, as both papers' code, times a schedule.

  "constant"; "linear": in a straight line from the warm-up's end to `final_rate` at num_steps; "cosine": the same along
  a cosine; "half_cosine": the first half of a cosine, to half the rate; "step": times `gamma` at each of `boundaries`,
  steps or, below 1, shares of num_steps; "wsd": warm-up, stable, decay: constant, then straight to 0 over the last
  `cooldown_steps`, so that a run can be prolonged before it is cooled down. Else a schedule of optax, such as
  "exponential_decay" or "polynomial", with `schedule_fields`.
  """
  kind, peak, warmup = config.schedule, config.learning_rate, config.warmup_steps
  if kind == "constant":
    factor = optax.constant_schedule(1.0)
  elif kind == "step":
    falls = [boundary if boundary >= 1 else max(1, round(boundary * num_steps)) for boundary in config.boundaries]
    factor = optax.piecewise_constant_schedule(1.0, dict.fromkeys(falls, config.gamma))
  elif kind == "cosine":
    cosine = optax.cosine_decay_schedule(1.0, max(num_steps - warmup, 1), config.final_rate / peak)
    factor = lambda step: cosine(jnp.maximum(step - warmup, 0))
  elif kind == "half_cosine":
    cosine = optax.cosine_decay_schedule(1.0, 2 * num_steps)
    factor = lambda step: cosine(jnp.minimum(step, num_steps))
  elif kind == "linear":
    factor = optax.linear_schedule(1.0, config.final_rate / peak, max(num_steps - warmup, 1), warmup)
  elif kind == "wsd":  # in a run shorter than its decay, the last part of the slope
    cooldown = max(config.cooldown_steps, 1)
    factor = optax.linear_schedule(min(num_steps / cooldown, 1.0), 0.0, min(cooldown, num_steps),
                                   max(num_steps - cooldown, 0))
  else:
    factor, peak = _optax_schedule(kind, config, num_steps), 1.0
  begin = optax.linear_schedule(1 / (warmup + 1), 1.0, warmup) if warmup else optax.constant_schedule(1.0)
  if warmup and config.get("warmup") == "released":
    # Parity: MoMask's and T2M-GPT's loops begin with the second step and end before the last; the rate stays below lr.
    begin = lambda step: jnp.minimum(step + 2, warmup) / (warmup + 1)
  return lambda step: peak * factor(step) * begin(step)


SCHEDULES = ("constant", "linear", "cosine", "half_cosine", "step", "wsd")


def _optax_schedule(name, config, num_steps):
  known = _optax_schedules()
  function = known.get(name) or known.get(f"{name}_schedule")
  if function is None:
    raise InputError(f"got optimizer.schedule {name!r}{did_you_mean(name, [*SCHEDULES, *known])}, expected "
                     f"{', '.join(SCHEDULES)} or a schedule of optax: {', '.join(known)}")
  # The config's own rate and length stand in for fields that are not given.
  rate = dict.fromkeys(("value", "init_value", "peak_value"), config.learning_rate)
  length = dict.fromkeys(("decay_steps", "transition_steps"), num_steps)
  if "peak_value" in inspect.signature(function).parameters:
    rate["init_value"] = 0.0
  return _call(function, "schedule_fields", config.schedule_fields, rate | length)


@functools.cache
def _optax_schedules():
  names = [name for name in dir(optax.schedules) if re.fullmatch(r"[a-z]\w*(_schedule|_decay)", name)]
  return {name: getattr(optax.schedules, name) for name in names}


# --- optimizers ---------------------------------------------------------------------------------------------------


def make_optimizer(config, num_steps):
  """The optimizer `config.name` with gradient clipping by global norm (config.clip_norm, 0 = none).

  Names: adamw, adafactor, muon, lion, schedule_free and any other function of optax or optax.contrib that takes a
  learning rate. beta1, beta2 and weight_decay of the config apply where the function has them; config.fields {name:
  value} are its other arguments, and override these.
  config.rates: {name: factor} of the learning rate of the parameters below that name; 0 keeps them as they are.
  config.clip_parts: names of networks, each of which is clipped by the norm of its own gradient.
  """
  name = SHORT_NAMES.get(config.name, config.name)
  function = _optax_optimizers().get(name)
  if function is None:
    common = ("adamw", "adafactor", "muon", "lion", "schedule_free")
    raise InputError(f"got optimizer.name {config.name!r}{did_you_mean(config.name, [*common, *_optax_optimizers()])}, "
                     f"expected {', '.join(common)} or another optimizer of optax")
  takes = inspect.signature(function).parameters
  given = {theirs: config[ours] for ours, names in _SHARED.items() for theirs in names if theirs in takes}
  optimizer = _call(function, "fields", config.fields, given | {"learning_rate": make_schedule(config, num_steps)})
  rates = dict(config.rates)
  if is_schedule_free(config) and (config.ema_decay or rates):
    field = "ema_decay" if config.ema_decay else "rates"
    raise InputError(f"got optimizer.{field} with optimizer.name {config.name!r}, which averages the parameters "
                     f"itself; leave optimizer.{field} at {0.0 if field == 'ema_decay' else {}}")
  parts = [clipping(config), optimizer] if config.clip_norm else [optimizer]
  if rates:
    parts.append(optax.stateless(lambda updates, _: jax.tree_util.tree_map_with_path(
        lambda path, update: update * _rate(path, rates), updates)))
  return optax.chain(*parts) if len(parts) > 1 else optimizer


def is_schedule_free(config) -> bool:
  """Whether the parameters to use are not those that training holds, see `parameters_to_use`."""
  return config.name.startswith("schedule_free")


def parameters_to_use(opt_state, params):
  """The parameters that a model is used with: `params`, or of a schedule-free optimizer its average."""
  is_state = lambda node: isinstance(node, optax.contrib.ScheduleFreeState)
  for state in filter(is_state, jax.tree.leaves(opt_state, is_leaf=is_state)):
    return optax.contrib.schedule_free_eval_params(state, params)
  return params


@functools.cache
def _optax_optimizers():
  optimizers = {}
  for source in (optax, optax.contrib):
    for name, function in inspect.getmembers(source, inspect.isfunction):
      if not _OTHERS.fullmatch(name) and next(iter(inspect.signature(function).parameters), "") == "learning_rate":
        optimizers[name] = function
  return optimizers


def _call(function, section, fields, given):
  """function(**given, **fields), where it takes them; wrong fields raise InputError."""
  fields = {name: tuple(value) if isinstance(value, list) else value for name, value in dict(fields).items()}
  takes = list(inspect.signature(function).parameters)
  for field in fields:
    if field not in takes:
      raise InputError(f"got optimizer.{section}.{field}{did_you_mean(field, takes)}, which optax.{function.__name__} "
                       f"does not have, expected {', '.join(name for name in takes if name != 'learning_rate')}")
  try:
    return function(**{name: value for name, value in given.items() if name in takes} | fields)
  except (TypeError, ValueError) as error:
    raise InputError(f"optimizer.{section} do not fit optax.{function.__name__} ({reason(error)}); it takes "
                     f"{', '.join(takes)}") from error


def clipping(config):
  """Clipping by the norm of the whole gradient, or of the gradient of each network in config.clip_parts."""
  names = tuple(config.clip_parts)
  clip = optax.clip_by_global_norm(config.clip_norm)
  if not names:
    return clip
  part = lambda path: next((key.key for key in path if getattr(key, "key", None) in names), "rest")
  return optax.partition({name: clip for name in names} | {"rest": optax.identity()},
                         lambda tree: jax.tree_util.tree_map_with_path(lambda path, _: part(path), tree))


def _rate(path, rates):
  return next((rates[key.key] for key in path if getattr(key, "key", None) in rates), 1.0)
