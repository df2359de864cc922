"""The application: from a sentence to a motion that shows it, on the command line, in a browser or in Python.

  from motion_jax_studio import Pipeline
  Pipeline("cmdm-small")("a person walks while waving, then sits down").save("both.html")
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
