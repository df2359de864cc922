"""DDPM and DDIM: noise schedules, and samplers for networks that predict the noise or the clean data.

For MARDM's DDPM variant (docs/papers/cdamd.md#diffusion-mlp), MDM (docs/papers/mdm.md#diffusion), MLD
(docs/papers/mld.md#diffusion) and MotionStreamer's head. A larger step is noisier and 0 the cleanest, opposite to the
times of `paths`: steps are indices of the tables below and the network's input.
"""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.shapes import Array, Float, Int

Table = Float[np.ndarray, " n"]


class Schedule(NamedTuple):
  """Tables (N,) in float64: variances of the steps, cumulative products of alphas, and the posterior's terms.

  steps: the steps of the training schedule that these correspond to, which are the network's input.
  """
  steps: Int[np.ndarray, " n"]
  betas: Table
  alphas_cumprod: Table
  sqrt_recip_alphas_cumprod: Table
  sqrt_recipm1_alphas_cumprod: Table
  posterior_variance: Table
  posterior_log_variance_clipped: Table
  posterior_mean_coef1: Table
  posterior_mean_coef2: Table


def schedule_of(betas: Table, steps: Int[np.ndarray, " n"] | None = None) -> Schedule:
  """Computes all tables from the variances betas (N,)."""
  betas = np.asarray(betas, np.float64)
  kept = np.cumprod(1 - betas)
  before = np.append(1.0, kept[:-1])
  variance = betas * (1 - before) / (1 - kept)
  # The posterior variance of step 0 is 0; its logarithm is replaced by that of step 1.
  log_variance = np.log(np.append(variance[1], variance[1:])) if len(betas) > 1 else np.zeros(1)
  return Schedule(np.arange(len(betas)) if steps is None else np.asarray(steps), betas, kept, np.sqrt(1 / kept),
                  np.sqrt(1 / kept - 1), variance, log_variance, betas * np.sqrt(before) / (1 - kept),
                  (1 - before) * np.sqrt(1 - betas) / (1 - kept))


def cosine_schedule(num_steps: int = 50) -> Schedule:
  """The squared-cosine schedule, its variances capped at 0.999."""
  # Parity: 50 steps in training too, where most use 1000.
  left = lambda s: np.cos((s + 0.008) / 1.008 * np.pi / 2) ** 2
  index = np.arange(num_steps)
  return schedule_of(np.minimum(1 - left((index + 1) / num_steps) / left(index / num_steps), 0.999))


def linear_schedule(num_steps: int = 1000) -> Schedule:
  """The linear schedule: variances from 1e-4 to 0.02 for 1,000 steps."""
  scale = 1000 / num_steps
  return schedule_of(np.linspace(scale * 1e-4, scale * 0.02, num_steps))


def scaled_linear_schedule(num_steps: int = 1000, start: float = 0.00085, end: float = 0.012) -> Schedule:
  """The scaled linear schedule of latent diffusion: square roots of the variances are linear."""
  return schedule_of(np.linspace(np.sqrt(start), np.sqrt(end), num_steps) ** 2)


def spaced_steps(total: int, spacing: int | str) -> Int[np.ndarray, " n"]:
  """Which of the `total` training steps a sampler uses, ascending.

  A number: that many, evenly spaced from the first to the last. Several, "10,15,20": total is split into as many equal
  parts, with that many steps from each. "ddim50": 50 steps at the smallest integer stride that gives 50.
  """
  if isinstance(spacing, str) and spacing.startswith("ddim"):
    wanted = int(spacing.removeprefix("ddim"))
    for stride in range(1, total):
      if len(range(0, total, stride)) == wanted:
        return np.arange(0, total, stride)
    raise ValueError(f"got {wanted} sampler steps at a whole stride, which {total} steps of training do not have")
  counts = [int(part) for part in str(spacing).split(",")]
  parts, rest = divmod(total, len(counts))
  chosen: list[int] = []
  first = 0
  for i, count in enumerate(counts):
    size = parts + (i < rest)
    if not 1 <= count <= size:
      raise ValueError(f"got {count} sampler steps, expected 1 to the {size} of training")
    apart = (size - 1) / (count - 1) if count > 1 else 1.0
    place = 0.0
    for _ in range(count):  # accumulated as in the reference, because its rounding decides ties
      chosen.append(first + round(place))
      place += apart
    first += size
  return np.array(sorted(set(chosen)))


def respace(schedule: Schedule, spacing: int | str) -> Schedule:
  """The schedule of a subset of steps, chosen by `spaced_steps`."""
  return at_steps(schedule, spaced_steps(len(schedule.betas), spacing))


def at_steps(schedule: Schedule, chosen: Int[np.ndarray, " n"]) -> Schedule:
  """The schedule of these steps (N,), ascending, of the given one."""
  kept = schedule.alphas_cumprod[chosen]
  return schedule_of(1 - kept / np.append(1.0, kept[:-1]), schedule.steps[chosen])


def add_noise(schedule: Schedule, x1: Float[Array, "*lead c"], noise: Float[Array, "*lead c"],
              step: Int[Array, "*#lead"]) -> Float[Array, "*lead c"]:
  """Forward diffusion: data x1 (..., C) with the noise of `step` (...)."""
  kept = schedule.alphas_cumprod
  of_data, of_noise = (jnp.asarray(np.sqrt(a), x1.dtype)[step][..., None] for a in (kept, 1 - kept))
  return of_data * x1 + of_noise * noise


def loss_rows(predict: Callable, schedule: Schedule, x1: Float[Array, "*lead c"], step: Int[Array, "*lead"],
              noise: Float[Array, "*lead c"]) -> Float[Array, "*lead"]:
  """Squared error of the predicted noise, averaged over channels: (...) for x1 (..., C), step (...)."""
  predicted = predict(add_noise(schedule, x1, noise, step), jnp.asarray(schedule.steps)[step])
  return ((predicted - noise) ** 2).mean(-1)


def _row(table: Table, index: Any, like: Array) -> Array:
  """Entries of a table at indices (...), shaped for multiplication with an array (..., C)."""
  return jnp.asarray(table, like.dtype)[index][..., None]


def x1_of_noise(schedule: Schedule, x: Float[Array, "*lead c"], noise: Float[Array, "*lead c"],
                index: int | Int[Array, "*#lead"]) -> Float[Array, "*lead c"]:
  """The clean data of x (..., C) at table row index (...), given its noise."""
  return (_row(schedule.sqrt_recip_alphas_cumprod, index, x) * x
          - _row(schedule.sqrt_recipm1_alphas_cumprod, index, x) * noise)


def noise_of_x1(schedule: Schedule, x: Float[Array, "*lead c"], x1: Float[Array, "*lead c"],
                index: int | Int[Array, "*#lead"]) -> Float[Array, "*lead c"]:
  """The noise of x (..., C) at table row index (...), given its clean data."""
  return ((_row(schedule.sqrt_recip_alphas_cumprod, index, x) * x - x1)
          / _row(schedule.sqrt_recipm1_alphas_cumprod, index, x))


def posterior_mean(schedule: Schedule, x: Float[Array, "*lead c"], x1: Float[Array, "*lead c"],
                   index: int | Int[Array, "*#lead"]) -> Float[Array, "*lead c"]:
  """The posterior mean of the next cleaner step, given x (..., C) at table row index (...) and its clean data."""
  return _row(schedule.posterior_mean_coef1, index, x) * x1 + _row(schedule.posterior_mean_coef2, index, x) * x


def step_back(schedule: Schedule, x: Float[Array, "*lead c"], x1: Float[Array, "*lead c"],
              index: int | Int[Array, ""], noise: Float[Array, "*lead c"], temperature: Any = 1.0
              ) -> Float[Array, "*lead c"]:
  """One ancestral sampling step from table row `index` () to the previous one, given the clean data.

  Row 0 adds no noise.
  """
  std = jnp.exp(0.5 * jnp.asarray(schedule.posterior_log_variance_clipped, x.dtype)[index])
  return posterior_mean(schedule, x, x1, index) + jnp.where(index > 0, std * temperature, 0.0) * noise


PREDICTS = ("noise", "x1")  # outputs of a network: the noise, or the clean data


def clean_of(predicts: str, schedule: Schedule, x: Float[Array, "*lead c"], predicted: Float[Array, "*lead c"],
             index: int | Int[Array, "*#lead"]) -> Float[Array, "*lead c"]:
  """Converts a network's output, one of `PREDICTS`, to the clean data."""
  if predicts not in PREDICTS:
    raise ValueError(f"got a network that predicts {predicts!r}, expected {' or '.join(PREDICTS)}")
  return predicted if predicts == "x1" else x1_of_noise(schedule, x, predicted, index)


def ancestral_path(predict: Callable, schedule: Schedule, x: Float[Array, "*lead c"], fresh: Callable,
                   temperature: Any = 1.0, predicts: str = "noise", replace: Callable = lambda x1: x1
                   ) -> Float[Array, " n *lead c"]:
  """Ancestral sampling from noise x (..., C) -> x after each step (N, ..., C), the last one data.

  predict(x, step ()) -> noise or clean data (..., C), as `predicts` says; fresh(m) is the noise of the m-th step, m a
  traced integer from 0; replace(x1) edits the predicted clean data, for example to insert known frames (inpainting).
  """
  def back(x, m):
    x = _back(predict, schedule, x, m, fresh, temperature, predicts, replace)
    return x, x

  return jax.lax.scan(back, x, jnp.arange(len(schedule.betas)))[1]


def ancestral(predict: Callable, schedule: Schedule, x: Float[Array, "*lead c"], fresh: Callable,
              temperature: Any = 1.0, predicts: str = "noise", replace: Callable = lambda x1: x1
              ) -> Float[Array, "*lead c"]:
  """Samples data from noise x (..., C) by ancestral steps: the last row of `ancestral_path`."""
  back = lambda x, m: (_back(predict, schedule, x, m, fresh, temperature, predicts, replace), None)
  return jax.lax.scan(back, x, jnp.arange(len(schedule.betas)))[0]


def _predicted(predict: Callable, schedule: Schedule, x: Array, index: Any) -> Array:
  """The network's output at the training step that a table row stands for."""
  return predict(x, jnp.asarray(schedule.steps)[index])


def _back(predict: Callable, schedule: Schedule, x: Array, m: Any, fresh: Callable, temperature: Any, predicts: str,
          replace: Callable) -> Array:
  index = len(schedule.betas) - 1 - m
  x1 = replace(clean_of(predicts, schedule, x, _predicted(predict, schedule, x, index), index))
  return step_back(schedule, x, x1, index, fresh(m), temperature)


def ddim_path(predict: Callable, schedule: Schedule, x: Float[Array, "*lead c"], end: float = 1.0,
              predicts: str = "noise") -> Float[Array, " n *lead c"]:
  """Deterministic DDIM from noise x (..., C) -> x after each step (N, ..., C); predict as in `ancestral_path`.

  end: the product of alphas after the last step: 1, or that of the cleanest training step.
  """
  before = np.append(end, schedule.alphas_cumprod[:-1])

  def back(x, m):
    index = len(schedule.betas) - 1 - m
    predicted = _predicted(predict, schedule, x, index)
    x1 = clean_of(predicts, schedule, x, predicted, index)
    noise = predicted if predicts == "noise" else noise_of_x1(schedule, x, x1, index)
    x = _row(np.sqrt(before), index, x) * x1 + _row(np.sqrt(1 - before), index, x) * noise
    return x, x

  return jax.lax.scan(back, x, jnp.arange(len(schedule.betas)))[1]


def ddim(predict: Callable, schedule: Schedule, x: Float[Array, "*lead c"], end: float = 1.0, predicts: str = "noise"
         ) -> Float[Array, "*lead c"]:
  """Samples data from noise x (..., C) by DDIM: the last row of `ddim_path`."""
  return ddim_path(predict, schedule, x, end, predicts)[-1]
