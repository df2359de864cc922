"""T2M-GPT on a page: "Generating Human Motion from Textual Descriptions with Discrete Representations".

A VQ-VAE turns four frames each into one of 512 codes. A causal transformer reads the caption, then the codes so far,
and gives the next one, until it gives the end: so it decides on a motion's length. While it trains, half of the codes
that it reads are random, as its own will be wrong now and then.

  features (B, T, F) -> codes (B, T / 4); caption -> code, code, ..., end -> decode -> features

`items` keeps clips as rows of codes. Losses of the VQ-VAE: `shared.autoencoders`.
Numbers follow the released code (docs/papers/t2m_gpt.md); where the paper differs a comment starts with "Parity".
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
