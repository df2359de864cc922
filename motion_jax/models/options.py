"""How a model is sampled: the choices of a method, described once for Python, the command line, evaluation and records.

Each method has one frozen dataclass of its choices, a field each, that says what the choice is about, what is allowed
and where its usual value comes from:

  @dataclasses.dataclass(frozen=True)
  class TinySampling(SamplingOptions):
    num_steps: int | None = number("steps of the sampler", STEPS)
    order: str | None = choice("which latents are made first", ("random", "left_to_right"))

None means "as the run was trained to be sampled", its config.sampler; `resolved` puts that in. Nothing here imports
jax, so that `motion-jax generate --help` answers at once.
"""
import dataclasses
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import GUIDANCE, NumberError, bounds, checked, real, require_numbers, shortened, whole

if TYPE_CHECKING:
  from ml_collections import ConfigDict


class Description(NamedTuple):
  """Description of one choice.

  check(value, name) -> value, or raises InputError. read: parses the text of a command-line flag; the flag is the name
  with dashes, `--num-steps`. allowed: the allowed values in words, for a table. choices: all allowed values, where they
  can be listed. key: its name in config.sampler. usual: the default where the config has none.
  """
  help: str
  check: Callable
  read: Callable
  allowed: str
  choices: tuple | None = None
  key: str | None = None
  usual: Any = None


def number(help: str, limits: tuple[Any, Any], kind: type = int, unit: str = "", **more: Any) -> Any:
  """A choice that is a number from limits[0] to limits[1], whole or, of kind float, any."""
  def check(value, name):
    require_numbers([value], name, f"a number{bounds(*limits)}")
    return checked(value, *limits, name, unit, kind)

  read = whole(*limits) if kind is int else real(*limits)
  return _field(Description(help, check, read, f"number{bounds(*limits)}", **more))


def choice(help: str, choices: Sequence[str], listed: bool = True, **more: Any) -> Any:
  """A choice among named values. listed=False: which of them are valid depends on the model, and the command line
  accepts any text."""
  def check(value, name):
    if value not in choices:
      allowed = " or ".join(choices) if len(choices) == 2 else f"one of {', '.join(choices)}"
      raise InputError(f"got {name} {value!r}, expected {allowed}")
    return value

  return _field(Description(help, check, str, ", ".join(choices), tuple(choices) if listed else None, **more))


def switch(help: str, **more: Any) -> Any:
  """A choice between true and false."""
  def check(value, name):
    if value not in (True, False):
      raise InputError(f"got {name} {value!r}, expected true or false")
    return bool(value)

  def read(text):
    if text.lower() not in ("true", "false"):
      raise NumberError(f"got {shortened(text)!r}, expected true or false")
    return text.lower() == "true"

  return _field(Description(help, check, read, "true, false", **more))


def _field(description):
  return dataclasses.field(default=None, metadata={"choice": description})


_Options = TypeVar("_Options", bound="SamplingOptions")


@dataclasses.dataclass(frozen=True)
class SamplingOptions:
  """The choices that every method has; those of one method are a subclass. Hashable, so that jit can depend on them."""
  guidance_scale: float | None = number("classifier-free guidance scale", GUIDANCE, float)

  def __post_init__(self) -> None:
    for name, description in self.described().items():
      value = getattr(self, name)
      if value is not None:
        object.__setattr__(self, name, description.check(value, name))

  @classmethod
  def described(cls) -> dict[str, Description]:
    """{name: its Description} of all choices."""
    return {field.name: field.metadata["choice"] for field in dataclasses.fields(cls)}

  def resolved(self: _Options, config: "ConfigDict", **usual: Any) -> _Options:
    """A copy with every choice set: None is replaced by `usual`, else by the run's config, else by the method's
    default.

    Subclasses override it to check what depends on several choices, or on the model.
    """
    choices = {}
    for name, description in self.described().items():
      if getattr(self, name) is None:
        value = usual[name] if name in usual else config.sampler.get(description.key or name, description.usual)
        choices[name] = value
    options = dataclasses.replace(self, **choices)
    most, steps = config.get("diffusion", {}).get("num_steps"), getattr(options, "num_steps", None)
    if most and steps and steps > most:  # trained on a table of this many noise levels
      raise InputError(f"got {steps} sampler steps, this model was trained with {most}; give at most as many")
    return options

  def about(self) -> dict[str, Any]:
    """The choices as a dict, for the record of a motion and for files."""
    return dataclasses.asdict(self)


def table(options: type[SamplingOptions]) -> str:
  """The choices of a method as a table in Markdown, for the docs."""
  rows = [f"| `{name}` | `--{name.replace('_', '-')}` | {known.allowed} | {known.help} |"
          for name, known in options.described().items()]
  return "\n".join(["| choice | command line | allowed | what it is |", "|---|---|---|---|", *rows]) + "\n"
