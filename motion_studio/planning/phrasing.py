"""Plans in the words of kinematic captions, for models that were trained on those."""
from ml_collections import ConfigDict

from motion_studio.language import Action, Plan
from motion_studio.language.actions import going_forward, sides_of, with_one_hand


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
