"""The words of the captions that a model learned from, and which words of a sentence are none of them."""
import functools
import heapq
import re

from motion_jax.data.captions import without_subject

# Words that carry no movement of their own: never worth a warning.
FUNCTION_WORDS = frozenset(
    "a about after again all also an and another any are as at be been before being both but by can could did do does "
    "done each either else every few for from had has have having he her hers herself him himself his how i if in into "
    "is it its itself just let like many may me might more most much must my myself no nor not of off on once one only "
    "onto or other our out over own per please quite same shall she should so some something somewhat such than that "
    "the their theirs them themselves then there these they this those though through till to too toward towards "
    "until up us very was we were what when where which while who whom whose why will with within without would you "
    "your s t re ll d m ve".split())

# Forms that no ending tells, of words that captions of movement are made of.
_IRREGULAR = {form: word for word, forms in {
    "bend": "bent", "blow": "blew blown", "break": "broke broken", "bring": "brought", "catch": "caught",
    "child": "children", "come": "came", "creep": "crept", "deal": "dealt", "draw": "drew drawn", "drink": "drank",
    "drive": "drove driven driving", "eat": "ate eaten", "fall": "fell fallen", "feel": "felt", "fight": "fought",
    "fly": "flew flown", "foot": "feet", "get": "got gotten", "give": "gave given", "go": "went gone", "hang": "hung",
    "hold": "held", "keep": "kept", "kneel": "knelt", "knife": "knives", "lay": "laid", "lean": "leant",
    "leap": "leapt", "lie": "lain lying", "lose": "lost", "make": "made", "man": "men", "ride": "rode ridden",
    "rise": "rose risen", "run": "ran", "say": "said", "see": "saw seen", "shake": "shook shaken", "shoot": "shot",
    "sing": "sang sung", "sit": "sat", "sleep": "slept", "slide": "slid", "spin": "spun", "spring": "sprang sprung",
    "stand": "stood", "strike": "struck", "sweep": "swept", "swim": "swam swum", "swing": "swung",
    "take": "took taken", "throw": "threw thrown", "tooth": "teeth", "woman": "women", "write": "wrote",
}.items() for form in forms.split()}
_FEW = 500  # captions that are read with the encoder to find the nearest; more are first sifted by their words


def forms(word):
  """The word and what is left of it without its English endings: walking, walked, walks -> walk; ran -> run."""
  found = {word, _IRREGULAR.get(word, word)}
  for ending, instead in (("ies", "y"), ("es", ""), ("s", ""), ("ied", "y"), ("ed", ""), ("ed", "e"), ("d", ""),
                          ("ing", ""), ("ing", "e"), ("ily", "y"), ("ly", ""), ("er", ""), ("er", "e"), ("est", "")):
    if word.endswith(ending) and len(word) - len(ending) >= 3:
      stem = word[:len(word) - len(ending)] + instead
      found.add(stem)
      if len(stem) > 3 and stem[-1] == stem[-2]:
        found.add(stem[:-1])
  return found


def content_words(sentence):
  """The words of a sentence that say something of a movement, as they stand there; numbers are none."""
  return [word for word in re.findall(r"[^\W\d_]+", sentence) if word.lower() not in FUNCTION_WORDS]


class Vocabulary:
  """What the captions of a training set say: which words, and which captions a sentence shares words with."""

  def __init__(self, captions, also=()):
    """also: what was said besides, such as other words for who moves, in no caption's row."""
    self.captions, self._also = list(captions), tuple(also)

  @functools.cached_property
  def _rows(self):
    """{form of a word: rows of the captions that have it}; a model that is asked in known words only never needs it."""
    rows = {form: [] for word in content_words(" ".join(self._also).lower()) for form in forms(word)}
    for row, caption in enumerate(self.captions):
      for form in {form for word in content_words(caption.lower()) for form in forms(word)}:
        rows.setdefault(form, []).append(row)
    return rows

  @functools.cached_property
  def _said(self):
    return {without_subject(caption) for caption in self.captions}

  def holds(self, sentence):
    """Whether a caption says this, whoever moves."""
    return without_subject(sentence) in self._said

  def missing(self, sentence):
    """The words of a sentence that stand in no caption, in any form, each once and in order."""
    return list(dict.fromkeys(word for word in content_words(sentence)
                              if not any(form in self._rows for form in forms(word.lower()))))

  def candidates(self, sentence, most=_FEW):
    """Rows of at most so many captions: those that share words with a sentence, rare ones above all."""
    if len(self.captions) <= 10 * most:
      return list(range(len(self.captions)))
    weight = {}
    for word in content_words(sentence.lower()):
      found = set().union(*(self._rows.get(form, ()) for form in forms(word)))
      for row in found:
        weight[row] = weight.get(row, 0.0) + 1 / len(found)
    # Of captions that share equally much those with few other words come first, then those in front.
    key = lambda row: (weight[row], -len(self.captions[row]), -row)
    shared = heapq.nlargest(most, weight, key=key)
    return sorted(shared) or list(range(0, len(self.captions), len(self.captions) // most))[:most]
