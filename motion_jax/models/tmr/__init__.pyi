from .alignment import as_seen, frame_features, motion_side, plain_stats, view_of
from .losses import info_nce, symmetric_cross_entropy, tmr_terms, unit
from .space import Space, embed_motion, embed_text, make_space, make_teacher, teacher_shapes
from .stages import contrastive_stage, tmr_stage

__all__ = ["Space", "as_seen", "contrastive_stage", "embed_motion", "embed_text", "frame_features", "info_nce",
           "make_space", "make_teacher", "motion_side", "plain_stats", "symmetric_cross_entropy", "teacher_shapes",
           "tmr_stage", "tmr_terms", "unit", "view_of"]
