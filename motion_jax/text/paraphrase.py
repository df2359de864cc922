"""Paraphrase captions as people would type them.

Captions of archives come from a few templates; a generator trained on these alone does not follow "strolls to the left
and comes back". `data.paraphrases` of a config adds paraphrases to the captions of each training clip
(docs/captions.md#paraphrases).
"""
import re
import zlib

import numpy as np

from motion_jax.text.captions import SUBJECTS
from motion_jax.text.morphology import present_participle, verb_of

_CHANCE = 0.6  # probability of replacing a phrase
_SIDE = "(left|right)"
_LIMB = "(hand|arm|fist|leg|foot)"

# (phrase, replacements); \1 and \2 are the side and the limb. Replacements that state a manner, such as "strolls", are
# used only for phrases that state it, too.
_RULES = tuple((re.compile(rf"\b{said}(?!\w)"), tuple(others.split("|"))) for said, others in (
    # ways over the ground
    ("walks (?:forward|ahead) slowly", r"strolls forward|slowly walks forward|ambles along|takes slow steps forward"),
    ("walks (?:forward|ahead) quickly", r"strides forward|quickly walks forward|walks fast|hurries forward"),
    ("walks (?:straight ahead|forward in a straight line)", r"walks straight|walks in a straight line|moves forward"),
    ("walks (?:forward|ahead)", r"steps forward|moves forward|walks forwards|goes forward|walks|walks along"),
    ("takes several steps forward", r"walks forward|takes a few steps|takes a few steps forward|steps forward"),
    ("walks backward slowly", r"slowly walks backwards|backs up slowly|takes slow steps back"),
    ("walks backward", r"walks backwards|backs up|steps back|moves backward|walks in reverse|takes steps backward"),
    ("runs (?:forward|ahead)", r"jogs forward|runs|jogs|runs straight|is running|jogs along"),
    (f"sideways to the {_SIDE}", r"sideways \1|to the \1 sideways|to their \1 side|to the \1 side"),
    (f"steps to the {_SIDE} side", r"steps to their \1|sidesteps \1|moves to the \1 side|slides to the \1"),
    ("diagonally forward", r"diagonally|at an angle"),
    # paths and turns
    (f"in a circle to the {_SIDE}", r"around in a circle to the \1|in a \1 circle|in a circle turning \1|circling \1"),
    ("in a counterclockwise circle", r"in a counter-clockwise circle|in a circle counterclockwise|counterclockwise"),
    ("in a clockwise circle", r"in a circle clockwise|clockwise in a circle|clockwise"),
    ("(?<!around )in a circle(?! to|,? turn)", r"around in a circle|in circles|in a full circle"),
    (f"(?:forward |ahead )?(?:in a half circle|in a u-turn) to the {_SIDE}", r"in a semicircle to the \1|"
     r", turns around to the \1 and goes back|, then turns \1 and returns|, turns to the \1 and comes back|"
     r", then turns and walks back|, turns around and comes back"),
    (f"and (?:makes a u-turn|turns around) to the {_SIDE}", r"and turns around \1, then comes back|then turns around "
     r"to their \1|, makes a 180 degree turn to the \1 and heads back|then turns back around to the \1|"
     r"then turns and walks back|, turns around, and walks back|then turns around and comes back"),
    ("and turns around(?! to)", r"then turns back|, turns around and goes back|and comes back|"
     r"then turns and walks back|then turns around, and returns to where they started|, spins around and walks back"),
    (f"and curves to the {_SIDE}", r"while turning \1|and turns \1|veering to the \1|then veers \1|and curves \1"),
    (f"(?:in a curve|in an arc|along a curved path) to the {_SIDE}", r"curving to the \1|in a \1 curve|"
     r"while turning to the \1|and turns to the \1|around a bend to the \1"),
    ("in a zigzag(?: line)?", r"in a zig zag|from side to side|in an s shape"),
    (f"(?:turns around|turns 180 degrees) to the {_SIDE}(?:,? and then|, then| then|, and after that|,? and finally) "
     "walks (?:forward|ahead|straight ahead)", r"turns \1 and walks back|turns around \1 and walks back|"
     r"turns around to the \1 and walks back to where they started|does a 180 to the \1 and comes back|"
     r"turns and walks back|turns around and walks back|spins around and walks back"),
    (f"turns around to the {_SIDE}", r"turns around \1|does a 180 to the \1|turns to face the other way over their \1"),
    (f"turns to the {_SIDE}", r"turns \1|makes a \1 turn|takes a \1 turn|rotates to the \1|pivots \1"),
    (f"turns {_SIDE}", r"turns to the \1|makes a \1|takes a turn to the \1|goes \1"),
    # what limbs do
    (f"raises the {_SIDE} {_LIMB}", r"lifts their \1 \2|puts their \1 \2 up|holds up their \1 \2|raises \1 \2|"
     r"raises \1 \2 up in the air|brings up their \1 \2|reaches up with the \1 \2"),
    ("raises both (hand|arm)s", r"lifts both \1s|puts their \1s up|raises their \1s|holds both \1s in the air|"
     r"brings both \1s up above their head"),
    (f"waves (?:with )?the {_SIDE} {_LIMB}", r"waves their \1 \2|waves hello with the \1 \2|waves using their \1 \2|"
     r"is waving with their \1 \2|greets someone with a wave of the \1 \2"),
    ("waves(?: with)? both (hand|arm)s", r"waves with their \1s|waves both of their \1s|waves their \1s"),
    (f"kicks with the {_SIDE} {_LIMB}", r"kicks their \1 \2|kicks with their \1 \2|kicks out with the \1 \2|"
     r"does a \1 \2 kick|gives a kick with \1 \2"),
    (f"punches with the {_SIDE} {_LIMB}", r"throws a \1 punch|punches with their \1 \2|strikes out with the \1 \2|"
     r"hits something with their \1 \2|jabs with the \1 \2|throws a punch with the \1 \2"),
    (f"with the {_SIDE} {_LIMB}", r"with their \1 \2|with \1 \2|using the \1 \2|using their \1 \2"),
    (f"the {_SIDE} {_LIMB}", r"their \1 \2|\1 \2"),
    # the rest of the body
    ("jumps(?: up)?(?! about| far| \\w+ward)", r"jumps up|leaps|jumps in the air|hops"),
    ("does a squat", r"squats|squats down|crouches down and gets back up|performs a squat"),
    ("squats down and gets up", r"squats and stands back up|crouches down, then stands|does a squat|squats down"),
    ("takes a seat", r"sits down|sits|sits down on a chair|lowers into a seat"),
    ("sits down", r"takes a seat|sits|sits on a chair|sits down on something"),
    ("stands up(?: from a chair)?", r"gets up|rises from the chair|stands|stands up from a seat|gets up from sitting"),
    ("bows", r"takes a bow|bends forward|bends at the waist|bows down|bends over"),
    ("stands still", r"stands in place|does not move|stays in place|is standing|stands there"),
    ("stops and stands still", r"stops|abruptly stops|comes to a halt|stops walking"),
    ("comes to a stop", r"stops|halts|stops walking|stands still"),
    # manners
    ("in a masculine way", r"like a man|in a manly way"), ("in a feminine way", r"like a woman|in a womanly way"),
    ("like an elderly person", r"like an old man|like someone old|like an old person"),
    ("in exhaustion", r"tiredly|as if exhausted|like they are tired"), ("happily", r"cheerfully|joyfully"),
    ("proudly", r"with pride|confidently"), ("like a heavy giant", r"heavily|like a giant"),
    ("energetically", r"with energy|lively"), ("sadly", r"in a sad way|as if sad"),
    # how and how often
    ("slowly", r"at a slow pace|in a slow manner|slow"),
    ("quickly", r"fast|at a fast pace|rapidly|briskly"),
    ("twice", r"two times|2 times"),
    ("three times", r"3 times|thrice"),
    ("once", r"one time"),
    # one after the other
)) + ((re.compile(r",?(?: and)? (?:then|finally)(?!\w)"), (", then", " then", " and then", " and", ",", ", and then",
                                                           ", and", " before they")),)
_SUBJECT = re.compile(rf"^(?:{'|'.join(SUBJECTS)})\s+", re.IGNORECASE)
_WHO = (*SUBJECTS, "person", "man", "the figure", "a human being", "this person", "a guy")
_VERB = re.compile(r"^(?!is\b)\w+s\b")


def paraphrases(caption: str, number: int) -> tuple[str, ...]:
  """Up to `number` different paraphrases of a caption; () if there are none.

  A pure function of the caption. `data.mirror.mirror_caption` can exchange the sides in them; only the side of a turn
  before a way back may be omitted, as is common.
  """
  rng = np.random.default_rng(zlib.crc32(caption.encode()))
  texts = dict.fromkeys(_paraphrase(caption, rng) for _ in range(number))
  return tuple(text for text in texts if text != caption)


def _paraphrase(caption, rng):
  subject = _SUBJECT.match(caption)
  text, put = caption[subject.end():] if subject else caption, []

  def other(match, others):
    if rng.random() > _CHANCE:
      return match[0]
    put.append(match.expand(others[rng.integers(len(others))]))
    return f"\0{len(put) - 1}\0"  # protected from later rules

  for said, others in _RULES:
    text = said.sub(lambda match, others=others: other(match, others), text)
  text = re.sub("\0(\\d+)\0", lambda match: put[int(match[1])], text)
  text = re.sub(r"\s+,", ",", text)
  text = re.sub(r"\b(left|right) before they\b", r"\1, then", text)  # "right before" is no side
  text = re.sub(r"\bbefore they (\w+)", lambda match: "before " + _ing(match[1]), text)
  if not subject:
    return text
  who = _WHO[rng.integers(len(_WHO))] if rng.random() < _CHANCE else subject[0].strip()
  if rng.random() < 0.15 and not re.search(r"[,.]\s*\w|\b(?:and|then|before)\b", text):
    text = _VERB.sub(lambda match: f"is {_ing(match[0])}", text, count=1)
  return f"{who} {text}"


def _ing(verb):
  return present_participle(verb_of(verb) or verb)
