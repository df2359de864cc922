"""MLD on a page: "Executing your Commands via Motion Diffusion in Latent Space".

A transformer VAE turns a motion of any length into one token; a small transformer, its layers joined by skips, denoises
that token given a caption.

  noise (B, 1, D) -> token, in 50 steps of DDIM -> decode with the wanted length -> features (B, T, F)

Numbers follow the released code (docs/papers/mld.md); where it is wrong a comment starts with "Parity".
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
