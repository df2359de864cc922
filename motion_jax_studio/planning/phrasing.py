"""Plans in the words of kinematic captions, for models that were trained on those."""
from ml_collections import ConfigDict

from motion_jax_studio.language import Action, Plan
from motion_jax_studio.language.actions import sides_of
from motion_jax_studio.language.words import said

_WALKS = {"walks", "runs", "jogs", "is walking", "is running", "is jogging"}
_BARE_WALKS = {"walk", "run", "jog", "they walk", "they run", "they jog"}
_PUNCHES = {"punches" + where for where in (
    "", " air", " in air", " into air", " at air", " forward", " forwards", " ahead", " straight ahead")} | {
        f"{verb} with {fist}{where}" for verb in ("strikes", "hits") for fist in ("fist", "one fist")
        for where in ("", " forward", " forwards", " ahead")}


def wants_words_of_captions(config: ConfigDict) -> bool:
  """Whether a run gets actions in the words of its kinematic captions: a CDAMD model that was trained on them. CMDM
  models, whose text embeddings are of words, do as well with other words."""
  return config.stage.startswith("cdamd.") and bool(config.data.get("kinematic_captions", False))


def in_words_of_captions(plan: Plan) -> Plan:
  """The plan with the words of `analysis.describe`: "walks forward" for "walks", "punches with the left hand" for
  "punches"."""
  return plan.with_segments(tuple(part._replace(
      action=_reworded(part.action), simultaneous=tuple(map(_reworded, part.simultaneous))) for part in plan.segments))


def _reworded(action: Action) -> Action:
  prompt = with_one_hand(going_forward(action.prompt))
  if prompt == action.prompt or action.times > 1:
    return action
  subject = action.prompt.removesuffix(action.words)
  return action._replace(prompt=prompt, words=prompt.removeprefix(subject), sides=sides_of(prompt.split()),
                         reworded=True)


def going_forward(prompt: str) -> str:
  """The prompt with "forward" where it says no more than that somebody walks, runs or jogs.

  Captions by kinematics (`analysis.describe`) name every direction that the rules can detect, and say "walks" alone of
  the others.
  """
  bare = prompt.strip().rstrip(" .!")
  return f"{bare} forward" if said(bare).strip() in _BARE_WALKS or _subject_of(bare, _WALKS) else prompt


def with_one_hand(prompt: str) -> str:
  """The prompt with "the left hand" where it says no more than that somebody punches.

  Captions by kinematics name the hand of every single punch. Without it a network that learned them lifts both hands
  halfway. The left hand is the one that jabs.
  """
  subject = _subject_of(prompt.strip().rstrip(" .!"), _PUNCHES)
  return f"{subject} punches with the left hand" if subject else prompt


def _subject_of(prompt, endings):
  """The subject of a prompt that is no more than a subject of at most four words and one of some endings; else ""."""
  words = prompt.split()
  for at in range(1, min(len(words), 5)):
    first, *more = [word.lower() for word in words[:at]]
    is_subject = first in ("a", "an", "the", "one") and more and {"and", "then", "while"}.isdisjoint(more) or (
        not more and first in ("someone", "somebody", "he", "she"))
    if is_subject and said(" ".join(words[at:])).strip() in endings:
      return " ".join(words[:at])
  return ""
