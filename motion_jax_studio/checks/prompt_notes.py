"""Notes on prompts before sampling: words and actions that the model has not learned, and what it can do instead."""
from collections.abc import Iterable
from typing import Any

from motion_jax.text.morphology import possible_bases, third_person, verb_of
from motion_jax.text.vocabulary import closest_word
from motion_jax_studio.checks.violations import can_be_checked
from motion_jax_studio.language import Plan
from motion_jax_studio.language.hand_places import without_hands
from motion_jax_studio.language.lexicon import BEFORE_ACTIONS, NEGATIONS, PAUSE
from motion_jax_studio.language.path_shapes import without_shape
from motion_jax_studio.language.postures import postures_of
from motion_jax_studio.language.words import letters, several_people

_NAMED = 5  # words of a prompt, and notes of a call, at most


def notes_of(planner: Any, prompts: Iterable[str | Plan], postures: bool = True) -> list[str]:
  """Notes on prompts that a model may not do as intended; a plan is judged action by action, a string as a whole.

  postures: hands and trunk of a plan come to where its words have them, whatever a model has learned.
  """
  notes: dict[str, None] = {}
  named: set[str] = set()
  for one in prompts:
    prompt = one if isinstance(one, str) else one.text
    if not planner.model.captions.is_english(prompt):
      notes[f"{shortened(prompt)}: this model reads English only; try 'a person walks forward'"] = None
      continue
    if people := several_people(prompt):
      notes[f"{shortened(prompt)} is about several people ({people!r}); only one body is made"] = None
    if not isinstance(one, str):
      notes.update(dict.fromkeys(_of_verbs(planner, one)))
      if (lost := [word for word in _lost_words(planner, one) if word.lower() not in named]):
        named.update(map(str.lower, lost))
        notes[_of_words(planner, prompt, lost)] = None
    if (denial := _denial(one)):
      notes[f"{shortened(prompt)} says {denial!r}; a model may do what follows nevertheless"] = None
    for part in [prompt] if isinstance(one, str) else (
        _without_postures(one) if postures and can_be_checked(planner.model) else one.prompts):
      words = [word for word in planner.model.captions.unknown_words(part) if word.lower() not in named]  # each once
      named.update(map(str.lower, words))
      if words:
        notes[_of_words(planner, part, words)] = None
      elif not isinstance(one, str) and (note := _of_phrase(planner, one if part == one.text else part)):
        notes[note] = None
  more = len(notes) - _NAMED
  return [*notes] if more <= 0 else [
      *[*notes][:_NAMED], f"the model does not know some words or actions of {more} more prompts"]


def _denial(prompt):
  """The word by which a prompt denies an action, "" where none does; standing still can be made."""
  if isinstance(prompt, str) or any(one.kind == "still" for one in prompt.requirements):
    return ""
  return next((word for part in prompt.prompts for word in part.lower().split() if word in NEGATIONS), "")


def _lost_words(planner, plan):
  """Words of no training caption that no action of a plan has: the moonwalk that became "walks"."""
  kept = {form for action in (*plan.actions, *plan.sampled) for word in letters(action.prompt)
          for form in possible_bases(word)}
  text = without_shape(plan.text) if _bends(plan) else plan.text
  unknown = {word: {*possible_bases(word.lower())} for word in planner.model.captions.unknown_words(text)}
  return [word for word, forms in unknown.items() if kept.isdisjoint(forms) and BEFORE_ACTIONS.isdisjoint(forms)
          and word.isascii() and word.isalpha() and not planner.meanings.of(verb_of(word.lower()) or word.lower())]


def _bends(plan):
  """Whether a walk is bent to a path, whatever the captions say."""
  return any(one.kind == "figure-eight" for one in plan.requirements)


def _without_postures(plan):
  """The prompts of a plan without standing still, what they say of postures, and of paths to which walks are bent; the
  gestures that a model samples stay."""
  named = {plan.single.prompt: plan.text} if plan.is_plain and plan.single else {}
  segments = plan.read_segments
  posed = {segments[at].actions[number].prompt for (at, number), place in postures_of(segments).items()
           if place is None or place.place or number}
  posed = {named.get(prompt, prompt) for prompt in posed}
  prompts = dict.fromkeys(action.prompt for action in plan.sampled
                          if action.words != PAUSE and action.prompt not in posed)
  return [without_hands(without_shape(prompt) if _bends(plan) else prompt) for prompt in prompts]


def _of_verbs(planner, plan):
  """Notes on verbs that a plan has replaced by wider ones, with no word for what sets them apart."""
  made = {verb_of(word) for part in plan.prompts for word in letters(part)}
  for verb in {verb_of(word): None for word in letters(plan.text)}:
    meaning = planner.meanings.of(verb) if verb and verb not in made else None
    if meaning and meaning.verb in made and not meaning.manner and meaning.confidence < 1:
      yield (f"{third_person(verb)!r} is made as {third_person(meaning.verb)!r}, the nearest that "
             f"{planner.model.folder.name} has learned")


def _of_words(planner, prompt, words):
  """A note on words of no training caption."""
  found = ", ".join(with_suggestion(planner.model, word) for word in words[:_NAMED]) + " ..." * (len(words) > _NAMED)
  nearest = planner.nearest_captions(prompt)
  instead = (f"the nearest caption that {planner.model.folder.name} learned from is {shortened(nearest[0][0])}"
             if nearest else "it may be ignored or misunderstood")
  return f"the model does not know {found} in {shortened(prompt)}{_how_rare(planner, prompt)}: {instead}"


def _of_phrase(planner, action):
  """A note on an action, a plan or a prompt, with known words in an unknown combination; "" for one that is known."""
  prompt = action if isinstance(action, str) else action.text
  if not planner.model.captions or planner.model.captions.knows(prompt) and not planner.repertoire.rare_words(action):
    return ""  # before the vectors of all captions are needed
  found = planner.repertoire.judge(action)
  if found.known and not found.few or not found.nearest:
    return ""
  learned = "learned little like" if found.known else "not learned"
  return (f"{planner.model.folder.name} has {learned} {shortened(prompt)}{_how_rare(planner, action)}; what it knows "
          f"nearest is {shortened(found.nearest[0][1])}, so expect something like that")


def _how_rare(planner, action):
  """How few phrases of the captions have words of an action: " ('hook' in 2 of 2,365 phrases)"; "" of common ones."""
  counts = planner.repertoire.rare_words(action).items() if planner.repertoire else ()
  rare = ", ".join(f"{word!r} in {count}" for word, count in counts)
  return f" ({rare} of {len(planner.repertoire.phrases):,} phrases)" if rare else ""


def with_suggestion(model: Any, word: str) -> str:
  """The word in quotes, with the closest known word where it is misspelled and no word of the encoder's."""
  known = sorted(model.encoder.known_words)
  if model.captions:
    vocabulary = model.captions.vocabulary
    known = sorted({*vocabulary.words, *(one for one in known if not vocabulary.missing(one))})
  other = "" if any(map(model.encoder.is_piece, possible_bases(word.lower()))) else closest_word(word, known)
  return f"{word!r} (did you mean {other!r}?)" if other else repr(word)


def shortened(text: str) -> str:
  """The text in quotes, cut where it is long."""
  return repr(text if len(text) <= 120 else text[:119] + "…")
