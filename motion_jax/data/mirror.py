"""The same motion in a mirror, with a caption that says so: left becomes right, clockwise counterclockwise."""
import re

from motion_jax.data.clip import Clip
from motion_jax.motion.retarget import mirror as mirror_joints

# What follows when "right" or "left" is no side: right away, a right angle; left the room, left behind.
_NO_SIDE = {
    "right": r"away|after|afterwards|before|now|then|here|there|next\s+to|in\s+front|angles?|as|when|where|back\s+to",
    "left": r"the|behind|alone|over\s+from"}
_SIDE = (r"(?P<side>left|right)(?P<rest>wards?|most|[-\s]?handed|[-\s]?footed|[-\s]?sided?|(?=-)|)"
         r"(?![\w'])")
_TURN = r"(?P<turn>(?:counter|anti)[-\s]?clockwise|clockwise)"
_WORD = re.compile(rf"(?<![\w-]){_TURN}(?!\w)|(?<!\w){_SIDE}", re.IGNORECASE)
# A side of the body's lower half, and of what one leg does.
_LEG = re.compile(
    r"(?<![\w-])(?:left|right)[-\s]+(?:foot(?:ed)?|feet|leg(?:s|ged)?|knees?|heels?|toes?|ankles?|kicks?)(?![-\w])",
    re.IGNORECASE)
_ALL_RIGHT = re.compile(r"\ball\s+$", re.IGNORECASE)


def mirror_caption(text) -> str:
  """Exchanges left with right and clockwise with counterclockwise, keeping capitals.

  Whole words only, with their compounds (leftward, left-handed, right-most): "upright" stays. "right" before away,
  after, before, now, here, there, angle and the like, and "left" before the, behind, alone are taken for no side and
  stay, so "left the room" is kept, at the price of a caption like "turns left the second time". Anticlockwise comes
  back from two mirrors as counterclockwise.
  """
  def swap(match):
    if match["turn"]:
      return _like(match["turn"], "counterclockwise" if match["turn"].lower() == "clockwise" else "clockwise")
    side = match["side"].lower()
    after, before = text[match.end():], text[:match.start()]
    if not match["rest"] and re.match(rf"\s+(?:{_NO_SIDE[side]})(?!\w)", after, re.IGNORECASE):
      # "to the right in front of": an article makes it a side, unless an angle follows.
      if not re.search(r"\b(?:the|his|her|their|its)\s+$", before, re.IGNORECASE) or re.match(r"\s+angle", after):
        return match[0]
    if side == "right" and _ALL_RIGHT.search(before):
      return match[0]
    return _like(match["side"], "left" if side == "right" else "right") + match["rest"]
  return _WORD.sub(swap, text)


def mirror_legs(text) -> str:
  """Exchanges left with right where they say which leg: a left foot, right-legged, a left kick. Hands and ways stay."""
  return _LEG.sub(lambda match: mirror_caption(match[0]), text)


def mirror_clip(clip) -> Clip:
  """The clip in a mirror, named "M" + id, with mirrored captions; features, if any, are to be made anew."""
  captions = tuple(_with_text(caption, mirror_caption(caption.text)) for caption in clip.captions)
  meta = {key: value for key, value in clip.meta.items() if key != "tokens"}
  if "spans" in meta:
    meta["spans"] = tuple((mirror_caption(text), first, past) for text, first, past in meta["spans"])
  return clip.replace(joints=mirror_joints(clip.joints, clip.skeleton), captions=captions, id="M" + clip.id,
                      features=None, meta=meta)


def _with_text(caption, text):
  return type(caption)(text, caption.start, caption.end)


def _like(old, new):
  """new with the capitals of old."""
  return new.upper() if old.isupper() else new.capitalize() if old[:1].isupper() else new
