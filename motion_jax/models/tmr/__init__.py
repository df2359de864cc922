"""Motion-language teachers on a page: motions and captions as unit vectors of one space.

Part-TMR, TMR and MotionPatches each embed a motion and its caption near each other, by a contrast over the batch. A
trained teacher aligns the latents of CMDM's tokenizer, searches collections of motions and judges generated ones.

  motion (B, T, F) -> motion network -> (B, E)          caption -> text network -> (B, E)

losses        the contrast, and the terms of TMR
space         the networks by kind, and the space that each spans
stages        how they are trained, as pure functions
setup         a config becomes a stage with its data and the weights that it starts from
alignment     a trained teacher's feature of every frame, for a tokenizer
weights       the authors' PyTorch files; `weight_names` maps their names

Numbers follow the released code (docs/papers/cmdm.md#part-tmr, #tmr, #motionpatches); where a paper differs a comment
starts with "Parity".
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
