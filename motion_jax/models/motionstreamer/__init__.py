"""MotionStreamer on a page: a causal autoencoder, and one latent after the other by a transformer and a diffusion head.

The autoencoder looks back only, so each new latent gives four more frames at once. The transformer reads a caption and
the latents so far; a small network denoises the next latent given its row. In training part of the latents that it
reads are its own.

  caption, latents so far -> condition (B, D) -> noise to latent (B, C), 50 steps -> decode -> 4 frames

Numbers follow the released code (docs/papers/motionstreamer.md); where it is wrong a comment starts with "Parity".
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
