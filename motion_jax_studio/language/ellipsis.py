"""Ellipsis: words that a sentence leaves out because it gave them just before, as in "turns left, then right".

Two lists of rules, both tried in order: `_CONTINUATIONS` after any connector, `_VERBLESS` for words without a verb.
"""
import re

from motion_jax_studio.language import lexicon
from motion_jax_studio.language.clause import Clause
from motion_jax_studio.language.counting import without_times
from motion_jax_studio.language.light_verbs import reworded
from motion_jax_studio.language.meaning import is_a
from motion_jax_studio.language.parts import sides_of
from motion_jax_studio.language.words import normalize

_SLOWER, _FASTER = {"slow", "slows", "decelerates", "slower"}, {"speed", "speeds", "accelerates", "faster", "pace"}
_PACE_WORDS = _SLOWER | _FASTER | set("goes gets up down gradually suddenly then slowly quickly abruptly picks again "
                                      "some bit little to into walk run jog sprint".split())
_SHAPE = re.compile(r"sideways\b|(?:in|along) an? (?:\w+ )?(?:circle|loop|arc|curve|semicircle|spiral)\b")
_CONTINUE = {*(f"{verb} on" for verb in ("goes", "moves", "carries")), "keeps going", "continues", "resumes",
             "proceeds"}


def completed(done, kind, tokens, clause):
  """Complete elliptical words from the clauses before them; None for words that are not elliptical.

  done: the clauses before; kind: the connector to them; clause: the words parsed alone, or None.
  """
  continued = _first(_CONTINUATIONS, done, kind, tokens)
  if continued is not None or clause is not None:
    return continued
  previous = done[-1]
  if kind == "then":
    return _verbless(previous, tokens)
  if kind not in ("and", ","):
    return None
  # "jumps forward twice and backward once", "punches left, right"; "walks back and forth" stays as it is.
  both_counted = all(without_times(words)[1] is not None for words in (previous.words, tokens))
  other_side = kind == "," and lexicon.EVENTS.get(previous.verb) in lexicon.SIDED_EVENTS and (
      tokens in (["left"], ["right"]))
  return _verbless(previous, tokens) if both_counted or other_side else None


def _verbless(previous, tokens):
  """The clause of words without a verb, with the verb of the previous clause."""
  tokens, times = without_times(tokens)
  if times is None:
    return _first(_VERBLESS, previous, tokens)
  again = previous._replace(words=without_times(previous.words)[0], before=[], subject=[])
  clause = _verbless(previous, tokens) if tokens else again
  return clause and clause._replace(times=times)


def _first(rules, *args):
  return next((clause for rule in rules if (clause := rule(*args)) is not None), None)


def _is_gait(verb):
  return verb == "go" or is_a(verb, "walk", "run")


def _with_words(previous, words):
  return previous._replace(words=words, before=[], subject=[])


# --- continuations ----------------------------------------------------------------------------------------------------

def _continuing(done, kind, tokens):
  gait = next((before for before in reversed(done) if _is_gait(before.verb)), None)
  continues = gait is not None and " ".join(tokens) in _CONTINUE
  return gait._replace(before=[], subject=[]) if continues else None


def _change_of_pace(done, kind, tokens):
  previous, words = done[-1], set(normalize(tuple(tokens)).split())
  if not words & (_SLOWER | _FASTER) or not words <= _PACE_WORDS or not _is_gait(previous.verb):
    return None
  if gait := words & {"walk", "run", "jog", "sprint"}:
    return Clause([], [], *2 * [*gait], [])
  kept = " ".join(word for word in previous.words if not word.endswith("ly") and word != "fast")
  pace = "slowly" if words & _SLOWER else "quickly"
  return _with_words(previous, [*f" {kept}".replace(" at first", "").split(), pace])


def _further_steps(done, kind, tokens):
  previous = done[-1]
  is_object = previous.verb in lexicon.LIGHT_VERBS or previous.reworded or previous.steps
  steps = (kind == "then" or is_object and kind in ("and", ",")) and _is_steps(tokens)
  return Clause([], [], "take", "take", list(tokens)) if steps else None


def _is_steps(words):
  """Whether words are no more than "two steps back"."""
  return words[1:2] in (["step"], ["steps"]) and words[0] in {*lexicon.NUMBERS, *lexicon.ONE_MORE} and (
      set(words[2:]) <= lexicon.DIRECTIONS | {"to", "the"})


# --- words without a verb ---------------------------------------------------------------------------------------------

def _manner(previous, words):
  is_path = words[:1] == ["in"] and _is_gait(previous.verb)
  if not is_path and words[:1] != ["like"] and not all(word.endswith("ly") for word in words):
    return None
  return _with_words(previous, list(words) if is_path else [
      *(word for word in previous.words if not word.endswith("ly")), *words])


def _direction(previous, words):
  before, adverbs = previous.words, {word for word in words if word.endswith("ly")}
  known = lexicon.DIRECTIONS | {"to", "the"} | lexicon.POSSESSIVES | adverbs
  is_direction = words != ["again"] and set(words) <= known
  one_limb = len(sides_of(before)) < 2 and lexicon.LIMBS.intersection(before)
  of_a_limb = one_limb and words[-1] in lexicon.SIDES and "to" not in words
  if not is_direction or of_a_limb or not lexicon.DIRECTIONS.intersection(before):
    return None
  shape = _SHAPE.match(" ".join(previous.words))  # "in a circle to the left, then to the right"
  to = ["to"] if "to" in before and words[0] in {"the", *lexicon.POSSESSIVES} else []  # "to the left, then the right"
  return _with_words(previous, [*(shape[0].split() if shape and words[0] != shape[0] else []), *to, *words])


def _taken_noun(previous, words):
  if (action := reworded("take", words)) is None:
    return None
  verb, words, times = action
  return Clause([], [], verb, verb, words, times, reworded=True)


def _other_limb(previous, words):
  before = previous.words
  limb = next((word for word in before if word in lexicon.LIMBS), "")
  if words[-1] not in lexicon.LIMBS and len(sides_of(before)) == 2:
    return None  # "with both arms to the right, then left"
  if not set(words) <= lexicon.POSSESSIVES | lexicon.LIMBS | lexicon.BEFORE_A_LIMB or not (
      words[-1] in lexicon.LIMBS or limb and words[-1] in (*lexicon.SIDES, "other")):
    return None
  start = [word for word in ("with", "on") if word in previous.words and word not in words][:1]
  start += ["the"] if len(words) == 1 and words[0] in lexicon.SIDES else []
  side = next((lexicon.SIDES[word] for word in before if word in lexicon.SIDES), "other")
  named = [side if word == "other" else word for word in words]
  return _with_words(previous, [*start, *named, *([] if words[-1] in lexicon.LIMBS else [limb])])


_CONTINUATIONS = (_continuing, _change_of_pace, _further_steps)
_VERBLESS = (_manner, _direction, _taken_noun, _other_limb)
