"""The parser of requests and their OpenAPI schema agree: what the schema allows is read, what it forbids is refused."""
import json
import re

import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.utils.errors import InputError
from motion_jax_studio.server import fields, openapi, serialization
from motion_jax_studio.server.limits import Limits
from motion_jax_studio.server.request_types import types_of

LIMITS = Limits(prompt=30, blocks=3)
MOTION = serialization.to_json(synthetic_clips(seed=0, num=1)[0])
CONTROL = {"version": 1, "constraints": [{"type": "root_path", "points": [[0, 0], [2, 0]]}]}
TYPES = vars(types_of(LIMITS)) | {f"message {name}": kind for name, kind in types_of(LIMITS).messages.items()}
del TYPES["messages"]
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
JSON = {"object": dict, "array": list, "string": str, "boolean": bool, "null": type(None)}


def allows(schema, value, known):
  """Whether a JSON schema of the keywords that `fields` uses allows a value; known: schemas by name."""
  if "$ref" in schema:
    return allows(known[schema["$ref"].rpartition("/")[2]], value, known)
  if "anyOf" in schema and not any(allows(option, value, known) for option in schema["anyOf"]):
    return False
  if "const" in schema and value != schema["const"] or "enum" in schema and value not in schema["enum"]:
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
        allows(schema.get("items", {}), item, known) for item in value)
  if isinstance(value, dict):
    fields, names = schema.get("properties", {}), schema.get("propertyNames", {}).get("not", {}).get("enum", ())
    rest = schema.get("additionalProperties", True)
    return (set(schema.get("required", ())) <= set(value) and len(value) <= schema.get("maxProperties", 10**6)
            and not set(names) & set(value)
            and all(allows(fields[name], part, known) if name in fields else
                    rest is True or rest and allows(rest, part, known) for name, part in value.items()))
  if isinstance(value, int | float) and not isinstance(value, bool):
    return schema.get("minimum", -1e99) <= value <= schema.get("maximum", 1e99)
  return True


def _is(value, kind):
  if kind in ("number", "integer"):
    return isinstance(value, int | float) and not isinstance(value, bool) and (kind == "number" or value == int(value))
  return isinstance(value, JSON[kind])


def parses(kind, body):
  try:
    fields.parse(kind, body, LIMITS)
  except InputError as error:
    assert "\n" not in str(error)
    return False
  return True


@pytest.mark.parametrize("name", TYPES)
def test_the_schema_and_the_parser_agree(name):
  kind = TYPES[name]
  known = json.loads(json.dumps(fields.schemas([kind], LIMITS))) | {"Motion": serialization.SCHEMA}
  schema = known[kind.__name__]
  valid = {field: VALID[field] if field != "model" or name == "project" else "tiny" for field in schema["required"]}
  assert parses(kind, valid) and allows(schema, valid, known)
  for field in schema["properties"]:
    for value in VALUES:
      body = valid | {field: value}
      assert parses(kind, body) == allows(schema, body, known), (field, str(value)[:60])
  for field in valid:
    body = {other: value for other, value in valid.items() if other != field}
    assert not parses(kind, body) and not allows(schema, body, known), field
  for body in (valid | {"strange": 1}, [], "x", None, 3):
    assert not parses(kind, body) and not allows(schema, body, known)


@pytest.mark.parametrize("body, sentence", [
    ({"seed": 10**400}, "got seed 1000000000000000000000000000000000000000, expected a whole number from 0 to 4,294,"),
    ({"seconds": True}, "got seconds True, expected a number from 0.2 to 120"),
    ({"cleanup": "yes"}, "got cleanup 'yes', expected true or false"),
    ({"model": 5}, "got model 5, expected a text of at most 200 characters"),
    ({"model": "a\ud800"}, "got a model with bytes that are no UTF-8 text"),
    ({"without": ["jump"]}, "got 'jump' in without, expected one of check, cleanup, constrain, correct, plan, "),
    ({"without": "plan"}, "got without 'plan', expected a list, some of check, cleanup, "),
    ({"segments": []}, 'got no segments, expected a list such as [{"prompt": "a person walks", "seconds": 4}]'),
    ({"segments": [{"prompt": "walks"}] * 4}, "got 4 segments, expected at most 3"),
    ({"segments": [{"prompt": "walks", "seconds": -1}]}, "got seconds -1, expected a number from 0.2 to 120"),
    ({"segments": ["walks"]}, "got a text, expected a JSON object such as "),
    ({"segments": [{"prompt": "walks", "length": 4}]}, "got the unknown field 'length', expected some of prompt, "),
    ({"trim": [[5, 0]]}, "got trim [[5, 0]], expected a list such as [[20, 60]]"),
    ({"format": "exe"}, "got format 'exe', expected one of amass.npz, bvh, "),
    ({"character": "@"}, "got character '@', expected the bytes of a file in base64"),
    ({"motion": None}, "got no motion, expected an object with shape, joints and fps as /v1/generate returns it"),
    ({"seeds": [0, -1]}, "got -1 in seeds, expected a whole number from 0 to")])
def test_an_error_names_the_field_what_came_and_what_was_expected(body, sentence):
  """One sentence for each kind of value, in the request that has the field."""
  name = next(name for name, kind in TYPES.items() if set(body) <= set(kind.__struct_fields__))
  required = fields.schemas([TYPES[name]], LIMITS)[TYPES[name].__name__]["required"]
  valid = {field: VALID[field] for field in required}
  with pytest.raises(InputError) as error:
    fields.parse(TYPES[name], valid | body, LIMITS)
  assert str(error.value).startswith(sentence)


def test_motions_of_control_have_a_limit_of_frames():
  kept = {"type": "keep_parts", "parts": ["legs"], "joints": [synthetic_clips(0, 1)[0].joints[0].tolist()] * 11}
  rows = {"version": 1, "constraints": [kept]}
  assert fields.Control.read(rows, Limits(frames=11))
  with pytest.raises(InputError, match="control: got 11 frames to keep parts of, expected at most 10"):
    fields.Control.read(rows, Limits(frames=10))


def test_the_document_has_every_request_and_its_type(client):
  document = client.get("/openapi.json").json()
  paths, schemas = document["paths"], document["components"]["schemas"]
  assert set(paths) == {f"/v1/{name}" for name in (
      "status", "models", "progress", "cancel", "suggestions", "generate", "multi-prompt", "edit", "project", "import",
      "export", "export-choices")}
  for path, name in (("generate", "Generate"), ("multi-prompt", "MultiPrompt"), ("edit", "Edit"), ("export", "Export")):
    body = paths[f"/v1/{path}"]["post"]["requestBody"]["content"]["application/json"]["schema"]
    assert body == {"$ref": f"#/components/schemas/{name}"}
    assert tuple(schemas[name]["properties"]) == TYPES[path.replace("-", "_")].__struct_fields__
  references = set(re.findall('"#/components/schemas/(.*?)"', json.dumps(document)))
  assert {"Motion", "Segment", "Error"} < references <= set(schemas)
  assert openapi.document(LIMITS)["components"]["schemas"]["Generate"]["properties"]["prompt"]["maxLength"] == 30
