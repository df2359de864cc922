"""Mirror a motion and its captions: left becomes right, clockwise becomes counterclockwise."""
import re

from motion_jax.data.clip import Clip
from motion_jax.motion.retarget import mirror as mirror_joints

# Words after "right" or "left" that mean no side: right away, a right angle; left the room, left behind.
_NO_SIDE = {
    "right": r"away|after|afterwards|before|now|then|here|there|next\s+to|in\s+front|angles?|as|when|where|back\s+to",
    "left": r"the|behind|alone|over\s+from"}
_PARTS_OF_A_SIDE = r"(?:hand|foot|feet|arm|leg|side|knee|elbow|shoulder|hip)s?"
_SIDE = (rf"(?P<side>left|right)(?P<rest>wards?|most|[-\s]?handed|[-\s]?footed|[-\s]?sided?|{_PARTS_OF_A_SIDE}|(?=-)|)"
         r"(?![\w'])")
_TURN = r"(?P<turn>(?:counter|anti)[-\s]?clockwise|clockwise)"
_WORD = re.compile(rf"(?<![\w-]){_TURN}(?!\w)|(?<!\w){_SIDE}", re.IGNORECASE)
# A side of the lower body, or of an action of one leg.
_LEG = re.compile(
    r"(?<![\w-])(?:left|right)[-\s]*(?:foot(?:ed)?|feet|leg(?:s|ged)?|knees?|heels?|toes?|ankles?|kicks?)(?![-\w])",
    re.IGNORECASE)
_ALL_RIGHT = re.compile(r"\ball\s+$", re.IGNORECASE)
_WHOSE = re.compile(r"\b(?:the|his|her|their|its)\s+$", re.IGNORECASE)
# Words before "right" that make it a side although then, before, now or the like follows.
_BY_WAY = re.compile(r"\b(?:to|from|towards?)\s+$", re.IGNORECASE)
_CHANGES_SIDE = re.compile(
    r"\b(?:turn|veer|lean|pivot|rotat|swerv|curv|tilt|twist|sway|step|sidestep|shuffl|shift|straf|dodg)"
    r"(?:e|es|s|ed|ing|ping|ped)?\s+(?:\w+ly\s+|hard\s+|back\s+)?$", re.IGNORECASE)
_MOVES = re.compile(
    r"\b(?:walk|runn?|jog|mov|go|jump|hopp?|march|stumbl|slid|lung|punch|jabb?|kick|swing|look|glanc|fac|point|"
    r"bend|wav|spinn?|roll|reach)(?:e|es|s|d|ed|ing)?\s+(?:\w+ly\s+|hard\s+|back\s+)?$", re.IGNORECASE)
_BESIDE_A_SIDE = re.compile(r"\b(?:left|right)\s+(?:and|or)\s+$", re.IGNORECASE)
_OTHER_SIDE_BEFORE = re.compile(
    r"\b(?:left|right)(?:\s*,)?(?:\s+(?:and|or|then))*\s+$|\b(?:left|right)\b[^.;]*\bthen\s+$", re.IGNORECASE)
_OTHER_SIDE_AFTER = re.compile(r"\s+then\s+(?:(?:back|to|the|his|her|their|again)\s+)*(?:left|right)\b", re.IGNORECASE)
_IN_TIME = re.compile(r"\s+(?:then|now|here|there|before|after|afterwards|as|when|where)(?!\w)", re.IGNORECASE)
_THEN = re.compile(r"\s+then(?!\w)", re.IGNORECASE)
_LAST = re.compile(r"\s+(?:then|now|after|afterwards)\s*(?:[.,;!?]|$)", re.IGNORECASE)


def mirror_caption(text) -> str:
  """Exchanges left with right and clockwise with counterclockwise, keeping capitals.

  Whole words only, with their compounds (leftward, left-handed, righthand, right-most): "upright" stays. "right" before
  away, after, before, now, then, here, angle and the like is no side ("right then he sits"), unless its context makes
  it one: an article, "to", a verb of moving to a side ("turns right before sitting"), or another side next to it ("left
  then right then left"). "left" before the, behind, alone is no side either: "left the room" stays, but so does "turns
  left the second time". After two mirrors, anticlockwise is counterclockwise.
  """
  def swap(match):
    if match["turn"]:
      return _like(match["turn"], "counterclockwise" if match["turn"].lower() == "clockwise" else "clockwise")
    side = match["side"].lower()
    after, before = text[match.end():], text[:match.start()]
    if not match["rest"] and re.match(rf"\s+(?:{_NO_SIDE[side]})(?!\w)", after, re.IGNORECASE):
      # "to the right in front of": an article makes it a side, unless an angle follows.
      angle = re.match(r"\s+angle", after, re.IGNORECASE)
      if angle or not (_WHOSE.search(before) or side == "right" and _is_side(before, after)):
        return match[0]
    if side == "right" and _ALL_RIGHT.search(before):
      return match[0]
    return _like(match["side"], "left" if side == "right" else "right") + match["rest"]
  return _WORD.sub(swap, text)


def _is_side(before, after):
  """Whether a "right" between these words is a side although then, before, now or the like follows."""
  if _BY_WAY.search(before) or _BESIDE_A_SIDE.search(before):
    return True
  if not _IN_TIME.match(after):  # right away, in front of, next to
    return False
  if _CHANGES_SIDE.search(before) or _OTHER_SIDE_AFTER.match(after):
    return True
  if _THEN.match(after) and _MOVES.search(before):
    return True
  return bool(_OTHER_SIDE_BEFORE.search(before) and (_THEN.match(after) or _LAST.match(after)))


def mirror_legs(text) -> str:
  """Exchanges left with right of legs only: a left foot, right-legged, a left kick. Hands and directions stay."""
  return _LEG.sub(lambda match: mirror_caption(match[0]), text)


def mirror_clip(clip) -> Clip:
  """The mirrored clip, with id "M" + id and mirrored captions, without features."""
  captions = tuple(_with_text(caption, mirror_caption(caption.text)) for caption in clip.captions)
  meta = {key: value for key, value in clip.meta.items() if key != "tokens"}
  if "spans" in meta:
    meta["spans"] = tuple((mirror_caption(text), first, past) for text, first, past in meta["spans"])
  return clip.replace(joints=mirror_joints(clip.joints, clip.skeleton), captions=captions, id="M" + clip.id,
                      features=None, meta=meta)


def _with_text(caption, text):
  return type(caption)(text, caption.start, caption.end)


def _like(old, new):
  """new with the capitalization of old."""
  return new.upper() if old.isupper() else new.capitalize() if old[:1].isupper() else new
