"""Notes on prompts before sampling: words and actions that the model has not learned, and what it can do instead."""
from collections.abc import Iterable
from typing import Any

from motion_jax.text.morphology import possible_bases, third_person, verb_of
from motion_jax.text.vocabulary import closest_word
from motion_jax_studio.checks.violations import can_be_checked
from motion_jax_studio.language import Plan
from motion_jax_studio.language.hand_places import postures_of, without_hands
from motion_jax_studio.language.lexicon import BEFORE_ACTIONS, NEGATIONS, PAUSE
from motion_jax_studio.language.path_shapes import without_shape
from motion_jax_studio.language.words import letters, several_people

_NAMED = 5  # most words of a note, and most notes of a call


def notes_on(planner: Any, prompts: Iterable[str | Plan], postures: bool = True) -> list[str]:
  """Notes on prompts that a model may not perform as intended; a plan is judged action by action, a string as a whole.

  postures: the pose step adds leans and hand poses, so they need not be learned.
  """
  notes: dict[str, None] = {}
  named: set[str] = set()
  for given in prompts:
    prompt = given if isinstance(given, str) else given.text
    if not planner.model.captions.is_english(prompt):
      notes[f"{shortened(prompt)}: this model reads English only; try 'a person walks forward'"] = None
      continue
    if people := several_people(prompt):
      notes[f"{shortened(prompt)} is about several people ({people!r}); only one body is made"] = None
    if not isinstance(given, str):
      notes.update(dict.fromkeys(_of_verbs(planner, given)))
      if (lost := [word for word in _lost_words(planner, given) if word.lower() not in named]):
        named.update(map(str.lower, lost))
        notes[_of_words(planner, prompt, lost)] = None
    if (denial := _denial(given)):
      notes[f"{shortened(prompt)} says {denial!r}; a model may do what follows nevertheless"] = None
    for part in [prompt] if isinstance(given, str) else (
        _without_postures(given) if postures and can_be_checked(planner.model) else given.prompts):
      words = [word for word in planner.model.captions.unknown_words(part) if word.lower() not in named]  # each once
      named.update(map(str.lower, words))
      if words:
        notes[_of_words(planner, part, words)] = None
      elif not isinstance(given, str) and (note := _of_phrase(planner, given if part == given.text else part)):
        notes[note] = None
  more = len(notes) - _NAMED
  return [*notes] if more <= 0 else [
      *[*notes][:_NAMED], f"the model does not know some words or actions of {more} more prompts"]


def _denial(prompt):
  """The word that negates an action of a prompt, "" if there is none; "does not move" counts as standing still."""
  if isinstance(prompt, str) or any(requirement.kind == "still" for requirement in prompt.requirements):
    return ""
  return next((word for part in prompt.prompts for word in part.lower().split() if word in NEGATIONS), "")


def _lost_words(planner, plan):
  """Unknown words that the plan has dropped, such as "moonwalks" of a plan with "walks"."""
  kept = {form for action in (*plan.actions, *plan.sampled) for word in letters(action.prompt)
          for form in possible_bases(word)}
  text = without_shape(plan.text) if _bends(plan) else plan.text
  unknown = {word: {*possible_bases(word.lower())} for word in planner.model.captions.unknown_words(text)}
  return [word for word, forms in unknown.items() if kept.isdisjoint(forms) and BEFORE_ACTIONS.isdisjoint(forms)
          and word.isascii() and word.isalpha() and not planner.meanings.of(verb_of(word.lower()) or word.lower())]


def _bends(plan):
  """Whether the correct step bends a walk to a figure of eight, which the model need not know."""
  return any(requirement.kind == "figure-eight" for requirement in plan.requirements)


def _without_postures(plan):
  """The prompts of a plan without what the pipeline adds: standing still, postures, bent paths. Gestures that a model
  samples stay."""
  named = {plan.single.prompt: plan.text} if plan.is_plain and plan.single else {}
  segments = plan.read_segments
  posed = {segments[at].actions[number].prompt for (at, number), place in postures_of(segments).items()
           if place is None or place.place or number}
  posed = {named.get(prompt, prompt) for prompt in posed}
  prompts = dict.fromkeys(action.prompt for action in plan.sampled
                          if action.words != PAUSE and action.prompt not in posed)
  return [without_hands(without_shape(prompt) if _bends(plan) else prompt) for prompt in prompts]


def _of_verbs(planner, plan):
  """Notes on verbs that a plan has replaced by more general ones, losing their manner."""
  prompt_verbs = {verb_of(word) for part in plan.prompts for word in letters(part)}
  for verb in {verb_of(word): None for word in letters(plan.text)}:
    meaning = planner.meanings.of(verb) if verb and verb not in prompt_verbs else None
    if meaning and meaning.verb in prompt_verbs and not meaning.manner and meaning.confidence < 1:
      yield (f"{third_person(verb)!r} is made as {third_person(meaning.verb)!r}, the nearest that "
             f"{planner.model.folder.name} has learned")


def _of_words(planner, prompt, words):
  """A note on words that no training caption has."""
  unknown = ", ".join(with_suggestion(planner.model, word) for word in words[:_NAMED]) + " ..." * (len(words) > _NAMED)
  nearest = planner.nearest_captions(prompt)
  instead = (f"the nearest caption that {planner.model.folder.name} learned from is {shortened(nearest[0][0])}"
             if nearest else "it may be ignored or misunderstood")
  return f"the model does not know {unknown} in {shortened(prompt)}{_how_rare(planner, prompt)}: {instead}"


def _of_phrase(planner, action):
  """A note on an action (plan or prompt) with known words in an unknown combination; "" for a known action."""
  prompt = action if isinstance(action, str) else action.text
  if not planner.model.captions or planner.model.captions.knows(prompt) and not planner.repertoire.rare_words(action):
    return ""  # saves computing the vectors of all captions
  judgement = planner.repertoire.judge(action)
  if judgement.known and not judgement.few or not judgement.nearest:
    return ""
  learned = "learned little like" if judgement.known else "not learned"
  return (f"{planner.model.folder.name} has {learned} {shortened(prompt)}{_how_rare(planner, action)}; what it knows "
          f"nearest is {shortened(judgement.nearest[0][1])}, so expect something like that")


def _how_rare(planner, action):
  """Counts of the rare words of an action: " ('hook' in 2 of 2,365 phrases)"; "" without rare words."""
  counts = planner.repertoire.rare_words(action).items() if planner.repertoire else ()
  rare = ", ".join(f"{word!r} in {count}" for word, count in counts)
  return f" ({rare} of {len(planner.repertoire.phrases):,} phrases)" if rare else ""


def with_suggestion(model: Any, word: str) -> str:
  """The word in quotes; if the text encoder does not know it, with the closest known word as a suggestion."""
  known = sorted(model.encoder.known_words)
  if model.captions:
    vocabulary = model.captions.vocabulary
    known = sorted({*vocabulary.words, *(other for other in known if not vocabulary.missing(other))})
  other = "" if any(map(model.encoder.is_piece, possible_bases(word.lower()))) else closest_word(word, known)
  return f"{word!r} (did you mean {other!r}?)" if other else repr(word)


def shortened(text: str) -> str:
  """The text in quotes, cut where it is long."""
  return repr(text if len(text) <= 120 else text[:119] + "…")
