"""Plans in the words of kinematic captions, for models that were trained on those."""
import re

from ml_collections import ConfigDict

from motion_jax_studio.language import Action, Plan
from motion_jax_studio.language.actions import sides_of

_SUBJECT = r"(?:someone|somebody|he|she|(?:a|an|the|one)(?: (?!and |then |while )[\w'-]+){1,3})"
_WALKS = re.compile(rf"(?:{_SUBJECT} (?:(?:walk|run|jog)s|is (?:walking|running|jogging))|(?:they )?(?:walk|run|jog))",
                    re.IGNORECASE)
_PUNCHES = re.compile(rf"({_SUBJECT}) (?:punches(?: forwards?| (?:straight )?ahead| (?:in |into |at )?the air)?|"
                      r"(?:strikes|hits) with (?:the|a|one|his|her|their) fist(?: forwards?| ahead)?)", re.IGNORECASE)


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
  return f"{bare} forward" if _WALKS.fullmatch(" ".join(bare.split())) else prompt


def with_one_hand(prompt: str) -> str:
  """The prompt with "the left hand" where it says no more than that somebody punches.

  Captions by kinematics name the hand of every single punch. Without it a network that learned them lifts both hands
  halfway. The left hand is the one that jabs.
  """
  found = _PUNCHES.fullmatch(" ".join(prompt.strip().rstrip(" .!").split()))
  return f"{found[1]} punches with the left hand" if found else prompt
