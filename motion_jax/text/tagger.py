"""Lemmas and parts of speech by rule, as tokens in the format of HumanML3D text files.

A word list for sentences about movement, a few endings, and the neighbouring words. It is not spaCy, which made the
official files, and is less accurate on other texts. Of the metrics only the classic evaluators read these tokens; run
them on the official files.
"""
import re

from motion_jax.text.lexicon import TAGGED_VERBS
from motion_jax.text.morphology import BASE_OF, base_form

_CLOSED = {tag: words.split() for tag, words in {
    "DET": "a an the this that these those another each every both all some any no",
    "PRON": "i he she it they them him you we us himself herself itself themselves something someone somebody anyone "
            "everyone one who his her their its your my our",
    "ADP": "in on at of to from with without by over under above below across through into onto off out along around "
           "about against toward towards between behind beside beneath near like during after before for as past up "
           "down upon",
    "AUX": "is are am was were be been being can could will would may might must should do does did has have had",
    "CCONJ": "and or but nor", "SCONJ": "while when if because until since so", "PART": "not n't",
    "NUM": "two three four five six seven eight nine ten twice ninety hundred 90 180 360",
    "ADV": "forward forwards backward backwards sideways left right clockwise counterclockwise anticlockwise again "
           "then there here very too also ahead apart away back once still together upward upwards downward downwards "
           "around fast straight several_times in_place almost just even only first slightly twice overhead",
    "ADJ": "small large big tall little same other different left-handed slow quick long short high low old young sad "
           "happy angry tired proud several few uneven elderly masculine feminine musical exhausted indian casual "
           "dynamic single martial many outstretched crossed normal youthful childish timid heavy hard rough giant "
           "upper lower front"}.items()}
_TAG = {word: tag for tag, words in reversed(_CLOSED.items()) for word in words}
_SIDES = ("left", "right", "front", "back", "straight", "upper", "lower", "other", "same")

_NOUNS = set("""
person man woman someone people figure arm leg hand foot feet knee elbow head hip waist chin face mouth eye shoulder
ankle wrist torso body back side front place ball basketball soccer bottle car cap ground floor stair step stool
ladder playground equipment sword blade kata dance dancer music circle corner direction line way time degree thug
child boxer karate ballet block window knife soda response traffic goodbye bye style pace spot air terrain
confidence expression exhaustion bar hoop fist seat rung axis guide grand arabesque cartwheel kick punch walk wave
""".split())
# Irregular forms that the tagger reads, and words whose lemma no ending shows.
_FORMS = {form: BASE_OF[form] for form in (
    "feet children men women knives went gone ran sat stood took threw bent swung lying held made did").split()}
_LEMMAS = _FORMS | {
    "people": "people", "is": "be", "are": "be", "am": "be", "was": "be", "were": "be", "been": "be", "being": "be",
    "has": "have", "had": "have", "does": "do", "left": "left", "an": "a", "goes": "go", "says": "say",
    "twice": "twice", "jetes": "jete", "pirouettes": "pirouette", "others": "other", "them": "they", "him": "he",
    "its": "its"}


def tag(text) -> list[str]:
  """A sentence to tokens "lemma/POS", punctuation left out, at the tags of HumanML3D's files (universal set)."""
  return [f"{lemma}/{pos}" for lemma, pos in tag_words(re.findall(r"[a-z0-9]+(?:['-][a-z0-9]+)*", text.lower()))]


def tag_words(words) -> list[tuple[str, str]]:
  """[(lemma, tag)] of the words of a sentence, in small letters."""
  tags, before = [], ""
  for word, after in zip(words, [*words[1:], ""]):
    tags.append(_look_up(word, before, after))
    before = tags[-1][1]
  return tags


def _look_up(word, before, after):
  """(lemma, tag) of a word, with the tag before it and the word after it."""
  verb, noun = base_form(word, TAGGED_VERBS), base_form(word, _NOUNS, ("es", "s"))
  if word in _SIDES and (after in _NOUNS or base_form(after, _NOUNS, ("es", "s"))):
    return word, "ADJ"
  if word in _SIDES[:4] and before in ("DET", "PRON"):
    return word, "NOUN"
  if word in _TAG:
    return _LEMMAS.get(word, word), _TAG[word]
  if word in _LEMMAS:
    lemma = _LEMMAS[word]
    return lemma, "VERB" if lemma in TAGGED_VERBS else "NOUN"
  inside_noun_phrase = before in ("DET", "ADJ", "NUM") or (before == "ADP" and not word.endswith("ing"))
  if noun and (inside_noun_phrase or not verb):
    return noun, "NOUN"
  if verb:
    return verb, "NOUN" if before in ("DET", "ADJ", "NUM") and not word.endswith(("ing", "ed")) else "VERB"
  if word.isdigit():
    return word, "NUM"
  if word.endswith("ly"):
    return word, "ADV"
  if word.endswith(("ful", "ish", "ous", "ive", "less", "ic", "al")):
    return word, "ADJ"
  if before in ("NOUN", "PRON") and word.endswith("s") and not inside_noun_phrase:
    return word[:-1], "VERB"
  return (word[:-1] if word.endswith("s") and not word.endswith("ss") else word), "NOUN"
