"""The requests of /v1 in one table, from which the application has its routes and `GET /openapi.json` its document."""
from typing import Any, NamedTuple

import motion_jax
from motion_jax_studio.server import fields, serialization
from motion_jax_studio.server.limits import Limits
from motion_jax_studio.server.request_types import types_of


class Endpoint(NamedTuple):
  """A request of /v1. Without a body it is a GET.

  body: "json" or "bytes", or the name of a type of `types_of`. answer: the properties of the JSON reply; None for a
  reply of bytes. query: {name: description}.
  """
  summary: str
  body: str | None = None
  answer: dict[str, Any] | None = {}
  query: dict[str, str] = {}
  changes: bool = False  # a POST although it has no body


def _list(item):
  return {"type": "array", "items": item}


_MOTION = {"$ref": "#/components/schemas/Motion"}
_REPORT = {"type": "object", "description": "the constraints as they are drawn, and the motion's distance from them in "
           "millimetres"}
_NOTES = {"notes": _list({"type": "string"}),
          "unknown": {"type": "array", "items": {"type": "string"}, "description": "words the model does not know"}}
_WORK = {"work": "the value of its x-work header"}
ENDPOINTS = {
    "status": Endpoint("running streams and models"),
    "models": Endpoint("the models and their loading progress"),
    "progress": Endpoint("progress of the request with this x-work header", query=_WORK),
    "cancel": Endpoint("ends the request with this x-work header", query=_WORK, changes=True),
    "suggestions": Endpoint("prompts that a model can do", query={
        "model": "a name of /v1/models", "words": "adds training captions of similar meaning"}),
    "generate": Endpoint("motions of one prompt", "generate", {
        "motions": _list(_MOTION), "constraints": _list(_REPORT)} | _NOTES),
    "multi-prompt": Endpoint("one motion of several prompts", "multi_prompt", {
        "motion": _MOTION, "constraints": _REPORT, "reused_frames": {"type": "integer"},
        "same_frames": {"type": "integer"}, "segments": _list({"type": "object", "properties": _NOTES | {
            "nearest": {"type": "string", "description": "the training caption closest to a prompt with notes"}}})
        } | _NOTES),
    "edit": Endpoint("regenerates frames of a motion", "edit", {
        "motion": _MOTION, "made": fields.Spans.schema(Limits())} | _NOTES),
    "project": Endpoint("validates a project and returns it with every field", "json"),
    "import": Endpoint("the motion in a file", "bytes", {"motion": _MOTION}, {"name": "the name of the file"}),
    "export": Endpoint("a motion as a file", "export", None),
    "export-choices": Endpoint("formats and rigs of /v1/export", answer={
        "formats": _list({"type": "object"}), "rigs": _list({"type": "object"})})}

_ERROR = {"type": "object", "properties": {"error": {"type": "object", "properties": {
    "status": {"type": "integer"}, "message": {"type": "string", "description": "one sentence"}}}}}
_REFUSALS = {"400": "the request is not valid", "401": "no token", "403": "sent by another page", "409": "cancelled",
             "413": "too large", "422": "a sampling choice is not valid", "429": "too many requests",
             "500": "a fault of the program"}


def document(limits: Limits) -> dict[str, Any]:
  """An OpenAPI 3.1 document of the requests of /v1."""
  types = types_of(limits)
  kinds = {row.body: kind for row in ENDPOINTS.values() if (kind := getattr(types, row.body or "", None))}
  bodies = fields.schemas([*kinds.values()], limits)
  bodies["Edit"]["oneOf"] = [{"required": [name], "properties": {name: {"type": "array"}}}
                             for name in ("change", "keep")]
  return {"openapi": "3.1.0", "info": {"title": "motion_jax studio", "version": motion_jax.__version__},
          "security": [{"token": []}],
          "paths": {f"/v1/{name}": _path(row, kinds) for name, row in ENDPOINTS.items()},
          "components": {"schemas": {"Motion": serialization.SCHEMA, "Error": _ERROR} | bodies,
                         "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}}}


def _path(row, kinds):
  reply = {"application/octet-stream": {}} if row.answer is None else {
      "application/json": {"schema": {"type": "object", "properties": row.answer}}}
  refusal = {"application/json": {"schema": {"$ref": "#/components/schemas/Error"}}}
  about = {"summary": row.summary, "responses": {"200": {"description": "done", "content": reply}} | {
      status: {"description": text, "content": refusal} for status, text in _REFUSALS.items()}}
  if row.query:
    about["parameters"] = [{"name": name, "in": "query", "required": row.body is not None, "description": text,
                            "schema": {"type": "string"}} for name, text in row.query.items()]
  if row.body:
    schema = {"$ref": f"#/components/schemas/{kinds[row.body].__name__}"} if row.body in kinds else {
        "type": "object", "required": ["format", "version", "model", "blocks"]}
    content = {"application/octet-stream": {}} if row.body == "bytes" else {"application/json": {"schema": schema}}
    about["requestBody"] = {"required": True, "content": content}
  return {"post" if row.body or row.changes else "get": about}
