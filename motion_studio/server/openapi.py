"""What `GET /openapi.json` says: the HTTP part of docs/protocol.md for programs."""
from typing import Any

import motion_jax
from motion_jax.control import files
from motion_studio.server.exporting import KINDS
from motion_studio.server.limits import Limits


def described(limits: Limits) -> dict[str, Any]:
  """An OpenAPI 3.1 document of the requests of /v1."""
  prompt = {"type": "string", "minLength": 1, "maxLength": limits.prompt}
  seconds = {"type": ["number", "null"], "minimum": 0.2, "maximum": limits.seconds,
             "description": "null: as long as clips of similar captions"}
  seed = {"type": "integer", "minimum": 0, "maximum": 2**32 - 1, "default": 0}
  model = {"type": ["string", "null"], "description": "a name of /v1/models; null: the first that can"}
  sampling = {"type": "object", "description": "choices of sampling; /v1/models lists a model's"}
  spans = {"type": "array", "description": "[first, past] in frames",
           "items": {"type": "array", "items": {"type": "integer"}, "minItems": 2, "maxItems": 2}}
  switch = lambda usual: {"type": "boolean", "default": usual}
  motion = {"$ref": "#/components/schemas/Motion"}
  control = {"type": ["object", "null"], "description": "constraints, docs/control.md", "properties": {
      "version": {"const": 1}, "constraints": {"type": "array", "items": {"type": "object"}, "maxItems": files.MOST}}}
  asked = {"type": "object", "description": "what of control is drawn, and how far the motion is from it, millimetres"}
  block = {"type": "object", "required": ["prompt"], "properties": {"prompt": prompt, "seconds": seconds}}
  listed = lambda item, most=None: {"type": "array", "items": item} | ({"maxItems": most} if most else {})
  paths = {
      "/v1/status": {"get": _answer("what runs", {"type": "object"})},
      "/v1/models": {"get": _answer("the models, and how far they are", {"type": "object"})},
      "/v1/progress": {"get": _answer("how far the request with this x-work header is", {"type": "object"})
                       | {"parameters": [_query("work", "the value of its x-work header")]}},
      "/v1/suggestions": {"get": _answer("what a model can do", {"type": "object"})
                          | {"parameters": [_query("model", "a name of /v1/models"),
                                            _query("words", "captions that mean nearly this are added")]}},
      "/v1/generate": {"post": _request("motions of one prompt", ["prompt"], {
          "prompt": prompt, "model": model, "seconds": seconds, "seed": seed, "cleanup": switch(True),
          "num": {"type": "integer", "minimum": 1, "maximum": limits.takes, "default": 1}, "literal": switch(False),
          "sampling": sampling, "control": control},
          {"type": "object", "properties": {"motions": listed(motion), "asked": listed(asked)}})},
      "/v1/story": {"post": _request("one motion of several prompts", ["blocks"], {
          "blocks": listed(block, limits.blocks), "model": model, "seed": seed, "cleanup": switch(True),
          "sampling": sampling, "past": motion, "control": control},
          {"type": "object", "properties": {"motion": motion, "asked": asked, "reused_frames": {"type": "integer"},
                                            "same_frames": {"type": "integer"}}})},
      "/v1/edit": {"post": _request("a motion with parts of it made anew", ["motion", "prompt"], {
          "motion": motion, "prompt": prompt, "change": spans, "keep": spans, "model": model, "seed": seed,
          "sampling": sampling}, {"type": "object", "properties": {"motion": motion, "made": spans}})},
      "/v1/project": {"post": _request("a project checked, with every field", ["format", "version", "model", "blocks"],
                                       {}, {"type": "object"})},
      "/v1/import": {"post": {
          "summary": "the motion in a file", "parameters": [{"name": "name", "in": "query", "required": True,
                                                             "schema": {"type": "string"}}],
          "requestBody": {"content": {"application/octet-stream": {}}},
          "responses": _responses({"type": "object", "properties": {"motion": motion}})}},
      "/v1/export": {"post": _request("a motion as a file", ["motion", "format"], {
          "motion": motion, "format": {"enum": list(KINDS)}, "trim": spans, "in_place": switch(False),
          "loop": switch(False), "name": {"type": "string"}, "control": control}, None)},
  }
  schema = {"type": "object", "required": ["shape", "fps", "joints"], "properties": {
      "shape": {"type": "array", "items": {"type": "integer"}, "description": "[frames, joints, 3]"},
      "fps": {"type": "number"}, "joints": {"type": "string", "contentEncoding": "base64",
                                            "description": "float32, little endian, metres, y up"},
      "skeleton": {"type": "string"}, "id": {"type": "string"}, "captions": {"type": "array"},
      "meta": {"type": "object"}, "source": {"type": "string"}, "license": {"type": "string"}}}
  error = {"type": "object", "properties": {"error": {"type": "object", "properties": {
      "status": {"type": "integer"}, "message": {"type": "string", "description": "one sentence"}}}}}
  return {"openapi": "3.1.0", "info": {"title": "motion_jax studio", "version": motion_jax.__version__},
          "security": [{"token": []}], "paths": paths,
          "components": {"schemas": {"Motion": schema, "Error": error},
                         "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}}}}


def _responses(schema):
  content = {"application/json": {"schema": schema}} if schema else {"application/octet-stream": {}}
  refused = {"application/json": {"schema": {"$ref": "#/components/schemas/Error"}}}
  told = {"400": "what was asked cannot be", "401": "no token", "403": "from another page", "413": "too large",
          "429": "too much at once", "500": "a fault of the program"}
  return {"200": {"description": "done", "content": content},
          **{status: {"description": text, "content": refused} for status, text in told.items()}}


def _answer(summary, schema):
  return {"summary": summary, "responses": _responses(schema)}


def _query(name, description):
  return {"name": name, "in": "query", "required": False, "description": description, "schema": {"type": "string"}}


def _request(summary, required, properties, schema):
  body = {"type": "object", "required": required} | ({"properties": properties, "additionalProperties": False}
                                                      if properties else {})
  return _answer(summary, schema) | {"requestBody": {"required": True, "content": {
      "application/json": {"schema": body}}}}
