from .items import CodeItems, encode_clips, target_row
from .losses import corrupt, gpt_loss
from .sampling import categorical, greedy, sample
from .stages import gpt_shapes, gpt_stage

__all__ = ["CodeItems", "categorical", "corrupt", "encode_clips", "gpt_loss", "gpt_shapes", "gpt_stage", "greedy",
           "sample", "target_row"]
