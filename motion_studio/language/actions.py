"""Which part of the body an action is about: by its verb, and by what is moved ("raises the left knee", "nods").

The words are those of sentences about movement; the shares by which a verb is said to be of one part are those that
SINC (Athanasiou et al. 2023) counted: walking is of the legs, waving of the arms, bowing of the torso, nodding of the
head.
"""
import re
from collections.abc import Sequence

from motion_jax.text.lexicon import VERBS
from motion_jax.text.morphology import base_form, verb_of  # noqa: F401

# Of two actions at once, the part named first carries the other: whoever walks while waving goes where the walk goes.
PARTS = ("legs", "body", "torso", "arms", "head")

# What is over when it is done, so that who has done it stands there.
_ONCE = set("bow kick turn squat duck raise lift lower throw toss catch pick point salute grab reach hug slap strike "
            "pull push put place drop greet shrug cross".split())
# Behind these a body may stand with an arm or a leg in the air.
_NOT_AT_EASE = {"kick", "raise", "lift", "strike"}
# Behind these a body is low, and stays so when it rests.
LOW = {"sit", "kneel", "crouch", "lie"}
# What arms do with the whole body behind them, down to the floor and up again.
_FROM_THE_FLOOR = {"pick", "place", "drop", "take", "lift"}
RUNS = {"run", "jog", "sprint", "dash"}
RESTS = {"stop", "pause", "wait", "rest", "halt", "freeze"}
# Seconds of one swing, clap or blow of actions that a clip shows many times: to do such a thing twice takes no longer.
_CYCLES = {"wave": 0.8, "clap": 0.6, "nod": 0.8, "shake": 0.6, "punch": 1.0, "jab": 0.8, "stomp": 0.8, "stamp": 0.8}
_ONE_BY_ONE = {"kick", "squat"}
_ONE = r"(?:someone|somebody|he|she|(?:a|an|the|one)(?: (?!and |then |while )[\w'-]+){1,3})"
# Somebody walks, and no word says where.
_NOWHERE = re.compile(rf"(?:{_ONE} (?:(?:walk|run|jog)s|is (?:walking|running|jogging))|(?:they )?(?:walk|run|jog))",
                      re.IGNORECASE)
# Somebody punches, and no word says with which hand.
_PUNCHES = re.compile(rf"({_ONE}) (?:punches(?: forwards?| (?:straight )?ahead| (?:in |into |at )?the air)?|"
                      r"(?:strikes|hits) with (?:the|a|one|his|her|their) fist(?: forwards?| ahead)?)", re.IGNORECASE)
_ARMS = {"arm", "hand", "wrist", "elbow", "fist", "finger", "shoulder"}
_THINGS = (("legs", {"leg", "knee", "foot", "feet", "heel", "toe", "ankle", "thigh"}),
           ("head", {"head", "chin", "neck"}),
           ("torso", {"torso", "hip", "waist", "chest"}),
           ("arms", _ARMS))
# Verbs whose object is what moves; "walks with the hands up" goes on walking.
_OF_ITS_OBJECT = VERBS["arms"] | VERBS["head"] | {
    "turn", "rotate", "spin", "move", "circle", "bend", "tilt", "twist", "bounce", "roll"}


def part_of(verb: str, words: Sequence[str]) -> str:
  """One of PARTS, or "" for a verb that says nothing of a part. verb: a base form; words: all behind the verb."""
  if verb in _OF_ITS_OBJECT:
    thing = next((i for i, word in enumerate(words) if word in ("with", "to", "toward", "towards")), len(words))
    for part, things in _THINGS:
      if any(base_form(word, things) for word in words[:thing]):
        return part
  found = next((part for part, verbs in VERBS.items() if verb in verbs), "")
  return "legs" if found == "gait" else found


def goes_on(verb: str, words: Sequence[str]) -> bool:
  """Whether an action of the legs lasts as long as one likes, as walking does and sitting down does not."""
  return verb in VERBS["gait"] and part_of(verb, words) == "legs" and not (verb == "stand" and "up" in words)


def is_done_once(verb: str) -> bool:
  """Whether an action is over when it is done, and leaves a body standing, as a bow does and walking or sitting do
  not."""
  return verb in _ONCE


def leaves_at_ease(verb: str) -> bool:
  """Whether whoever has done an action that `is_done_once` stands at ease, and can go on standing so."""
  return is_done_once(verb) and verb not in _NOT_AT_EASE


def stays_low(verb: str, part: str, words: Sequence[str]) -> bool:
  """Whether who sits, kneels or lies does it there, as arms wave and a head nods, and does not get up for it."""
  own = verb == "lift" and any(base_form(word, _ARMS) for word in words)  # an arm, but not a box
  return part in ("arms", "head") and (own or verb not in _FROM_THE_FLOOR)


def is_counted_one_by_one(verb: str) -> bool:
  """Whether several of an action are better made one behind the other than by words that count: of 24 kicks and squats
  that were made one by one 12 came out as many as were asked for, by words 4; of 18 jumps and bows none, and 9."""
  return verb in _ONE_BY_ONE


def held_pose(verb: str, part: str) -> str | None:
  """Which pose of an action is held by who "holds it": "low", "arms" or "leg" of `motion.resting.held_frame`; None of
  what is held as it ends."""
  return "low" if verb in LOW | {"squat"} else "leg" if verb in ("kick", "balance") else (
      "arms" if part == "arms" else None)


def cycle_of(verb: str) -> float | None:
  """Seconds of one of the movements that this action is made of, or None where a clip shows it once."""
  return _CYCLES.get(verb)


def sides_of(words: Sequence[str]) -> tuple[str, ...]:
  """("left",), ("right",) or both: the arms that the words are about; () where they do not say."""
  told = [side for side in ("left", "right") for word, thing in zip(words, [*words[1:], ""])
          if word == side and base_form(thing, {"arm", "hand", "wrist", "elbow", "fist"})]
  both = "both" in words or any(word in ("hands", "arms", "fists", "elbows") for word in words)
  return ("left", "right") if both else tuple(dict.fromkeys(told))


def going_forward(prompt: str) -> str:
  """The prompt, with "forward" behind it where it says no more than that somebody walks, runs or jogs.

  Captions by kinematics (`data.describe`) say of all who go forward that they do, and "walks" of those of whom the
  rules could not tell; whoever writes "a person walks" means forward.
  """
  bare = prompt.strip().rstrip(" .!")
  return f"{bare} forward" if _NOWHERE.fullmatch(" ".join(bare.split())) else prompt


def with_one_hand(prompt: str) -> str:
  """The prompt, "a person punches with the left hand" where it says no more than that somebody punches.

  Captions by kinematics (`data.describe`) say of every single punch with which hand; told of none, a network that
  learned them lifts both halfway. The left hand is the one that jabs.
  """
  found = _PUNCHES.fullmatch(" ".join(prompt.strip().rstrip(" .!").split()))
  return f"{found[1]} punches with the left hand" if found else prompt
