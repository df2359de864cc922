"""Motion-language teachers on a page: motions and captions as unit vectors of one space.

Part-TMR, TMR and MotionPatches each embed a motion and its caption near each other, by a contrast over the batch. A
trained teacher aligns the latents of CMDM's tokenizer, searches collections of motions and judges generated ones.

  motion (B, T, F) -> motion network -> (B, E)          caption -> text network -> (B, E)

`space` has the networks by kind and the space that each spans, `alignment` a trained teacher's feature of every frame,
for a tokenizer.
Numbers follow the released code (docs/papers/cmdm.md#part-tmr, #tmr, #motionpatches); where a paper differs a comment
starts with "Parity".
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
