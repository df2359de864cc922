"""MoMask on a page: "Generative Masked Modeling of 3D Human Motions".

A residual VQ-VAE turns four frames each into six codes, of which each names what those before left over. A masked
transformer fills the codes of level 0: all of them hidden at first, in each round the most certain ones are kept. A
residual transformer adds the other levels, one pass each. Known codes may be an existing motion's: so it is edited.

  features (B, T, F) -> codes (B, T / 4, Q); caption -> level 0 in rounds -> levels 1 .. Q - 1 -> decode -> features

Losses of the RVQ-VAE: `shared.autoencoders`.
Numbers follow the released code (docs/papers/momask.md); where the paper differs a comment starts with "Parity".
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
