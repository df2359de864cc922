"""Text encoders: captions to embeddings of words or sentences; and the vocabulary of captions."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.text.bert import Bert
  from motion_jax.text.clip import ClipText
  from motion_jax.text.encoder import TextEncoder, load_text_encoder, shipped_encoders
  from motion_jax.text.mpnet import MPNet
  from motion_jax.text.t5 import T5Encoder
  from motion_jax.text.vocabulary import Vocabulary

__all__ = ["Bert", "ClipText", "MPNet", "T5Encoder", "TextEncoder", "Vocabulary", "load_text_encoder",
           "shipped_encoders"]

__getattr__, __dir__ = lazy.attach(__name__)
