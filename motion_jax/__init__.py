"""motion_jax: make people move from words.

  import motion_jax as mj
  model = mj.load("cmdm-small")
  motion = model.generate("a person waves", num_frames=120, seeds=[0])[0]
  motion.save("wave.mp4")
"""
import importlib
from typing import Any

__version__ = "0.1.0"

_NAMES = {"load": "motion_jax.loading", "Model": "motion_jax.models.base", "Motion": "motion_jax.models.results",
          "Clip": "motion_jax.data.clip", "Caption": "motion_jax.data.clip"}
_MODULES = {"cdamd": "motion_jax.models.cdamd", "cmdm": "motion_jax.models.cmdm"} | {
    name: f"motion_jax.{name}" for name in ("data", "diffusion", "export", "models", "motion", "nets", "quant", "text")}
__all__ = [*_NAMES, *_MODULES]


def __getattr__(name: str) -> Any:
  # On demand: a user of one component does not wait for all of them to load.
  if name in _NAMES:
    return getattr(importlib.import_module(_NAMES[name]), name)
  if name in _MODULES:
    return importlib.import_module(_MODULES[name])
  raise AttributeError(f"motion_jax has no {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
  return sorted([*__all__, "__version__"])
