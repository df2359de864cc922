"""Pure functions around a denoiser: paths, noise schedules, samplers, guidance."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.diffusion import ddpm, guidance, ode, paths, samplers, schedules
  from motion_jax.diffusion.ddpm import (
    Schedule,
    ancestral,
    cosine_schedule,
    ddim,
    linear_schedule,
    respace,
    scaled_linear_schedule,
  )
  from motion_jax.diffusion.guidance import combine, guided
  from motion_jax.diffusion.ode import Solution, dopri5
  from motion_jax.diffusion.paths import forcing_loss, forcing_times, velocity_to_noise, velocity_to_x1
  from motion_jax.diffusion.samplers import euler, heun, runge_kutta
  from motion_jax.diffusion.schedules import staircase, staircase_levels, time_of_level

__all__ = ["Schedule", "Solution", "ancestral", "combine", "cosine_schedule", "ddim", "ddpm", "dopri5", "euler",
           "forcing_loss", "forcing_times", "guidance", "guided", "heun", "linear_schedule", "ode", "paths",
           "respace", "runge_kutta", "samplers", "scaled_linear_schedule", "schedules", "staircase",
           "staircase_levels", "time_of_level", "velocity_to_noise", "velocity_to_x1"]

__getattr__, __dir__ = lazy.attach(__name__)
