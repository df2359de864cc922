"""The experiments as a package: `motion_jax.configs.cmdm_denoiser` is configs/cmdm_denoiser.py.

In a checkout they lie in the folder configs/ at its top, to which this leads; a wheel has that folder in this place.
"""
import pathlib

__path__ = [str(pathlib.Path(__file__).parents[2] / "configs")]
