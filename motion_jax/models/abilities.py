"""Abilities of models, and the shipped models that have them."""
from motion_jax.utils.errors import InputError

ABILITIES = {  # each a method of that name
    "generate": "motion from prompts, one pass of the network",
    "sample_segments": "one motion of several segments, each with its own prompt",
    "stream": "motion without end, block after block",
    "multi_prompt": "several prompts in sequence, one motion",
    "extend": "continues an existing motion",
    "edit": "new frames in an existing motion",
    "reconstruct": "a motion through the tokenizer and back",
    "round_trip": "padded motions through the tokenizer and back",
    "graphs": "its networks as graphs that run without JAX",
}
_SEVERAL = {"edits": "edit", "multi_prompts": "multi_prompt"}  # methods of the same ability


class Able:
  """Base of everything that states its abilities, `can("edit")`: models, and their stand-ins in an evaluation."""
  abilities: tuple[str, ...] = ()  # of ABILITIES
  more_choices: tuple[str, ...] = ()  # of sampling, in addition to those of `options`
  ways: tuple[str, ...] = ()  # values of `multi_prompts(way=...)`, the default first; empty where there is no choice

  def can(self, ability: str) -> bool:
    """Whether it has this ability, one of `ABILITIES`. Raises InputError for any other word."""
    if ability not in ABILITIES:
      raise InputError(f"got the ability {ability!r}, expected one of {', '.join(ABILITIES)}")
    return ability in self.abilities


def cannot(name: str, ability: str) -> str:
  """The error text for a model that lacks an ability of `ABILITIES`: which shipped models have it."""
  from motion_jax import runs
  from motion_jax.models import registry
  able = runs.shipped_names(registry.model_stages(ability))
  return f"{name} has no {ability!r} ({ABILITIES[ability]}); " + (
      f"{', '.join(able)} {'has' if len(able) == 1 else 'have'}: load such a model (--model)" if able else
      "no model that ships has")


def missing_ability(model: Able, name: str) -> str | None:
  """The ability that provides the method `name`, where the model lacks it; None where it has it, or where no ability
  provides that method."""
  ability = _SEVERAL.get(name, name)
  return ability if ability in ABILITIES and not model.can(ability) else None
