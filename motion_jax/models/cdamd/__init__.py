"""CDAMD on a page: "Coordinate-based Dual-constrained Autoregressive Motion Generation".

An autoencoder turns joint coordinates into latents, four frames each; a residual VQ-VAE turns them into codes, the
prior that constrains attention in training. A masked transformer reads the latents that are known, and a small
diffusion network makes the masked ones, some more in every decoding iteration. What is known may be an existing motion:
so parts of it are edited.

  features (B, T, F) -> encode -> latents (B, T / 4, C) -> generate, edit -> decode -> features

`unmasking` is the loop over decoding iterations, `draws` its random numbers. Shared with MoMask: `shared.autoencoders`
(autoencoder and RVQ-VAE), `shared.mask_schedule` (which latents are masked, in training and in each decoding
iteration), `shared.length` (how long a motion should be), `shared.editing` (a model that fills masked latents).

Numbers follow the released code (docs/papers/cdamd.md); where the paper differs a comment starts with "Parity".
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
