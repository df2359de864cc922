from .batches import CaptionedClips, TextItems, Windows
from .clip import Caption, Clip
from .store import Store, Writer

__all__ = ["Caption", "CaptionedClips", "Clip", "Store", "TextItems", "Windows", "Writer"]
