"""Constraints on a motion in addition to its prompt: paths, poses, hand and foot targets, loops, body parts."""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
