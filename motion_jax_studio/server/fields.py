"""Parsing of requests by the types of request_types.py: kinds of values with rules beyond a type, and error messages.

msgspec checks the JSON and describes the same types to OpenAPI (openapi.py). Its errors become one sentence: the field,
what came, what was expected. A field that is null counts as missing.
"""
import json
import re
from typing import Annotated, Any

import msgspec
import numpy as np

from motion_jax.control import files
from motion_jax.control.constraints import Constraint, KeepParts
from motion_jax.models.results import Motion
from motion_jax.utils.errors import InputError
from motion_jax.utils.text_files import is_text
from motion_jax_studio.server import serialization
from motion_jax_studio.server.limits import ChoiceError, Limits

_MOST_SPANS, _MOST_CHOICES = 100, 20


class Request(msgspec.Struct, forbid_unknown_fields=True):
  """A JSON object of a request, with one attribute per field."""

  def __post_init__(self):
    for field in msgspec.structs.fields(type(self)):
      value = getattr(self, field.name)
      if value is None and field.default_factory is not msgspec.NODEFAULT:
        setattr(self, field.name, field.default_factory())
      elif value is None and not field.required:
        setattr(self, field.name, field.default)
      if isinstance(value, str) and not is_text(value):
        raise InputError(f"got a {field.name} with bytes that are no UTF-8 text")


class _KindType(type):
  def __instancecheck__(cls, value):
    return isinstance(value, cls.returns)


class Kind(metaclass=_KindType):
  """A kind of value with rules beyond a type. returns: the type of what `read` returns, which msgspec checks."""
  returns: type | tuple[type, ...] = object

  @classmethod
  def read(cls, value: Any, limits: Limits) -> Any:
    """The value of a JSON value. Raises InputError with one sentence, or ValueError, for one that is not allowed."""
    raise NotImplementedError

  @classmethod
  def schema(cls, limits: Limits) -> dict[str, Any]:
    """The JSON schema of a value."""
    raise NotImplementedError


def number(low: float, high: float, whole: bool = False) -> type[Kind]:
  """A number from low to high; whole: 3.0 is read as 3."""
  plain = Annotated[int if whole else float, msgspec.Meta(ge=low, le=high)]

  class Number(Kind):
    returns = int, float

    @classmethod
    def read(cls, value, limits):
      value = int(value) if whole and type(value) is float and value.is_integer() else value
      msgspec.convert(value, plain)
      return value

    @classmethod
    def schema(cls, limits):
      return msgspec.json.schema(plain)

  return Number


class Prompt(Kind):
  """Text for a model. Errors show an example."""
  returns = str

  @classmethod
  def read(cls, value, limits):
    if not isinstance(value, str):
      raise InputError(f"got the prompt {str(value)[:60]}, expected text in double quotes, such as \"a person waves\"")
    if not value.strip():
      raise InputError("got an empty prompt; say what the person does, as in \"a person waves\"")
    if len(value) > limits.prompt:
      raise InputError(f"got a prompt of {len(value):,} characters, expected at most {limits.prompt:,}")
    if not is_text(value):
      raise InputError("got a prompt with bytes that are no UTF-8 text")
    return value

  @classmethod
  def schema(cls, limits):
    return {"type": "string", "minLength": 1, "maxLength": limits.prompt, "pattern": r"\S"}


class Spans(Kind):
  """[[first, past], ...] in frames, 0 <= first < past."""
  returns = list

  @classmethod
  def read(cls, value, limits):
    spans = msgspec.convert(value, Annotated[list[tuple[int, int]], msgspec.Meta(min_length=1, max_length=_MOST_SPANS)])
    if not all(0 <= first < past for first, past in spans):
      raise ValueError("the order of a span")
    return spans

  @classmethod
  def schema(cls, limits):
    return {"type": "array", "minItems": 1, "maxItems": _MOST_SPANS, "examples": [[[20, 60]]], "items": {
        "type": "array", "minItems": 2, "maxItems": 2, "items": {"type": "integer", "minimum": 0}}}


class Sampling(Kind):
  """Sampling choices: names and plain values; the model checks which values it accepts."""
  returns = dict

  @classmethod
  def read(cls, value, limits):
    if not (isinstance(value, dict) and len(value) <= _MOST_CHOICES and all(
        item is None or type(item) in (int, float, str, bool) for item in value.values())):
      raise ChoiceError(f"got sampling {str(value)[:40]}, expected an object such as {{\"guidance_scale\": 3}}")
    return {str(key)[:60]: item for key, item in value.items() if item is not None}

  @classmethod
  def schema(cls, limits):
    return {"type": "object", "maxProperties": _MOST_CHOICES,
            "additionalProperties": {"type": ["number", "string", "boolean", "null"]}}


class Control(Kind):
  """Constraints in the form of docs/control.md."""
  returns = list

  @classmethod
  def read(cls, value, limits):
    try:
      constraints = files.from_json(value)
    except InputError as error:
      raise InputError(f"control: {error}") from None
    check_points(constraints, limits, "control")
    frames = max((len(kept.joints) for kept in constraints if isinstance(kept, KeepParts)), default=0)
    if frames > limits.frames:
      raise InputError(f"control: got {frames:,} frames to keep parts of, expected at most {limits.frames:,}")
    return constraints

  @classmethod
  def schema(cls, limits):
    return {"type": "object", "required": ["version", "constraints"], "properties": {
        "version": {"const": 1},
        "constraints": {"type": "array", "items": {"type": "object"}, "maxItems": files.MOST}}}


class MotionField(Kind):
  """A motion as /v1/generate returns it."""
  returns = Motion

  @classmethod
  def read(cls, value, limits):
    return serialization.from_json(value, limits.frames)

  @classmethod
  def schema(cls, limits):
    return {"$ref": "#/components/schemas/Motion"}


def parse(kind: type[Request], body: Any, limits: Limits) -> Any:
  """The request of a JSON object. Raises InputError for wrong, missing and unknown fields."""
  def read(of, value):
    try:
      return of.read(value, limits)
    except msgspec.ValidationError:  # which msgspec would pass on without the name of the field
      raise ValueError("not allowed") from None

  try:
    return msgspec.convert(body, kind, dec_hook=read)
  except UnicodeEncodeError as error:
    raise InputError(f"got {error.object[:40]!r}, expected text that can be written as UTF-8") from None
  except msgspec.ValidationError as error:
    raise _in_words(error, kind, body, limits) from None


def schemas(kinds: list[type[Request]], limits: Limits) -> dict[str, Any]:
  """{name: JSON schema} of types and of those in them, with references below "#/components/schemas/"."""
  return msgspec.json.schema_components(kinds, schema_hook=lambda of: of.schema(limits),
                                        ref_template="#/components/schemas/{name}")[1]


def _in_words(error, kind, body, limits):
  """The InputError of a msgspec error "what - at `$.field[0]`"."""
  what, _, place = str(error).partition(" - at `$")
  known = schemas([kind], limits)
  value, rule, name, index = body, known[kind.__name__], "", ""
  for field, index in re.findall(r"\.(\w+)|\[(\d+)\]", place):
    value = value[field] if field else value[int(index)]
    rule, name = _rule(rule["properties"][field] if field else rule["items"], known), field or name
  if lacks := re.fullmatch("Object missing required field `(.*)`", what):
    value, name, index = None, lacks[1], ""
    rule = _rule(rule["properties"][name], known)
  if value is None and name and not index or value == [] and "examples" in rule:
    return InputError(serialization.NO_MOTION if rule == serialization.SCHEMA else f"{name} is missing" if
                      "examples" not in rule else f"got no {name}, expected a list such as {_example(rule)}")
  if isinstance(error.__cause__, InputError):
    return error.__cause__
  if unknown := re.fullmatch("Object contains unknown field `(.*)`", what, re.DOTALL):
    return InputError(f"got the unknown field {unknown[1][:60]!r}, expected "
                      f"{'some of ' * bool(rule['properties'])}{', '.join(rule['properties']) or 'no field'}")
  if rule.get("type") == "object":
    return InputError(f"got {_kind_of(value)}, expected a JSON object such as {{\"prompt\": \"a person waves\"}}")
  if rule.get("type") == "array" and isinstance(value, list) and len(value) > rule.get("maxItems", len(value)):
    return InputError(f"got {len(value):,} {name}, expected at most {rule['maxItems']}")
  shown = f"{value[:40]!r}" if isinstance(value, str) else str(value)[:40]
  return InputError(f"got {shown} in {name}, expected {_expected(rule)}" if index else
                    f"got {name} {shown}, expected {_expected(rule)}")


def _rule(schema, known):
  """A schema without its reference and without null."""
  schema = next((option for option in schema.get("anyOf", ()) if option != {"type": "null"}), schema)
  name = schema.get("$ref", "").rpartition("/")[2]
  return serialization.SCHEMA if name == "Motion" else known.get(name, schema)


def _expected(rule):
  if "enum" in rule:
    return f"one of {', '.join(rule['enum'])}"
  if rule["type"] in ("integer", "number"):
    bounds = f" from {rule['minimum']:,} to {rule['maximum']:,}" if "maximum" in rule else ""
    return f"a {'whole ' * (rule['type'] == 'integer')}number{bounds}"
  if "maxLength" in rule:
    return f"a text of at most {rule['maxLength']} characters"
  if rule["type"] == "string":
    return "the bytes of a file in base64"
  if rule["type"] == "array" and "enum" in rule.get("items", ()):
    return f"a list, some of {', '.join(rule['items']['enum'])}"
  return "true or false" if rule["type"] == "boolean" else f"a list such as {_example(rule)}"


def _example(rule):
  return json.dumps(rule["examples"][0])


def check_points(constraints: list[Constraint], limits: Limits, name: str) -> None:
  """Raises InputError if paths and targets together have more points than a request may have."""
  count = sum(max((len(value) for field, value in vars(constraint).items()
                   if field != "joints" and isinstance(value, np.ndarray) and value.ndim), default=0)
              for constraint in constraints)
  if count > limits.points:
    raise InputError(f"{name}: got {count:,} points of paths and targets, expected at most {limits.points:,}")


def _kind_of(value):
  return {list: "a list", str: "a text", type(None): "nothing", bool: "a truth value"}.get(type(value), "a number")
