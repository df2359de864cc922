"""English inflection: the base form of a word, and the forms of a verb.

One table of irregular forms and one set of rules for endings serve the tagger of captions, the vocabulary of training
captions and the parser of prompts. Our own because spaCy and NLTK load models or data that they download, and lemmas
and inflected forms must agree.
"""
import functools

from motion_jax.text import wordnet
from motion_jax.text.lexicon import ACTIONS, WORDS_WITHOUT_MOTION

# Base form -> irregular forms. Of a verb: its past tense, then its participles where they differ.
IRREGULAR = {
    "bend": "bent", "blow": "blew blown", "break": "broke broken", "bring": "brought", "catch": "caught",
    "child": "children", "come": "came", "creep": "crept", "deal": "dealt", "do": "did", "draw": "drew drawn",
    "drink": "drank", "drive": "drove driven driving", "eat": "ate eaten", "fall": "fell fallen", "feel": "felt",
    "fight": "fought", "fly": "flew flown", "foot": "feet", "get": "got gotten", "give": "gave given",
    "go": "went gone", "hang": "hung", "hold": "held", "keep": "kept", "kneel": "knelt", "knife": "knives",
    "lay": "laid", "lean": "leant", "leap": "leapt", "lie": "lay lain lying", "lose": "lost", "make": "made",
    "man": "men", "ride": "rode ridden", "rise": "rose risen", "run": "ran", "say": "said", "see": "saw seen",
    "shake": "shook shaken", "shoot": "shot", "sing": "sang sung", "sit": "sat", "sleep": "slept", "slide": "slid",
    "spin": "spun", "spring": "sprang sprung", "stand": "stood", "strike": "struck", "sweep": "swept",
    "swim": "swam swum", "swing": "swung", "take": "took taken", "throw": "threw thrown", "tooth": "teeth",
    "woman": "women", "write": "wrote"}
BASE_OF = {form: base for base, forms in IRREGULAR.items() for form in forms.split()}
PAST_OF = {base: forms.split()[0] for base, forms in IRREGULAR.items()}
# Past tenses that are not read as verbs of movement: more often participles, as in "a ball that is shot".
_PARTICIPLES = {"blew", "brought", "flew", "fought", "sang", "shot", "slid"}
_PASTS = {past: verb for verb, past in PAST_OF.items() if verb in ACTIONS and past not in _PARTICIPLES}
_PASTS["lying"] = "lie"
# Ending, and its replacement in the base form.
_ENDINGS = (("ies", "y"), ("es", ""), ("s", ""), ("ied", "y"), ("ed", ""), ("ed", "e"), ("d", ""), ("ing", ""),
            ("ing", "e"), ("ily", "y"), ("ly", ""), ("ier", "y"), ("er", ""), ("er", "e"), ("iest", "y"), ("est", ""))
_VOWELS = "aeiou"


def base_form(word, known, endings=("ing", "ed", "es", "s")):
  """The base form of a regularly inflected word among known ones, or "": "waving" -> "wave", "hopped" -> "hop"."""
  if word in known:
    return word
  for ending in endings:
    if word.endswith(ending):
      stem = word[:-len(ending)]
      for base in (stem, stem + "e", stem[:-1] if len(stem) > 2 and stem[-1] == stem[-2] else stem,
                   stem[:-1] + "y" if stem.endswith("i") else stem):
        if base in known:
          return base
  return ""


def verb_of(word: str) -> str:
  """The base form of a verb of movement ("waving" -> "wave"), or "" for another word.

  A verb that only WordNet lists is recognized in inflected forms alone: "scampers", not "bolt".
  """
  return _PASTS.get(word) or base_form(word, ACTIONS) or _rare_verb_of(word)


@functools.lru_cache(maxsize=1 << 14)
def _rare_verb_of(word):
  base = "" if word in WORDS_WITHOUT_MOTION else base_form(word, wordnet.verbs())
  return "" if base == word else base


def is_participle(word: str) -> bool:
  """Whether a word is the present participle of a verb of movement: "waving", but not "ring"."""
  return word.endswith("ing") and verb_of(word) not in ("", word)


def is_past(word: str) -> bool:
  """Whether a word is the past tense of a verb of movement, or its past participle: "walked", "sat"."""
  return (word in _PASTS or word.endswith("ed")) and not word.endswith("ing") and verb_of(word) not in ("", word)


@functools.lru_cache(maxsize=1 << 14)
def possible_bases(word):
  """The word and all base forms that its ending allows, to compare words regardless of inflection.

  walking, walked, walks -> walk; ran -> run. Some of them are no words: "walked" -> "walk", "walke".
  """
  bases = {word} if word in IRREGULAR else {word, BASE_OF.get(word, word)}
  for ending, instead in _ENDINGS:
    if word.endswith(ending) and len(word) - len(ending) >= 3:
      stem = word[:len(word) - len(ending)] + instead
      bases.add(stem)
      if len(stem) > 3 and stem[-1] == stem[-2]:
        bases.add(stem[:-1])
  return frozenset(bases)


def third_person(verb):
  """The third person singular: walk -> walks, carry -> carries, punch -> punches."""
  if verb in ("be", "have"):
    return {"be": "is", "have": "has"}[verb]
  if verb.endswith("y") and verb[-2:-1] not in _VOWELS:
    return verb[:-1] + "ies"
  return verb + ("es" if verb.endswith(("s", "sh", "ch", "x", "z", "o")) else "s")


def present_participle(verb):
  """The present participle: walk -> walking, wave -> waving, sit -> sitting, lie -> lying."""
  if verb.endswith("ie"):
    return verb[:-2] + "ying"
  if verb.endswith("e") and len(verb) > 2 and not verb.endswith(("ee", "oe", "ye")):
    return verb[:-1] + "ing"
  one_vowel = sum(letter in _VOWELS for letter in verb) == 1
  doubled = one_vowel and len(verb) > 2 and verb[-2] in _VOWELS and verb[-1] not in _VOWELS + "wxy"
  return verb + (verb[-1] if doubled else "") + "ing"
