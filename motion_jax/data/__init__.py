"""Files to batches: motion capture readers and writers, and the data folders of the field."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.data.batches import CaptionedClips, TextItems, Windows
  from motion_jax.data.clip import Caption, Clip
  from motion_jax.data.store import Store, Writer

__all__ = ["Caption", "CaptionedClips", "Clip", "Store", "TextItems", "Windows", "Writer"]

__getattr__, __dir__ = lazy.attach(__name__)
