"""Ellipsis: words that a sentence leaves out because it gave them just before, as in "turns left, then right".

Two lists of rules, both tried in order: `CONTINUATIONS` after any connector, `VERBLESS` for words without a verb.
"""
import re

from motion_jax_studio.language import lexicon
from motion_jax_studio.language.actions import sides_of
from motion_jax_studio.language.clause import Clause, lower
from motion_jax_studio.language.counting import without_times
from motion_jax_studio.language.light_verbs import reworded
from motion_jax_studio.language.meaning import is_a
from motion_jax_studio.language.rule import Rule, first_match

_PACE = re.compile(
    r"(?:(?:gradually|suddenly|then|slowly|quickly|abruptly) )?(?:(?P<slower>slows?|decelerates?|(?:(?:goes|gets) )?"
    r"slower)|speeds?|accelerates?|(?:(?:goes|gets) )?faster|picks up (?:the |some )?(?:pace|speed))"
    r"(?: up| down)?(?: (?:gradually|suddenly|a bit|a little|again))?(?: (?:in)?to an? (?P<gait>walk|run|jog|sprint))?")
_SHAPE = re.compile(r"(?i)sideways\b|(?:in|along) an? (?:\w+ )?(?:circle|loop|arc|curve|semicircle|spiral)\b")
_CONTINUE = re.compile(r"(?:goes|moves|carries) on|keeps going|continues|resumes|proceeds")


def completed(done, kind, tokens, clause):
  """The clause of words that take their meaning from the clauses before them, None of others.

  done: the clauses before; kind: how the words are joined to them; clause: of the words by themselves, or None.
  """
  found = first_match(CONTINUATIONS, done, kind, tokens)
  if found is not None or clause is not None:
    return found
  previous = done[-1]
  if kind == "then":
    return _verbless(previous, tokens)
  if kind not in ("and", ","):
    return None
  # "jumps forward twice and backward once", "punches left, right"; "walks back and forth" stays as it is.
  both_counted = all(without_times(some)[1] is not None for some in (previous.words, tokens))
  other_side = kind == "," and lexicon.EVENTS.get(previous.verb) in lexicon.SIDED_EVENTS and (
      lower(tokens) in (["left"], ["right"]))
  return _verbless(previous, tokens) if both_counted or other_side else None


def _verbless(previous, tokens):
  """The clause of words without a verb, which is that of the previous clause."""
  tokens, times = without_times(tokens)
  if times is None:
    return first_match(VERBLESS, previous, tokens, [token.lower() for token in tokens])
  again = previous._replace(words=without_times(previous.words)[0], before=[], subject=[])
  found = _verbless(previous, tokens) if tokens else again
  return found and found._replace(times=times)


def _is_gait(verb):
  return verb == "go" or is_a(verb, "walk", "run")


def _with_words(previous, words):
  return previous._replace(words=words, before=[], subject=[])


# --- continuations ----------------------------------------------------------------------------------------------------

def _continuing(done, kind, tokens):
  gait = next((one for one in reversed(done) if _is_gait(one.verb)), None)
  continues = gait is not None and _CONTINUE.fullmatch(" ".join(lower(tokens)))
  return gait._replace(before=[], subject=[]) if continues else None


def _change_of_pace(done, kind, tokens):
  previous, found = done[-1], _PACE.fullmatch(" ".join(lower(tokens)))
  if found is None or not _is_gait(previous.verb):
    return None
  if found["gait"]:
    return Clause([], [], found["gait"], found["gait"], [])
  words = " ".join(previous.words).replace(" at first", "").split()
  words = [word for word in words if not word.lower().endswith("ly") and word.lower() != "fast"]
  return _with_words(previous, [*words, "slowly" if found["slower"] else "quickly"])


def _further_steps(done, kind, tokens):
  previous = done[-1]
  is_object = previous.verb in lexicon.LIGHT_VERBS or previous.reworded or previous.steps
  steps = (kind == "then" or is_object and kind in ("and", ",")) and _is_steps(lower(tokens))
  return Clause([], [], "take", "take", list(tokens)) if steps else None


def _is_steps(words):
  """Whether words are no more than "two steps back"."""
  return words[1:2] in (["step"], ["steps"]) and words[0] in {*lexicon.NUMBERS, *lexicon.ONE_MORE} and (
      set(words[2:]) <= lexicon.DIRECTIONS | {"to", "the"})


# --- words without a verb ---------------------------------------------------------------------------------------------

def _manner(previous, tokens, words):
  is_path = words[:1] == ["in"] and _is_gait(previous.verb)
  if not is_path and words[:1] != ["like"] and not (words and all(word.endswith("ly") for word in words)):
    return None
  return _with_words(previous, list(tokens) if is_path else [
      *(word for word in previous.words if not word.lower().endswith("ly")), *tokens])


def _direction(previous, tokens, words):
  said, adverbs = lower(previous.words), {word for word in words if word.endswith("ly")}
  known = lexicon.DIRECTIONS | {"to", "the"} | lexicon.POSSESSIVES | adverbs
  is_direction = words and words != ["again"] and set(words) <= known
  one_limb = len(sides_of(said)) < 2 and lexicon.LIMBS.intersection(said)
  of_a_limb = one_limb and words and words[-1] in lexicon.SIDES and "to" not in words
  if not is_direction or of_a_limb or not lexicon.DIRECTIONS.intersection(said):
    return None
  shape = _SHAPE.match(" ".join(previous.words))  # "in a circle to the left, then to the right"
  to = ["to"] if "to" in said and words[0] in {"the", *lexicon.POSSESSIVES} else []  # "to the left, then the right"
  return _with_words(previous, [*(shape[0].split() if shape and words[0] != shape[0] else []), *to, *tokens])


def _taken_noun(previous, tokens, words):
  taken = reworded("take", tokens)
  return taken and Clause([], [], taken.verb, taken.verb, taken.words, taken.times, reworded=True)


def _other_limb(previous, tokens, words):
  said = lower(previous.words)
  limb = next((word for word in said if word in lexicon.LIMBS), "")
  if not words or words[-1] not in lexicon.LIMBS and len(sides_of(said)) == 2:
    return None  # "with both arms to the right, then left"
  if not set(words) <= lexicon.POSSESSIVES | lexicon.LIMBS | lexicon.BEFORE_A_LIMB or not (
      words[-1] in lexicon.LIMBS or limb and words[-1] in (*lexicon.SIDES, "other")):
    return None
  start = [word for word in ("with", "on") if word in previous.words and word not in words][:1]
  start += ["the"] if len(words) == 1 and words[0] in lexicon.SIDES else []
  side = next((lexicon.SIDES[word] for word in said if word in lexicon.SIDES), "other")
  own = [side if word.lower() == "other" else word for word in tokens]
  return _with_words(previous, [*start, *own, *([] if words[-1] in lexicon.LIMBS else [limb])])


CONTINUATIONS = (
    Rule("Continuing", "The last walk or run continues.", {
        "he walks a bit, waits for 3 seconds and keeps going": "walks a bit | stands still [3] | walks a bit",
        "a person walks forward, stops, then continues": "walks forward | stands still | walks forward"}, _continuing),
    Rule("Change of pace", "The same walk or run quickly, slowly, or in another gait.", {
        "a person walks, speeds up, then slows down again": "walks | walks quickly | walks slowly",
        "a person runs, then slows down to a walk": "runs | walks"}, _change_of_pace),
    Rule("Further steps", "Steps after \"then\", after counted steps, or after an action that a noun names.", {
        "a person takes three steps forward and two steps back":
            "walks forward [1.65] | walks backward [1.3] | stands still",
        "a man walks around, then a step back": "walks around | walks backward [0.8] | stands still",
        "a person takes a bow and a step back": "bows | walks backward [0.8] | stands still"}, _further_steps),
)
VERBLESS = (
    Rule("Other manner", "The same action in another manner or style, or the same gait along another path.", {
        "a person walks slowly, then quickly": "walks slowly | walks quickly",
        "a person walks normally, then like an old man": "walks normally | walks like an old man",
        "a person walks in a circle to the left, then in a circle to the right":
            "walks in a circle to the left | walks in a circle to the right"}, _manner),
    Rule("Other direction", "The same action to another side; the shape of a path stays.", {
        "a person turns left, then right": "turns left | turns right",
        "a person walks in a circle to the left, then to the right":
            "walks in a circle to the left | walks in a circle to the right",
        "a person steps sideways to the left, then to the right":
            "walks sideways to the left | walks sideways to the right",
        "a person leans to the left, then the right": "leans to the left | leans to the right",
        "a person jumps forward twice and backward once": "jumps forward 2 times | jumps backward"}, _direction),
    Rule("Noun of an action", "As after a light verb.", {
        "a person walks, then a run": "walks | runs",
        "a person walks followed by a dance": "walks | dances",
        "a man makes a left turn, followed by a right turn": "turns left | turns right",
        "she throws a left punch, then two right kicks":
            "punches with the left hand | kicks with the right foot 2 times"}, _taken_noun),
    Rule("Other limb", "The same action with another arm or leg; the words may give a number of their own.", {
        "a person raises the left hand, then the right": "raises the left hand | raises the right hand",
        "a person kicks with the left leg, then with the other": "kicks with the left leg | kicks with the right leg",
        "he kicks with the left leg three times and then once with the right":
            "kicks with the left leg 3 times | kicks with the right leg"}, _other_limb),
)
