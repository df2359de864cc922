"""CMDM on a page: "Causal Motion Diffusion Models for Autoregressive Motion Generation".

A causal VAE turns motion into latents, four frames each, which see no later frame; it may be aligned with a
motion-language teacher (`models.tmr`). A causal diffusion transformer learns to denoise latents that each
have a noise level of their own. Frame-wise sampling cleans them one after the other, a few steps apart, so that motion
streams out while it is made.

  features (B, T, F) -> encode -> latents (B, T / 4, C) -> generate -> decode -> features

losses        of the tokenizer
stages        what is trained, as pure functions
setup         a config becomes a stage with its data
streaming     the frame-wise sampler: one step that offline and live sampling share
sampling      generation as pure functions, by that step or by the plain loop that it is tested against
networks      networks with their weights, compiled
loop          the step driven from the host: motion of any length and kind by one program
model         ready to use: `multi_prompt` makes whole motions, `extending` continues one, `live` streams
weights       the authors' PyTorch files

Numbers follow the released code (docs/papers/cmdm.md); where the paper differs a comment starts with "Parity".
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
