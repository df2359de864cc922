"""Hand poses and gestures from the words of an action: "holds the arms out to the sides", "puts a hand on the hip"."""
from collections.abc import Sequence
from typing import Any, NamedTuple

from motion_jax_studio.language import lexicon
from motion_jax_studio.language.words import has_phrase, lookup, normalize, until

_BOTH = ("left", "right")
_WHOSE = lexicon.POSSESSIVES | {"of", "the", "both", "a", "an", "one"}
_LIMBS = {limb + ending for limb in ("arm", "hand", "palm") for ending in ("", "s")}
_PARTICLES = {"up", "out", "down", "back", "together", "forward", "forwards"}  # "puts up a hand"
_OUTWARD = {"up", "out", "forward", "forwards", "above", "over", "overhead"}   # after "reaches"
_ENDS = {",", "and", "then", "while", "as", "with", "before", "after"}  # end the words about a limb
_GOES_ON = {"up", "down", "back", "forth"}  # after "and": "up and down"

# (place, phrases about a hand); the first match counts. "" is no place: the hands move, hang, or are on things. "out"
# depends on the number of hands (`_resolved`). "@" stands for any word of _AT.
_AT = set("to at on onto near by against around toward towards over behind in front top".split())
_LEVELS = ("level", "height")  # "at chest level" is before the body, not at the chest
_PLACES = (
    ("", "up and down, and back, back and forth, bent, dangling, hanging, moving, waving, flapping, swinging, pumping, "
         "backward, backwards, floor, ground, zombie"),
    ("shoulder", "on shoulder, on shoulders, to shoulder, to shoulders"),
    ("up", "above head, over head, overhead"),
    ("crossed", "cross*, fold*"),
    ("face", "@ face, @ mouth, @ nose, @ chin, @ eye, @ eyes, @ lips, @ cheek, @ cheeks"),
    ("ear", "@ ear, @ ears"),
    ("head", "@ head, @ forehead, @ temple, @ temples"),
    ("hips", "@ hip, @ hips, @ waist"),
    ("knees", "@ knee, @ knees, @ thigh, @ thighs, @ lap"),
    ("back", "@ back"),
    ("stomach", "@ stomach, @ belly, @ abdomen"),
    ("together", "together, clasp*"),
    ("chest", "@ chest, @ heart"),
    ("front", "front"),
    ("side", "sideways, horizontally, apart, wide, shoulder-level, shoulder-height, raised aside"),
    ("down", "at side, at sides, to side, to sides, by side, by sides"),
    ("front", "forward, forwards, ahead, level, height"),
    ("down", "down, lower, lowers, drop, drops"),
    ("out", "out, outward, outwards, outstretched, extended, stretched, spread"),
    ("up", "up, air, high, raised, lifted"),
    ("out", "extend, extends, spreads"))
_ASIDE = ("on side, on sides, to side, to sides, at side, at sides, by side, by sides, to left, to right, on left, "
          "on right")
_RAISED = "out*, stretch*, spread*, rais*, extend*, lift*"  # with these words hands that are _ASIDE are raised

_KEEPS = {"hold", "keep"}  # the hands are in their place from the first frame on
_BRINGS = _KEEPS | set("raise lift stretch extend reach spread lower drop put place bring rest stick take lay return "
                       "cross fold clasp open rub wipe".split())
_RUBS = {"scratch", "rub", "wipe"}
_TOUCHES = {"touch", "cover", "hold", "grab", "clutch"} | _RUBS
_RUBBED = {"head": "ear", "ear": "head", "face": "head", "stomach": "chest", "chest": "stomach"}
_TO_THE_HEAD = (("ear", "to ear, at ear, near ear"),
                ("face", "to mouth, at mouth, to lips, to face, at face, near face"))
_AT_THE_HEAD = {"salute": "head", "drink": "face", "sip": "face", "eat": "face"}
_NO_GESTURE = set("up down behind above head back floor ground stair stairs step steps pose ups punch punches jab jabs "
                  "hook hooks uppercut uppercuts kick kicks blow blows himself herself itself themself themselves "
                  "yourself myself".split()) | (lexicon.LIMBS - {"hand", "hands", "arm", "arms"})
# Circles of whole arms, and of hands in front of the body: the hands pass these places without a stop.
_CIRCLING = {"move", "make", "do", "circle", "rotate", "swing", "spin", "draw", "gesture", "use", "stir"}
_CIRCLES = "circle, circles, circling, circular"
_NO_CIRCLE = lexicon.LIMBS - _LIMBS - {"chest"} | {"around"}
_OF_ARMS = tuple((place, 0.45) for place in ("front", "up", "side", "down"))
_OF_HANDS = tuple((place, 0.3) for place in ("face", "front", "stomach", "chest"))
_BEAT = 0.3


class HandPlace(NamedTuple):
  """A place of `motion_jax.motion.reaching.PLACES`, or a gesture, and the sides of the hands that are brought there."""
  place: str  # "" for a gesture alone
  sides: tuple[str, ...]  # () where the words name none: the hands of the action before, or the right one
  from_start: bool  # the hands are there from the first frame of the action: "stands with the arms out"
  is_whole_action: bool = True  # the action is this pose and nothing else
  gesture: tuple[tuple[str, float], ...] = ()  # successive places, each with the seconds to reach it
  repeats: bool = False  # the gesture is repeated as long as the action lasts
  is_smooth: bool = False  # the hands pass the places of the gesture without a stop
  of_last_hands: bool = False  # of the hands of the last hand pose, if there is one: "lowers them"


# Gestures by verb: the hands, if no side is named; successive places, each with the seconds to reach it; whether these
# are repeated as long as the action lasts.
_THROW, _HIT = (("ear", 0.7), ("front", 0.25), ("down", 0.8)), (("head", 0.6), ("front", 0.25), ("down", 0.8))
_GESTURES = {verb: row for verbs, row in (
    ("throw toss hurl", (("right",), _THROW, False)), ("hit strike slap swat slash", (("right",), _HIT, False)),
    ("point reach grab", (("right",), (("front", 0.8),), False)),
    ("push shove", (_BOTH, (("chest", 0.7), ("front", 0.5)), False)),
    ("pull", (_BOTH, (("front", 0.8), ("stomach", 0.6)), False)),
    ("catch", (_BOTH, (("front", 0.5), ("stomach", 0.5)), False)),
    ("clap", (_BOTH, (("together", _BEAT), ("apart", _BEAT)), True)),
    ("flap", (_BOTH, (("side", _BEAT), ("down", _BEAT)), True))) for verb in verbs.split()}


class Limb(NamedTuple):
  """A limb that words describe: its sides, () if they are not named, and the words before and after it."""
  sides: tuple[str, ...]
  thing: str  # "hands"
  before: tuple[str, ...]
  after: tuple[str, ...]
  start: int
  end: int  # past the words about it
  ends: bool  # whether no words follow these


def limb_at(words: tuple[str, ...], at: int) -> Limb | None:
  """The limb that is named from words[at] on, such as "both outstretched arms"; None if there is none."""
  start, several, how, side = at, False, (), ()
  while at < len(words) and words[at] in _WHOSE:
    several, at = several or words[at] == "both", at + 1
  if words[at:at + 1] == ("outstretched",):
    how, at = ("outstretched",), at + 1
  if at < len(words) and words[at] in _BOTH:
    side, at = (words[at],), at + 1
  if at == len(words) or words[at] not in _LIMBS:
    return None
  after = _until_end(words[at + 1:])
  end = at + 1 + len(after)
  return Limb(
      _BOTH if several or words[at].endswith("s") else side, words[at], how, after, start, end, end == len(words))


def _added_limb(words):
  """The limb that words add to an action: "with the arms out", ", hands on hips", "has a hand raised"."""
  places = (at + 1 for at, word in enumerate((",", *words)) if word in (",", "with", "has", "have", "had"))
  return next((limb for at in places if (limb := limb_at(words, at - 1))), None)


def _place_of(words, sides):
  """The place that words about a hand name; None if they name none."""
  plain = normalize(word for at, word in enumerate(words)
                    if word not in ("each", "both", "either", "opposite") and not (word in _BOTH and words[at + 1:]))
  for level in _LEVELS:
    plain = plain.replace(f" {level} ", f"-{level} ").replace(f"-{level} ", f"-{level} {level} ")
  at_a_part = normalize("@" if word in _AT else word for word in plain.replace("top of", "on").replace(
      "front of", "on").split())
  aside = " raised aside " if has_phrase(plain, _ASIDE) and has_phrase(plain, _RAISED) else ""
  place = lookup(_PLACES, plain + at_a_part + aside)
  return "front" if place == "out" and plain.startswith(" reach") else _resolved(place or None, sides)


def _resolved(place, sides):
  """The place, with "out" as "side" for both hands and as "front" for one; without named sides it stays "out"."""
  return place if place != "out" or not sides else "side" if len(sides) == 2 else "front"


def _brought(words, sides, from_start=False, is_whole_action=True):
  """The hand pose that words give to the hands of these sides, () if they are not named; None without a place."""
  place = _place_of(tuple(words), sides)
  # A standing body does not reach its knees, so the model has to sample that action.
  return place and HandPlace(place, sides, from_start, is_whole_action and place != "knees")


def hand_place_of(verb: str, part: str, sides: tuple[str, ...], times: int, words: tuple[str, ...]
                  ) -> HandPlace | None:
  """The hand pose or gesture of an action; None if its words (tokens) name none. sides: the arms that it names."""
  if has_phrase(normalize(words[:6]), "t pose, t-pose"):
    return HandPlace("side", _BOTH, True, verb not in _BRINGS)
  start = next((at for at, word in enumerate(words) if not word.endswith("ly")), 0)
  rest = words[start + 1:]
  if verb in _BRINGS and (place := _hands_brought(verb, words[start:start + 1], rest, sides)):
    return place
  hand = sides or ("right",)
  if verb in _TOUCHES and (place := _brought(("to", *_thing(rest)), hand)):
    rubbed = _RUBBED.get(place.place) if verb in _RUBS else None
    return place._replace(gesture=((place.place, _BEAT), (rubbed, _BEAT)), repeats=True) if rubbed else place
  if verb in _AT_THE_HEAD:
    return HandPlace(_AT_THE_HEAD[verb], hand, False)
  if gesture := _gesture_of(verb, part, sides, times, words):
    return gesture
  limb = _added_limb(words) if part != "arms" else None
  kept = limb and _brought((*limb.before, *limb.after), limb.sides or ("right",), True,
                           not verb and limb.start == 0 and limb.ends)  # "hands on hips"
  return None if not kept or kept.place == "down" else kept  # "down": the arms hang and swing as they are sampled


def _hands_brought(verb, form, rest, sides):
  """The hand pose of an action that moves the hands. form: (its verb as written,); rest: the words after it."""
  particle = rest[:1] if rest and rest[0] in _PARTICLES else ()
  if limb := limb_at(rest, len(particle)):
    return _brought((*form, *limb.before, *particle, *limb.after), limb.sides, verb in _KEEPS, limb.ends)
  if verb == "reach" and rest and rest[0] in _OUTWARD:
    return _brought(("reaches", *_until_end(rest)), sides or ("right",), is_whole_action=False)
  if rest[:1] in (("it",), ("them",)) or {"again", "back", "down"}.issuperset(rest):
    after = rest if rest[:1] not in (("it",), ("them",)) else rest[1:] if rest[0] == "them" else ()
    place = _brought((*form, *_until_end(after)), (), is_whole_action=_until_end(after) == after)
    if place:
      return place._replace(of_last_hands=True)
  place = lookup(_TO_THE_HEAD, normalize(rest))
  return place and HandPlace(place, sides or ("right",), False, is_whole_action=False)


def _until_end(words):
  """The words up to the first that begins another part of the sentence: "up" of "up and then bows"."""
  return next((words[:at] for at, word in enumerate(words) if word in _ENDS and not (
      word == "and" and words[at + 1:at + 2] and words[at + 1] in _GOES_ON)), words)


def _thing(words):
  """The single word that is touched: ("head",) of "the right side of his head or neck with a hand"; () for others."""
  thing = normalize(until((".", *words), {"with", "or"})[1:])
  thing = thing.replace(" left side of ", " ").replace(" right side of ", " ")
  return tuple(thing.split()) if len(thing.split()) == 1 else ()


def _gesture_of(verb, part, sides, times, words):
  """The gesture of an action of the arms, None of other actions."""
  limb = next((word.removesuffix("s") for word in words if word.removesuffix("s") in ("arm", "hand", "forearm")), "")
  text = normalize(words)
  if limb and verb in _CIRCLING and has_phrase(text, _CIRCLES) and _NO_CIRCLE.isdisjoint(words):
    places = _OF_ARMS if limb == "arm" else _OF_HANDS
    places = places[::-1] if has_phrase(text, "backward, backwards, reverse") else places
    return HandPlace("", sides or ("right",), False, gesture=places * times, repeats=times == 1, is_smooth=True)
  if part != "arms" or verb not in _GESTURES or not _NO_GESTURE.isdisjoint(until(words, {"with"})):
    return None
  hands, places, repeats = _GESTURES[verb]
  gesture = places * times + (("down", 0.8),) * (repeats and times > 1)
  return HandPlace("", hands if repeats else sides or hands, False, gesture=gesture, repeats=repeats and times == 1)


def without_hands(text: str) -> str:
  """The text without the hand pose that it adds to its action: "walks" of "walks with the arms out"."""
  words = text.replace(",", " , ").split()
  lower = tuple(word.lower().strip(".;:!?") for word in words)
  limb = _added_limb(lower)
  if not limb or lower[max(limb.start - 1, 0)] in ("has", "have", "had") or (
      not _brought((*limb.before, *limb.after), limb.sides)):
    return text
  rest = [*words[:max(limb.start - 1, 0)], *words[limb.end:]]
  return " ".join(rest).replace(" ,", ",") if len(rest) > 2 else text


def places_of(segments: Sequence[Any]) -> list[dict[int, HandPlace]]:
  """{index of the action: hand pose} of each segment, without poses of hands that another action of it moves."""
  places: list[dict[int, HandPlace]] = []
  last: tuple[str, ...] | None = None  # hands of the last action of the arms
  for segment in segments:
    placed, busy = {}, set()
    hands = [action.sides for action in segment.actions if action.part == "arms" and action.sides]
    for number, action in enumerate(segment.actions):
      place = action.slots.hands
      if place and (last is not None or not place.of_last_hands):
        sides = place.sides or last or ("right",)
        placed[number] = place._replace(sides=sides, place=_resolved(place.place, sides))
      elif action.part == "arms":
        busy |= set(action.sides or _BOTH)
    places.append({number: place for number, place in placed.items() if busy.isdisjoint(place.sides)})
    last = [*places[-1].values()][-1].sides if places[-1] else hands[-1] if hands else last
  return places


def postures_of(segments: Sequence[Any]) -> dict[tuple[int, int], HandPlace | None]:
  """{(segment, action): hand pose} of the actions that are only a posture, by their indices; None stands for a lean."""
  postures = {(at, number): place for at, places in enumerate(places_of(segments)) for number, place in places.items()
              if place.is_whole_action and (place.is_smooth or segments[at].actions[number].part == "arms" or not (
                  segments[at].actions[number].verb))}
  return postures | {(at, number): None for at, segment in enumerate(segments)
                     for number, action in enumerate(segment.actions) if action.slots.lean}
