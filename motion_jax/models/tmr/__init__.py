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
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.models.tmr.alignment import as_seen, frame_features, motion_side, plain_stats, view_of
  from motion_jax.models.tmr.losses import info_nce, symmetric_cross_entropy, tmr_terms, unit
  from motion_jax.models.tmr.space import Space, embed_motion, embed_text, make_space, make_teacher, teacher_shapes
  from motion_jax.models.tmr.stages import contrastive_stage, tmr_stage

__all__ = ["Space", "as_seen", "contrastive_stage", "embed_motion", "embed_text", "frame_features", "info_nce",
           "make_space", "make_teacher", "motion_side", "plain_stats", "symmetric_cross_entropy", "teacher_shapes",
           "tmr_stage", "tmr_terms", "unit", "view_of"]

__getattr__, __dir__ = lazy.attach(__name__)
