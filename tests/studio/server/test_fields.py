"""The parser of requests and their OpenAPI schema agree: what the schema allows is read, what it forbids is refused."""
import json
import re

import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.utils.errors import InputError
from motion_jax_studio.server import fields, openapi, serialization
from motion_jax_studio.server.limits import Limits
from motion_jax_studio.server.request_tables import EDIT, EXPORT, GENERATE, MESSAGES, MULTI_PROMPT, PROJECT

LIMITS = Limits(prompt=30, blocks=3)
MOTION = serialization.to_json(synthetic_clips(seed=0, num=1)[0])
CONTROL = {"version": 1, "constraints": [{"type": "root_path", "points": [[0, 0], [2, 0]]}]}
TABLES = {"generate": GENERATE, "multi_prompt": MULTI_PROMPT, "edit": EDIT, "export": EXPORT, "project": PROJECT,
          **{f"message {name}": table for name, table in MESSAGES.items()}}
VALID = {"prompt": "a person waves", "segments": [{"prompt": "walks"}], "blocks": [{"prompt": "walks", "seconds": 4}],
         "motion": MOTION, "format": "bvh", "model": {"name": "tiny"}, "value": 1, "sequence": 3}
# Values for every field, without those that break rules beyond a JSON schema, such as the order of a span.
VALUES = [None, True, False, 0, 1, 1.0, 1.5, -1, 3, 8, 9, 40_000, 1e9, 2**32, "", " ", "x", "bvh", "y" * 31,
          "z" * 201, "z" * 1001, [], {}, [1], [[0, 5]], [[0, 5], [7, 9]], [[0]], [[0.5, 2]], [[0, 5]] * 101, [0, 1],
          [0] * 9, ["x"], {"num_steps": 4}, {"a": [1]}, {"seed": 3}, {"a": None}, {str(i): 1 for i in range(21)},
          MOTION, CONTROL, CONTROL | {"version": 2}, {"name": "tiny"}, {"name": "tiny", "id": 5}, {"nam": "tiny"},
          [{"prompt": "walks"}], [{"prompt": "walks", "seconds": 0}], [{"prompt": "walks", "length": 4}], [{}],
          [{"prompt": "walks"}] * 4, [{"prompt": "kicks", "change": [[0, 5]], "model": {"name": "editor"}}],
          [{"prompt": "kicks", "model": {"name": "editor"}}]]
TYPES = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}


def allows(schema, value):
  """Whether a JSON schema of the keywords that `fields` uses allows a value."""
  if "$ref" in schema:
    return allows(serialization.SCHEMA, value)
  if "anyOf" in schema and not any(allows(one, value) for one in schema["anyOf"]):
    return False
  if "const" in schema and value != schema["const"] or "enum" in schema and value is not None and (
      value not in schema["enum"]):
    return False
  kinds = schema.get("type", [])
  kinds = [kinds] if isinstance(kinds, str) else kinds
  if kinds and not any(_is(value, kind) for kind in kinds):
    return False
  if isinstance(value, str):
    return schema.get("minLength", 0) <= len(value) <= schema.get("maxLength", 10**6) and bool(
        re.search(schema.get("pattern", ""), value))
  if isinstance(value, list):
    return schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", 10**6) and all(
        allows(schema.get("items", {}), one) for one in value)
  if isinstance(value, dict):
    known, names = schema.get("properties", {}), schema.get("propertyNames", {}).get("not", {}).get("enum", ())
    rest = schema.get("additionalProperties", True)
    return (set(schema.get("required", ())) <= set(value) and len(value) <= schema.get("maxProperties", 10**6)
            and not set(names) & set(value)
            and all(allows(known[name], one) if name in known else rest is True or rest and allows(rest, one)
                    for name, one in value.items()))
  if isinstance(value, int | float) and not isinstance(value, bool):
    return schema.get("minimum", -1e99) <= value <= schema.get("maximum", 1e99)
  return True


def _is(value, kind):
  if kind in ("number", "integer"):
    return isinstance(value, int | float) and not isinstance(value, bool) and (kind == "number" or value == int(value))
  return isinstance(value, TYPES[kind])


def parses(table, body):
  try:
    fields.parse(table, body, LIMITS)
  except InputError as error:
    assert "\n" not in str(error)
    return False
  return True


@pytest.mark.parametrize("name", TABLES)
def test_the_schema_and_the_parser_agree(name):
  table = TABLES[name]
  schema = json.loads(json.dumps(fields.schema(table, LIMITS)))
  valid = {field: VALID[field] if field != "model" or name == "project" else "tiny" for field, kind in table.items()
           if kind.default is fields.REQUIRED}
  assert parses(table, valid) and allows(schema, valid)
  for field in table:
    for value in VALUES:
      body = valid | {field: value}
      assert parses(table, body) == allows(schema, body), (field, str(value)[:60])
  for field in valid:
    body = {other: value for other, value in valid.items() if other != field}
    assert not parses(table, body) and not allows(schema, body), field
  for body in (valid | {"strange": 1}, [], "x", None, 3):
    assert not parses(table, body) and not allows(schema, body)


def test_motions_of_control_have_a_limit_of_frames():
  kept = {"type": "keep_parts", "parts": ["legs"], "joints": [synthetic_clips(0, 1)[0].joints[0].tolist()] * 11}
  rows = {"version": 1, "constraints": [kept]}
  assert fields.Control().read(rows, "control", Limits(frames=11))
  with pytest.raises(InputError, match="control: got 11 frames to keep parts of, expected at most 10"):
    fields.Control().read(rows, "control", Limits(frames=10))


def test_the_document_has_every_request_and_its_table(client):
  paths = client.get("/openapi.json").json()["paths"]
  assert set(paths) == {f"/v1/{name}" for name in (
      "status", "models", "progress", "cancel", "suggestions", "generate", "multi-prompt", "edit", "project", "import",
      "export", "export-choices")}
  for path, table in (("generate", GENERATE), ("multi-prompt", MULTI_PROMPT), ("edit", EDIT), ("export", EXPORT)):
    body = paths[f"/v1/{path}"]["post"]["requestBody"]["content"]["application/json"]["schema"]
    assert list(body["properties"]) == list(table)
  assert openapi.described(LIMITS)["paths"]["/v1/generate"]["post"]["requestBody"]["content"]["application/json"][
      "schema"]["properties"]["prompt"]["maxLength"] == 30
