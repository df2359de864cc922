"""Body parts that act, by the verb and words of an action: part, arms, kept poses of limbs."""
import functools
import re
from collections.abc import Sequence

from motion_jax.text.lexicon import VERBS
from motion_jax.text.morphology import base_form, verb_of
from motion_jax.text.tagger import tag_words
from motion_jax_studio.language import lexicon

# In order of precedence: of simultaneous actions, such as walking and waving, the first part here is the base motion.
PARTS = ("legs", "body", "torso", "arms", "head")
# "with the arms stretched out", ", hands on the hips".
_ADDED = re.compile(r"(?:\bwith|,) ([^,]+?)"
                    r"(?= (?:and|while|as|like|then|with|without|in an? \w+ (?:way|manner|style))\b|,|$)")
_SMALL_WORDS = ("DET", "PRON", "ADP", "NUM", "AUX", "CCONJ")


def part_of(verb: str, words: Sequence[str]) -> str:
  """The body part that acts, one of PARTS, or "" where none is known. verb: a base form; words: all after the verb.

  "legs" for "raises the left knee", "head" for "nods".
  """
  if verb in lexicon.MOVED_BY_OBJECT:
    end = next((i for i, word in enumerate(words) if word in lexicon.AFTER_AN_OBJECT), len(words))
    for part, things in lexicon.BODY_PARTS:
      if any(base_form(word, things) for word in words[:end]):
        return part
  known_part = next((part for part, verbs in VERBS.items() if verb in verbs), "")
  return "legs" if known_part == "gait" else known_part


def is_continuous(verb: str, words: Sequence[str]) -> bool:
  """Whether an action of the legs can last for any time, as walking can and sitting down cannot."""
  return verb in VERBS["gait"] and part_of(verb, words) == "legs" and not (verb == "stand" and "up" in words)


def stays_low(verb: str, part: str, words: Sequence[str]) -> bool:
  """Whether a body that sits, kneels or lies can act without getting up, as arms wave and a head nods."""
  lifts_an_arm = verb == "lift" and any(base_form(word, lexicon.ARM_PARTS) for word in words)  # and not a box
  return part in ("arms", "head") and (lifts_an_arm or verb not in lexicon.FROM_THE_FLOOR)


def held_pose(verb: str, part: str) -> str | None:
  """The pose to hold after an action: "low" (pelvis), "arms" (raised), "leg" (lifted); None for its last frame."""
  return "low" if verb in lexicon.LOW | {"squat"} else "leg" if verb in ("kick", "balance") else (
      "arms" if part == "arms" else None)


def sides_of(words: Sequence[str]) -> tuple[str, ...]:
  """The arms that words name: ("left",), ("right",), both, or ()."""
  named = [side for side in ("left", "right") for word, thing in zip(words, [*words[1:], ""])
           if word == side and base_form(thing, lexicon.SIDED_ARM_PARTS)]
  both = "both" in words or any(word in ("hands", "arms", "fists", "elbows") for word in words)
  return ("left", "right") if both else tuple(dict.fromkeys(named))


@functools.lru_cache(maxsize=1 << 12)
def limb_postures(text: str) -> frozenset[str]:
  """Words of a limb pose that is kept during an action: {"arm", "stretch", "out"} of "walks with the arms stretched
  out", none of "jumps with both feet"."""
  postures: set[str] = set()
  for words in (match[1].split() for match in _ADDED.finditer(text)):
    kept = [base_form(word, lexicon.BODY) or verb_of(word) or word for (_, tag), word in zip(tag_words(words), words)
            if word not in lexicon.NO_POSTURE and (word in lexicon.DIRECTIONS | {"out"} or tag not in _SMALL_WORDS)]
    postures |= set(kept) if len(kept) > 1 and not lexicon.BODY.isdisjoint(kept[:2]) else set()
  return frozenset(postures)
