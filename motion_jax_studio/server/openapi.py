"""`GET /openapi.json`: the HTTP part of docs/protocol.md for programs, from the types by which requests are read."""
from typing import Any

import motion_jax
from motion_jax_studio.server import fields, serialization
from motion_jax_studio.server.limits import Limits
from motion_jax_studio.server.request_types import types_of

_MOTION = {"$ref": "#/components/schemas/Motion"}
_REPORT = {"type": "object", "description": "the constraints as they are drawn, and the motion's distance from them in "
           "millimetres"}
_NOTES = {"notes": {"type": "array", "items": {"type": "string"}},
          "unknown": {"type": "array", "items": {"type": "string"}, "description": "words the model does not know"}}
_ERROR = {"type": "object", "properties": {"error": {"type": "object", "properties": {
    "status": {"type": "integer"}, "message": {"type": "string", "description": "one sentence"}}}}}
_REFUSALS = {"400": "the request is not valid", "401": "no token", "403": "sent by another page", "409": "cancelled",
             "413": "too large", "429": "too many requests", "500": "a fault of the program"}


def described(limits: Limits) -> dict[str, Any]:
  """An OpenAPI 3.1 document of the requests of /v1."""
  listed = lambda item: {"type": "array", "items": item}
  types = types_of(limits)
  bodies = fields.schemas([types.generate, types.multi_prompt, types.edit, types.export], limits)
  bodies["Edit"]["oneOf"] = [{"required": [name], "properties": {name: {"type": "array"}}}
                             for name in ("change", "keep")]
  paths = {
      "/v1/status": {"get": _answer("running streams and models", {"type": "object"})},
      "/v1/models": {"get": _answer("the models and their loading progress", {"type": "object"})},
      "/v1/progress": {"get": _answer("progress of the request with this x-work header", {"type": "object"})
                       | {"parameters": [_query("work", "the value of its x-work header")]}},
      "/v1/cancel": {"post": _answer("ends the request with this x-work header", {"type": "object"})
                     | {"parameters": [_query("work", "the value of its x-work header")]}},
      "/v1/suggestions": {"get": _answer("prompts that a model can do", {"type": "object"})
                          | {"parameters": [_query("model", "a name of /v1/models"),
                                            _query("words", "adds training captions of similar meaning")]}},
      "/v1/generate": {"post": _request("motions of one prompt", "Generate", {
          "motions": listed(_MOTION), "constraints": listed(_REPORT)} | _NOTES)},
      "/v1/multi-prompt": {"post": _request("one motion of several prompts", "MultiPrompt", {
          "motion": _MOTION, "constraints": _REPORT, "reused_frames": {"type": "integer"},
          "same_frames": {"type": "integer"}, "segments": listed({"type": "object", "properties": _NOTES | {
              "nearest": {"type": "string", "description": "the training caption closest to a prompt with notes"}}})
          } | _NOTES)},
      "/v1/edit": {"post": _request("regenerates frames of a motion", "Edit", {
          "motion": _MOTION, "made": fields.Spans.schema(limits)} | _NOTES)},
      "/v1/project": {"post": _request("validates a project and returns it with every field", {
          "type": "object", "required": ["format", "version", "model", "blocks"]}, {})},
      "/v1/import": {"post": {
          "summary": "the motion in a file", "parameters": [_query("name", "the name of the file", required=True)],
          "requestBody": {"content": {"application/octet-stream": {}}},
          "responses": _responses({"type": "object", "properties": {"motion": _MOTION}})}},
      "/v1/export": {"post": _request("a motion as a file", "Export", None)},
      "/v1/export-choices": {"get": {"summary": "formats and rigs of /v1/export", "responses": _responses(
          {"type": "object", "required": ["formats", "rigs"]})}},
  }
  return {"openapi": "3.1.0", "info": {"title": "motion_jax studio", "version": motion_jax.__version__},
          "security": [{"token": []}], "paths": paths,
          "components": {"schemas": {"Motion": serialization.SCHEMA, "Error": _ERROR} | bodies,
                         "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}}}


def _responses(schema):
  content = {"application/json": {"schema": schema}} if schema else {"application/octet-stream": {}}
  refused = {"application/json": {"schema": {"$ref": "#/components/schemas/Error"}}}
  return {"200": {"description": "done", "content": content},
          **{status: {"description": text, "content": refused} for status, text in _REFUSALS.items()}}


def _answer(summary, schema):
  return {"summary": summary, "responses": _responses(schema)}


def _query(name, description, required=False):
  return {"name": name, "in": "query", "required": required, "description": description, "schema": {"type": "string"}}


def _request(summary, body, answer):
  """A POST request. body: a JSON schema, or the name of one."""
  body = {"$ref": f"#/components/schemas/{body}"} if isinstance(body, str) else body
  return _answer(summary, None if answer is None else {"type": "object", "properties": answer}) | {
      "requestBody": {"required": True, "content": {"application/json": {"schema": body}}}}
