"""MDM on a page: "Human Motion Diffusion Model", and DiP, its autoregressive form.

A transformer predicts the clean motion of all frames at once from a noisy one, a diffusion step and a caption; the step
back draws the less noisy motion that both allow. DiP reads the clean frames before those that it generates, and
continues its own.

  noise (B, T, F) -> clean features, step by step -> motion

`goals` are DiP's targets, `editing` says which part of a motion an edit keeps.
Numbers follow the released code (docs/papers/mdm.md); where it is wrong a comment starts with "Parity".
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
