"""Fields of requests: each kind of value states once how it is read and how OpenAPI describes it.

A request is a table {name: Field}. `parse` reads a JSON object by it, `schema` describes it (openapi.py), so that the
two cannot differ. A field that is null is treated as missing. Bounds may be the name of a field of `Limits`.
"""
import base64
import dataclasses
import math
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from motion_jax.control import files
from motion_jax.control.constraints import Constraint, KeepParts
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import SEEDS
from motion_jax.utils.text_files import is_text
from motion_jax_studio.server import serialization
from motion_jax_studio.server.limits import ChoiceError, Limits

REQUIRED = object()
_MOST_SPANS, _MOST_CHOICES = 100, 20
# Arguments of model methods that are not sampling choices.
_NO_CHOICES = frozenset((
    "self", "prompt", "prompts", "segments", "lists", "clip", "clips", "motion", "seed", "seeds", "rng", "seconds",
    "num_frames", "cleanup", "polish", "literal", "plan", "control", "project", "keep", "change", "task", "past",
    "past_prompt", "hold_until_done", "ease", "rest", "way", "num_past", "paste", "mask", "without",
    "negative_prompts"))


@dataclasses.dataclass(frozen=True, kw_only=True)
class Field:
  """A field of any value. default: REQUIRED, or its value where it is missing; about: its description."""
  default: Any = REQUIRED
  about: str = ""

  def read(self, value: Any, name: str, limits: Limits) -> Any:
    """The parsed value. Raises InputError with one sentence for a value that is not allowed."""
    return value

  def missing(self, name: str) -> str:
    """The sentence of the error if a required field is missing."""
    return f"{name} is missing"

  def value_schema(self, limits: Limits) -> dict[str, Any]:
    """The JSON schema of a value that is not null."""
    return {}

  def schema(self, limits: Limits) -> dict[str, Any]:
    """The JSON schema of the field: with null, default and description."""
    found = self.value_schema(limits)
    if self.default is not REQUIRED and found:
      found = found | {"type": [found["type"], "null"]} if "type" in found else {"anyOf": [found, {"type": "null"}]}
    if self.default is not REQUIRED and self.default not in (None, ()):
      found = found | {"default": self.default}
    return found | ({"description": self.about} if self.about else {})


@dataclasses.dataclass(frozen=True)
class Text(Field):
  longest: int = 200

  def read(self, value, name, limits):
    if not isinstance(value, str) or not is_text(value) or len(value) > self.longest:
      raise InputError(f"got {name} {str(value)[:40]!r}, expected a text of at most {self.longest} characters")
    return value

  def value_schema(self, limits):
    return {"type": "string", "maxLength": self.longest}


@dataclasses.dataclass(frozen=True)
class Bytes(Field):
  """The bytes of a file, in base64."""

  def read(self, value, name, limits):
    try:
      return base64.b64decode(value, validate=True)
    except (TypeError, ValueError):
      raise InputError(f"got a {name} that is not in base64, expected the bytes of a file") from None

  def value_schema(self, limits):
    return {"type": "string", "contentEncoding": "base64",
            "pattern": "^([A-Za-z0-9+/]{4})*([A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=)?$"}


@dataclasses.dataclass(frozen=True)
class Choice(Field):
  """One of several words."""
  options: tuple[str, ...]

  def read(self, value, name, limits):
    if value not in self.options or not isinstance(value, str):
      raise InputError(f"got the {name} {str(value)[:20]!r}, expected one of {', '.join(self.options)}")
    return value

  def value_schema(self, limits):
    return {"type": "string", "enum": list(self.options)}


@dataclasses.dataclass(frozen=True)
class Prompt(Field):
  def read(self, value, name, limits):
    return check_prompt(value, limits)

  def value_schema(self, limits):
    return {"type": "string", "minLength": 1, "maxLength": limits.prompt, "pattern": r"\S"}


@dataclasses.dataclass(frozen=True)
class Number(Field):
  low: float
  high: float | str
  whole: bool = False

  def read(self, value, name, limits):
    high = _bound(self.high, limits)
    fits = type(value) is int or type(value) is float and (value.is_integer() if self.whole else math.isfinite(value))
    if not fits or not self.low <= value <= high:
      raise InputError(f"got {name} {str(value)[:40]}, expected a {'whole ' if self.whole else ''}number from "
                       f"{self.low:,} to {high:,}")
    return int(value) if self.whole else value

  def value_schema(self, limits):
    return {"type": "integer" if self.whole else "number", "minimum": self.low, "maximum": _bound(self.high, limits)}


def seed(default: Any = 0) -> Number:
  return Number(*SEEDS, whole=True, default=default, about="random seed")


@dataclasses.dataclass(frozen=True)
class Switch(Field):
  def read(self, value, name, limits):
    if not isinstance(value, bool):
      raise InputError(f"got {name} {str(value)[:40]!r}, expected true or false")
    return value

  def value_schema(self, limits):
    return {"type": "boolean"}


@dataclasses.dataclass(frozen=True)
class Steps(Field):
  """Names of steps to leave out."""
  names: tuple[str, ...]

  def read(self, value, name, limits):
    unknown = [one for one in value if one not in self.names] if isinstance(value, list) else [value]
    if unknown:
      raise InputError(f"got {str(unknown[0])[:40]!r} in {name}, expected a list of steps, some of "
                       f"{', '.join(self.names)}")
    return frozenset(value)

  def value_schema(self, limits):
    return {"type": "array", "items": {"type": "string", "enum": list(self.names)}}


@dataclasses.dataclass(frozen=True)
class Spans(Field):
  """[[first, past], ...] in frames, 0 <= first < past."""

  def read(self, value, name, limits):
    if not (isinstance(value, list) and 0 < len(value) <= _MOST_SPANS and all(
        isinstance(span, list) and len(span) == 2 and all(type(frame) is int for frame in span)
        and 0 <= span[0] < span[1] for span in value)):
      raise InputError(f"got {name} {str(value)[:40]}, expected spans of frames such as [[20, 60]]")
    return [tuple(span) for span in value]

  def value_schema(self, limits):
    return {"type": "array", "minItems": 1, "maxItems": _MOST_SPANS, "items": {
        "type": "array", "minItems": 2, "maxItems": 2, "items": {"type": "integer", "minimum": 0}}}


@dataclasses.dataclass(frozen=True)
class Sampling(Field):
  """Sampling choices: names and plain values; the model checks which values it accepts."""

  def read(self, value, name, limits):
    if not (isinstance(value, dict) and len(value) <= _MOST_CHOICES and all(
        item is None or type(item) in (int, float, str, bool) for item in value.values())):
      raise ChoiceError(f"got {name} {str(value)[:40]}, expected an object such as {{\"guidance_scale\": 3}}")
    if unknown := sorted(_NO_CHOICES & set(value)):
      raise ChoiceError(f"got {unknown[0]!r} in {name}, which is not a sampling choice; use the request's field of "
                        "that name, if there is one")
    return {str(key)[:60]: item for key, item in value.items() if item is not None}

  def value_schema(self, limits):
    return {"type": "object", "maxProperties": _MOST_CHOICES, "propertyNames": {"not": {"enum": sorted(_NO_CHOICES)}},
            "additionalProperties": {"type": ["number", "string", "boolean", "null"]}}


@dataclasses.dataclass(frozen=True)
class Control(Field):
  """Constraints in the form of docs/control.md."""

  def read(self, value, name, limits):
    try:
      found = files.from_json(value)
    except InputError as error:
      raise InputError(f"{name}: {error}") from None
    check_points(found, limits, name)
    frames = max((len(one.joints) for one in found if isinstance(one, KeepParts)), default=0)
    if frames > limits.frames:
      raise InputError(f"{name}: got {frames:,} frames to keep parts of, expected at most {limits.frames:,}")
    return found

  def value_schema(self, limits):
    return {"type": "object", "required": ["version", "constraints"], "properties": {
        "version": {"const": 1},
        "constraints": {"type": "array", "items": {"type": "object"}, "maxItems": files.MOST}}}


@dataclasses.dataclass(frozen=True)
class MotionField(Field):
  """A motion as /v1/generate returns it."""

  def missing(self, name):
    return serialization.NO_MOTION

  def read(self, value, name, limits):
    return serialization.from_json(value, limits.frames)

  def value_schema(self, limits):
    return {"$ref": "#/components/schemas/Motion"}


@dataclasses.dataclass(frozen=True)
class Record(Field):
  """An object with a table of fields."""
  table: Mapping[str, Field]

  def read(self, value, name, limits):
    return parse(self.table, value, limits)

  def value_schema(self, limits):
    return schema(self.table, limits)


@dataclasses.dataclass(frozen=True)
class Listed(Field):
  """A list of fields of one kind."""
  item: Field
  longest: int | str
  example: str
  shortest: int = 1

  def missing(self, name):
    return f"got no {name}, expected a list such as {self.example}"

  def read(self, value, name, limits):
    longest = _bound(self.longest, limits)
    if not isinstance(value, list) or len(value) < self.shortest:
      raise InputError(self.missing(name))
    if len(value) > longest:
      raise InputError(f"got {len(value):,} {name}, expected at most {longest}")
    return [self.item.read(one, name.removesuffix("s"), limits) for one in value]

  def value_schema(self, limits):
    return {"type": "array", "items": self.item.value_schema(limits), "minItems": self.shortest,
            "maxItems": _bound(self.longest, limits)}


def parse(table: Mapping[str, Field], value: Any, limits: Limits) -> SimpleNamespace:
  """The fields of a JSON object as attributes. Raises InputError for wrong, missing and unknown fields."""
  if not isinstance(value, dict):
    raise InputError(f"got {_kind_of(value)}, expected a JSON object such as {{\"prompt\": \"a person waves\"}}")
  found = SimpleNamespace()
  for name, field in table.items():
    given = value.get(name)
    if given is None and field.default is REQUIRED:
      raise InputError(field.missing(name))
    setattr(found, name, field.default if given is None else field.read(given, name, limits))
  if unknown := set(value) - set(table):
    raise InputError(f"got the unknown field {str(min(unknown, key=str))[:60]!r}; docs/protocol.md lists all fields")
  return found


def schema(table: Mapping[str, Field], limits: Limits) -> dict[str, Any]:
  """The JSON schema of an object that `parse` reads."""
  return {"type": "object", "required": [name for name, field in table.items() if field.default is REQUIRED],
          "properties": {name: field.schema(limits) for name, field in table.items()}, "additionalProperties": False}


def check_points(constraints: list[Constraint], limits: Limits, name: str) -> None:
  """Raises InputError if paths and targets together have more points than a request may have."""
  count = sum(max((len(value) for field, value in vars(one).items()
                   if field != "joints" and isinstance(value, np.ndarray) and value.ndim), default=0)
              for one in constraints)
  if count > limits.points:
    raise InputError(f"{name}: got {count:,} points of paths and targets, expected at most {limits.points:,}")


def check_prompt(value: Any, limits: Limits) -> str:
  """A valid prompt. Raises InputError for an empty prompt, a long one, and one that is not text."""
  if not isinstance(value, str):
    raise InputError(f"got the prompt {str(value)[:60]}, expected text in double quotes, such as \"a person waves\"")
  if not value.strip():
    raise InputError("got an empty prompt; say what the person does, as in \"a person waves\"")
  if len(value) > limits.prompt:
    raise InputError(f"got a prompt of {len(value):,} characters, expected at most {limits.prompt:,}")
  if not is_text(value):
    raise InputError("got a prompt with bytes that are no UTF-8 text")
  return value


def _bound(value, limits):
  return getattr(limits, value) if isinstance(value, str) else value


def _kind_of(value):
  return {list: "a list", str: "a text", type(None): "nothing", bool: "a truth value"}.get(type(value), "a number")
