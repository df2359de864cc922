"""Optimizers and learning rates as a config states them."""
import jax
import jax.numpy as jnp
import optax


def make_schedule(config, num_steps):
  """Learning rate by update: lr (it + 1) / (warmup + 1) while it < warmup, as both papers' code, then by name.

  "constant"; "step": times `gamma` at each of `boundaries`, steps or, below 1, shares of num_steps; "cosine": to
  `final_rate` at num_steps; "half_cosine": the first half of a cosine, to half the rate; "trapezoid": constant, then
  straight to 0 over the last `cooldown_steps`, so that a run can be prolonged before it is cooled down.
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
