"""The words of the captions that a model learned from, and which words of a sentence are none of them."""
import difflib
import functools
import heapq
import re
from collections.abc import Callable, Iterable

from motion_jax.data.captions import without_subject
from motion_studio.language import actions

# Words that carry no movement of their own: never worth a warning.
FUNCTION_WORDS = frozenset(
    "a about after again all also an and another any are as at be been before being both but by can could did do does "
    "done each either else every few for from had has have having he her hers herself him himself his how i if in into "
    "is it its itself just let like many may me might more most much must my myself no nor not of off on once one only "
    "onto or other our out over own per please quite same shall she should so some something somewhat such than that "
    "the their theirs them themselves then there these they this those though through till to too toward towards "
    "until up us very was we were what when where which while who whom whose why will with within without would you "
    "your s t re ll d m ve".split())

# Beside these: politeness and fillers, ways to ask for a motion, when and how surely something is done, numbers, units.
_NOTHING_TO_LEARN = FUNCTION_WORDS | frozenset(
    "kindly thanks thank sorry hey hi hello ok okay um uh er erm hmm well oh ah wow yes yeah no nope really so now "
    "named maybe perhaps probably possibly actually basically simply literally totally truly exactly rather pretty "
    "somehow anyway kind sort bit lot lots extremely fairly completely entirely approximately roughly nearly almost "
    "lol alright sure dear bro "
    "show shows showing see want wants need needs give generate create render animate animation animated motion "
    "motions movement movements action actions clip video scene imagine try tries trying attempt attempts depicts "
    "depicted character actor avatar individual people persons everybody anybody nobody "
    "start starts starting started begin begins beginning began continue continues continuing continued keep keeps "
    "proceed proceeds decide decides seem seems seemingly appear appears appearing finish finishes finished end ends "
    "first firstly second secondly third next later finally last lastly eventually immediately suddenly soon meanwhile "
    "simultaneously afterwards afterward already always never often sometimes usually today ever still yet till "
    "moment instant duration time times pause pauses "
    "don doesn didn isn aren wasn weren won wouldn couldn shouldn can cannot hasn haven hadn ain gonna wanna gotta "
    "zero two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen "
    "eighteen nineteen twenty thirty forty fifty sixty seventy eighty ninety hundred thousand half quarter dozen "
    "couple pair thrice single double triple st nd rd th "
    "meter meters metre metres centimeter centimeters centimetre centimetres millimeters kilometer kilometers "
    "kilometre kilometres mile miles inch inches ft yard yards cm mm km kmh kph mph second seconds sec secs minute "
    "minutes min mins hour hours degree degrees deg percent frames fps kg per hz".split())
_NAMES = frozenset(
    "john james david michael robert william tom tim jim joe sam ben dan alex chris paul peter george harry henry "
    "charlie mary anna anne emma lisa laura sarah sara kate jane julia maria susan linda emily alice lucy sophie eva "
    "nina mia olivia noah liam leo adam simon martin thomas daniel matthew andrew steve kevin brian eric hans carlos "
    "juan jose pedro ali mohammed ahmed omar yuki mr mrs ms dr".split())
_DETERMINERS = frozenset("a an the this that these those one two three another some any each every no".split())

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


@functools.lru_cache(maxsize=1 << 14)
def forms(word):
  """The word and what is left of it without its English endings: walking, walked, walks -> walk; ran -> run."""
  found = {word, _IRREGULAR.get(word, word)}
  for ending, instead in (("ies", "y"), ("es", ""), ("s", ""), ("ied", "y"), ("ed", ""), ("ed", "e"), ("d", ""),
                          ("ing", ""), ("ing", "e"), ("ily", "y"), ("ly", ""), ("ier", "y"), ("er", ""), ("er", "e"),
                          ("iest", "y"), ("est", "")):
    if word.endswith(ending) and len(word) - len(ending) >= 3:
      stem = word[:len(word) - len(ending)] + instead
      found.add(stem)
      if len(stem) > 3 and stem[-1] == stem[-2]:
        found.add(stem[:-1])
  return frozenset(found)


def content_words(sentence):
  """The words of a sentence that say something of a movement, as they stand there; numbers are none."""
  return [word for word in re.findall(r"[^\W\d_]+", sentence) if word.lower() not in FUNCTION_WORDS]


def strange_words(sentence: str, is_known: Callable[[str], bool]) -> list[str]:
  """The words of a sentence that are worth a warning, in order, each once in whatever form: is_known(word in small
  letters) says no, and they are neither names of who moves nor words that add nothing to a motion."""
  found: dict[str, str] = {}
  words = re.findall(r"[^\W\d_]+", sentence)
  for before, word, after in zip(["", *words], words, [*words[1:], ""]):
    lower = word.lower()
    if lower not in _NOTHING_TO_LEARN and not _is_name(before, word, after) and not is_known(lower) and not any(
        form in found for form in forms(lower)):
      found |= dict.fromkeys(forms(lower), word)
  return list(dict.fromkeys(found.values()))


def _is_name(before, word, after):
  """Whether a word is the name of who moves: a usual one, or with a capital letter and a verb after it."""
  if word.lower() in _NAMES:
    return True
  begins_sentence = not before
  return word.istitle() and not begins_sentence and (before.lower() in ("named", "called") or (
      before.lower() not in _DETERMINERS and after.islower() and (after in ("is", "was") or (
          after.endswith(("s", "ed")) and bool(actions.verb_of(after))))))


def meant(word: str, known: Iterable[str]) -> str:
  """The known word that a misspelled one is most like, "" where none is like it: wlaks -> walks."""
  lower = word.lower()
  near = difflib.get_close_matches(lower, [one for one in known if one[:1] == lower[:1]], 1, 0.8)
  return near[0] if near and len(lower) > 3 else ""


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
    """Whether a caption says this, of any subject."""
    return without_subject(sentence) in self._said

  def missing(self, sentence):
    """The words of a sentence that stand in no caption, in any form, each once and in order; none that add nothing to
    a motion, such as "please", "Mary" or "metres"."""
    return strange_words(sentence, lambda word: any(form in self._rows for form in forms(word)))

  @functools.cached_property
  def words(self):
    """The words of the captions that say something of a movement, in small letters and in order."""
    return sorted({word for caption in (*self.captions, *self._also) for word in content_words(caption.lower())})

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
