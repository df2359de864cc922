from . import ddpm, guidance, ode, paths, samplers, schedules
from .ddpm import (
  Schedule,
  ancestral,
  cosine_schedule,
  ddim,
  linear_schedule,
  respace,
  scaled_linear_schedule,
)
from .guidance import combine, guided
from .ode import Solution, dopri5
from .paths import forcing_loss, forcing_times, velocity_to_noise, velocity_to_x1
from .samplers import euler, heun, runge_kutta
from .schedules import staircase, staircase_levels, time_of_level

__all__ = ["Schedule", "Solution", "ancestral", "combine", "cosine_schedule", "ddim", "ddpm", "dopri5", "euler",
           "forcing_loss", "forcing_times", "guidance", "guided", "heun", "linear_schedule", "ode", "paths",
           "respace", "runge_kutta", "samplers", "scaled_linear_schedule", "schedules", "staircase",
           "staircase_levels", "time_of_level", "velocity_to_noise", "velocity_to_x1"]
