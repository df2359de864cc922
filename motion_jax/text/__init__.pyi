from .bert import Bert
from .clip import ClipText
from .encoder import TextEncoder, load_text_encoder, shipped_encoders
from .mpnet import MPNet
from .t5 import T5Encoder
from .vocabulary import Vocabulary

__all__ = ["Bert", "ClipText", "MPNet", "T5Encoder", "TextEncoder", "Vocabulary", "load_text_encoder",
           "shipped_encoders"]
