"""Text-to-motion generation in JAX.

  import motion_jax as mj
  model = mj.load("cmdm-small")
  motion = model.generate("a person waves", num_frames=120, seeds=[0])[0]
  motion.save("wave.mp4")
"""
import lazy_loader

__version__ = "0.2.0"

__getattr__, _, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __dir__():
  return [*__all__, "__version__"]
