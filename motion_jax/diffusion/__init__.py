"""Pure functions around a denoiser: paths, schedules, samplers, guidance, streaming."""
