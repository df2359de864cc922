"""The application: from a sentence to a motion that shows it, on the command line, in a browser or in Python.

  from motion_jax_studio import Pipeline
  Pipeline("cmdm-small")("a person walks while waving, then sits down").save("both.html")
"""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax_studio.pipeline import Pipeline

__all__ = ["Pipeline"]

__getattr__, __dir__ = lazy.attach(__name__)
