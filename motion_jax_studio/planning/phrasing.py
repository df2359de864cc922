"""Plans in the words of kinematic captions (`analysis.describe`), for models that were trained on these."""
from ml_collections import ConfigDict

from motion_jax_studio.language import Action, Plan
from motion_jax_studio.language.parts import sides_of
from motion_jax_studio.language.words import normalize

_WALKS = {"walks", "runs", "jogs", "is walking", "is running", "is jogging"}
_BARE_WALKS = {"walk", "run", "jog", "they walk", "they run", "they jog"}
_PUNCHES = {"punches" + where for where in (
    "", " air", " in air", " into air", " at air", " forward", " forwards", " ahead", " straight ahead")} | {
        f"{verb} with {fist}{where}" for verb in ("strikes", "hits") for fist in ("fist", "one fist")
        for where in ("", " forward", " forwards", " ahead")}


def wants_words_of_captions(config: ConfigDict) -> bool:
  """Whether prompts are reworded for a model: a CDAMD model that was trained on kinematic captions. CMDM models, with
  text embeddings of single words, do as well with other words."""
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
  return action.replace(prompt=prompt, words=prompt.removeprefix(subject), sides=sides_of(prompt.split()),
                         reworded=True)


def going_forward(prompt: str) -> str:
  """The prompt with "forward" added if it only says that a person walks, runs or jogs.

  Kinematic captions name each direction that the rules detect; "walks" alone stands for a direction that they do not.
  """
  bare = prompt.strip().rstrip(" .!")
  return f"{bare} forward" if normalize(bare).strip() in _BARE_WALKS or _subject_of(bare, _WALKS) else prompt


def with_one_hand(prompt: str) -> str:
  """The prompt with "the left hand" added if it only says that a person punches.

  Kinematic captions name the hand of every single punch; without a hand, a network that learned them lifts both hands
  halfway. Jabs are made with the left hand.
  """
  subject = _subject_of(prompt.strip().rstrip(" .!"), _PUNCHES)
  return f"{subject} punches with the left hand" if subject else prompt


def _subject_of(prompt, endings):
  """The subject, of up to four words, of a prompt that continues with exactly one of `endings`; else ""."""
  words = prompt.split()
  for at in range(1, min(len(words), 5)):
    first, *more = [word.lower() for word in words[:at]]
    is_subject = first in ("a", "an", "the", "one") and more and {"and", "then", "while"}.isdisjoint(more) or (
        not more and first in ("someone", "somebody", "he", "she"))
    if is_subject and normalize(" ".join(words[at:])).strip() in endings:
      return " ".join(words[:at])
  return ""
