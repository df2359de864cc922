"""Where hands are by the words of an action: "holds the arms out to the sides", "puts a hand on the hip"."""
import re
from collections.abc import Sequence
from typing import NamedTuple

from motion_jax.text.morphology import verb_of
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.segments import Action, Segment

_WHOSE = r"(?:(?:of|his|her|their|its|the|my|your|our|both|a|an|one) )*"
_LIMB = rf"(?P<whose>{_WHOSE})(?P<how>outstretched )?(?:(?P<side>left|right) )?(?P<limb>arm|hand|palm)(?P<several>s?)\b"
_VERB = r"^(?:[a-z]+ly )*(?P<verb>[a-z']+)"
_MOVED = re.compile(rf"{_VERB} (?P<before>(?:(?:up|out|down|back|together|forwards?) )?){_LIMB}(?P<after>.*)")
_BESIDE = re.compile(rf"(?:^|\bwith |\bha(?:s|ve|d) |, ){_LIMB}(?P<after>.*)")
# Of the hands of the action before: "lowers them to the hips", "lowers again".
_AGAIN = re.compile(rf"{_VERB}(?: it\b| them\b(?P<after>.*)|(?P<alone>(?: back| down| again)*)$)")
_REACHED = re.compile(rf"{_VERB} (?P<after>(?:up|out|forwards?|above|over|overhead|in front)\b.*)")
_TOUCHED = re.compile(rf"{_VERB} (?:(?:his|her|their|its|the) )?(?:(?:left|right) side of (?:his|her|their|the) )?"
                      r"(?P<thing>\w+)(?: or (?:\w+ )?\w+)?(?: with (?:his |her |their )?.*)?$")
_T_POSE = re.compile(r"(?:[a-z]+ ){0,4}t[- ]pose\b")
_TO_THE_HEAD = re.compile(rf"{_VERB} .*\b(?:to|at|near) (?:(?:his|her|their|the) )?(?P<thing>ear|mouth|face|lips)\b")
_END = re.compile(r",| (?:and(?! (?:up|down|back|forth)\b)|then|while|as|to show|with|before|after) ")

_HIS = r"(?:(?:his|her|their|its|the|each|both|either) )*(?:(?:left|right|opposite) )?"
_AT = rf"\b(?:to|at|on|onto|near|by|against|around|towards?|over|behind|in|front of) (?:top of )?{_HIS}"
_LEVEL = r"\b(?! ?-?(?:level|height|high|length))"
# The place by what is said of a hand, the first that matches; "out" is one for both hands and another for one.
_PLACES = tuple((re.compile(pattern), place) for pattern, place in (
    (r"^(?:lower|drop)s?\b.* from\b", "down"),
    (rf"\b(?:on|to|onto) {_HIS}shoulders?{_LEVEL}", "shoulder"),
    (rf"\b(?:above|over) {_HIS}heads?\b|\boverhead\b", "up"),
    (r"\bcross|\bfold", "crossed"),
    (rf"{_AT}(?:face|mouth|nose|chin|eyes?|lips|cheeks?){_LEVEL}", "face"),
    (rf"{_AT}ears?{_LEVEL}", "ear"),
    (rf"{_AT}(?:head|forehead|temples?){_LEVEL}", "head"),
    (rf"{_AT}(?:hips?|waist){_LEVEL}", "hips"),
    (rf"{_AT}(?:knees?|thighs?|lap){_LEVEL}", "knees"),
    (rf"{_AT}back\b", "back"),
    (rf"{_AT}(?:stomach|belly|abdomen){_LEVEL}", "stomach"),
    (r"\btogether\b|\bclasp", "together"),
    (rf"{_AT}(?:chest|heart){_LEVEL}", "chest"),
    (r"\bfront\b", "front"),
    (rf"\b(?:sideways|horizontally|apart|wide)\b|\bshoulder[ -](?:level|height)\b|\blevel with {_HIS}shoulders\b|"
     rf"\b(?:out|stretch|spread|rais|extend|lift)\w*(?: \w+)? (?:on|to|at|by) "
     rf"(?:{_HIS}sides?|(?:the |his |her )?(?:left|right))\b", "side"),
    (rf"\b(?:at|to|by|beside) {_HIS}sides?\b", "down"),
    (r"\bforwards?\b|\bahead\b|\bbefore (?:him|her|them|it)|\b\w+[ -](?:level|height)\b", "front"),
    (r"\bdown\b|^(?:lower|drop)", "down"),
    (r"\bout(?:wards?|stretched)?\b|\bextended\b|\bstretched\b|\bspread\b", "out"),
    (r"\bup\b|\bair\b|\bhigh\b|\braised\b|\blifted\b", "up"), (r"^(?:extend|spread)", "out")))
# Hands that move, hang, or are on things are in no place: "with the arms swinging in front of him".
_MOVES = re.compile(r"\bup and down\b|\bdown and up\b|\band back\b|\bback and forth\b|\b(?:bent|dangling|hanging|"
                    r"moving|waving|flapping|swinging|clapping|shaking|spinning|pushing|pumping|circling|rotating|"
                    r"backwards?|pockets?|floor|ground|prayer|zombie)\b")
# Actions in which hands carry the body.
_CARRY = re.compile(r"\b(?:push[- ]?ups?|crawl\w*|planks?|handstands?|cartwheels?)\b")

_KEEPS = {"hold", "keep"}  # hands that are in their place from the first moment on
_BRINGS = _KEEPS | set("raise lift stretch extend reach spread lower drop put place bring rest stick take lay return "
                       "cross fold clasp open rub wipe".split())
_RUBS = {"scratch", "rub", "wipe"}
_TOUCHES = {"touch", "cover", "hold", "grab", "clutch"} | _RUBS
_RUBBED = {"head": "ear", "ear": "head", "face": "head", "stomach": "chest", "chest": "stomach"}
_AT_THE_HEAD = {"salute": "head", "drink": "face", "sip": "face", "eat": "face"}
# Places in a row, each with the seconds in which it is reached, for gestures of one hand and of both.
_BEAT = 0.3
_ONE_HAND = dict.fromkeys(("throw", "toss", "hurl"), (("ear", 0.7), ("front", 0.25), ("down", 0.8))) | dict.fromkeys(
    ("hit", "strike", "slap", "swat", "slash"), (("head", 0.6), ("front", 0.25), ("down", 0.8))) | dict.fromkeys(
    ("point", "reach", "grab"), (("front", 0.8),))
_NO_GESTURE = re.compile(r"\b(?:\w+sel(?:f|ves)|(?:punch|jab|hook|uppercut|kick|blow)(?:e?s)?|ups|floor|ground|stairs?|"
                         r"steps?|pose|up|down|behind|above|head|back|"
                         rf"{'|'.join(sorted(lexicon.LIMBS - {'hand', 'hands', 'arm', 'arms'}))})\b")
_BOTH_HANDS = dict.fromkeys(("push", "shove"), (("chest", 0.7), ("front", 0.5))) | {
    "pull": (("front", 0.8), ("stomach", 0.6)), "catch": (("front", 0.5), ("stomach", 0.5))}
_AGAIN_AND_AGAIN = {"clap": (("together", _BEAT), ("apart", _BEAT)), "flap": (("side", _BEAT), ("down", _BEAT))}
# Circles of whole arms, and of hands before the body: each place is left on the way to the next one.
_CIRCLES = re.compile(r"\bcirc(?:les?|ling|ular)\b|\brotat\w+ (?:(?:his|her|their|the|both|left|right) )*arms?\b")
_CIRCLING = {"move", "make", "do", "circle", "rotate", "swing", "spin", "draw", "gesture", "use", "stir"}
_NO_CIRCLE = re.compile(r"\b(?:wrists?|shoulders?|elbows?|fingers?|heads?|hips?|legs?|foot|feet|knees?|around)\b")
_OF_ARMS = tuple((place, 0.45) for place in ("front", "up", "side", "down"))
_OF_HANDS = tuple((place, 0.3) for place in ("face", "front", "stomach", "chest"))


class HandPlace(NamedTuple):
  """A place of `motion_jax.motion.reaching.PLACES`, and the sides of the hands that are brought there."""
  place: str
  sides: tuple[str, ...]
  at_once: bool  # the hands are there from the beginning of the action: "stands with the arms out"
  alone: bool = True  # the action says nothing else
  # A gesture: places in a row, each with the seconds in which it is reached; over and over if it is a rhythm.
  gesture: tuple[tuple[str, float], ...] = ()
  rhythm: bool = False
  flows: bool = False  # no place of the gesture is kept for a moment


def hand_place_of(action: Action, before: HandPlace | None = None) -> HandPlace | None:
  """Where an action has hands, None where its words name no place.

  before: the place of an action before it, whose hands are meant by "lowers them".
  """
  words = action.words.lower().replace("’", "'")
  if _CARRY.search(words):
    return None
  if _T_POSE.match(words):
    return HandPlace("side", ("left", "right"), True, alone=action.verb not in _BRINGS)
  brings = action.verb in _BRINGS
  if brings and (found := _MOVED.match(words)):
    sides = _sides(found) or before and before.sides or ("right",)
    return _brought([found["verb"], found["how"], found["before"], _end(found)], sides, action.verb in _KEEPS,
                    found["after"] == _end(found) and not _says_more(found["after"]))
  if action.verb == "reach" and (found := _REACHED.match(words)):
    return _brought(["reaches", _end(found)], action.sides or ("right",), False, False)
  if brings and before and (found := _AGAIN.match(words)):
    after = found["after"] or found["alone"] or ""
    return _brought([found["verb"], _END.split(after, maxsplit=1)[0]], before.sides, False, not _END.search(after))
  if brings and (found := _TO_THE_HEAD.match(words)):
    return _brought(["to the", found["thing"]], action.sides or ("right",), False, False)
  if action.verb in _TOUCHES and (found := _TOUCHED.match(words)):
    touched = _brought(["to the", found["thing"]], action.sides or ("right",), False)
    rubbed = touched and action.verb in _RUBS and _RUBBED.get(touched.place)
    if touched:
      return touched if not rubbed else touched._replace(
          gesture=((touched.place, _BEAT), (rubbed, _BEAT)), rhythm=True)
  if action.verb in _AT_THE_HEAD:
    return HandPlace(_AT_THE_HEAD[action.verb], action.sides or ("right",), False)
  if gesture := _gesture_of(action):
    return gesture
  found = _BESIDE.search(words) if action.part != "arms" else None
  kept = found and _brought([found["how"], _end(found)], _sides(found) or ("right",), True,
                            not action.verb and found.start() == 0 and found["after"] == _end(found))  # "hands on hips"
  return None if kept is None or kept.place == "down" else kept  # beside another action arms hang and swing as they do


def _gesture_of(action):
  """The gesture of an action of the arms, None of other actions."""
  both = ("left", "right")
  words = action.words.lower()
  if action.verb in _CIRCLING and _CIRCLES.search(words) and (
      limb := re.search(r"\b(arm|hand|forearm)(s?)\b", words)) and not _NO_CIRCLE.search(words):
    way = _OF_ARMS if limb[1] == "arm" and not re.search(r"\b(?:small|little|tiny)\b|\bfront\b", words) else _OF_HANDS
    way = way[::-1] if re.search(r"\b(?:backwards?|reverse)\b", words) else way
    sides = action.sides or (both if limb[2] or "circles" in words and limb[1] == "arm" else ("right",))
    return HandPlace("", sides, False, gesture=way * action.times, rhythm=action.times == 1, flows=True)
  words = words.split(" with ")[0]
  if action.part != "arms" or _NO_GESTURE.search(words):
    return None
  if action.verb in _AGAIN_AND_AGAIN:
    rhythm = _AGAIN_AND_AGAIN[action.verb]
    return HandPlace("", both, False, gesture=rhythm * action.times + (("down", 0.8),) * (action.times > 1),
                     rhythm=action.times == 1)
  if action.verb in _ONE_HAND:
    return HandPlace("", action.sides or ("right",), False, gesture=_ONE_HAND[action.verb] * action.times)
  if action.verb in _BOTH_HANDS:
    return HandPlace("", action.sides or both, False, gesture=_BOTH_HANDS[action.verb] * action.times)
  return None


def without_hands(text: str) -> str:
  """A text without what it says of where hands are beside its action: "walks" of "walks with the arms out"."""
  found = _BESIDE.search(text)
  if not found or found[0].startswith("ha") or not _brought([found["how"], _end(found)], _sides(found), True):
    return text
  rest = text[:found.start()] + text[found.start("after") + len(_end(found)):]
  return " ".join(rest.split()) if len(rest.split()) > 2 else text


def _says_more(words):
  """Whether words after a limb have a verb of their own: "has his arms crossed walks forward"."""
  return any(word.endswith("s") and verb_of(word) and word not in lexicon.LIMBS for word in words.split())


def _sides(found):
  """The sides of a match of a limb: the named one, both where there are several, none where it does not say which."""
  several = found["several"] or "both" in found["whose"].split()
  return ("left", "right") if several else tuple(filter(None, [found["side"]]))


def _end(found):
  """What a match says of a limb."""
  return _END.split(found["after"], maxsplit=1)[0]


def _brought(said, sides, at_once, alone=True):
  words = " ".join(" ".join(filter(None, said)).split())
  place = None if _MOVES.search(words) else next((one for pattern, one in _PLACES if pattern.search(words)), None)
  if place == "out":
    place = "side" if len(sides) == 2 and not words.startswith("reach") else "front"
  # A body that only stands does not reach its knees.
  return HandPlace(place, sides, at_once, alone=alone and place != "knees") if place else None


def places_of(segments: Sequence[Segment]) -> list[list[tuple[Action, HandPlace]]]:
  """Where the actions of each of some segments have hands; hands that another action of a segment moves have none."""
  found: list[list[tuple[Action, HandPlace]]] = []
  before = None
  for segment in segments:
    own, busy = [], set()
    for action in (segment.action, *segment.simultaneous):
      place = hand_place_of(action, before)
      if place:
        own.append((action, place))
      elif action.part == "arms":
        busy |= set(action.sides or ("left", "right"))
    found.append([one for one in own if busy.isdisjoint(one[1].sides)])
    hands = [one for one in (segment.action, *segment.simultaneous) if one.part == "arms" and one.sides]
    before = found[-1][-1][1] if found[-1] else HandPlace("", hands[-1].sides, False) if hands else before
  return found
