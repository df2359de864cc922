"""MMCP, a protocol between animation programs and motion models: `GET /mmcp/capabilities`, `POST /mmcp/generate`.

https://animatica.ai/mmcp, version 1.2: a skeleton and text segments in, glTF with an animation for each sample out. A
plug-in of the studio: an entry point of the group `motion_jax_studio.protocols` names `routes`.

  capabilities  the models that are ready
  generating    a request becomes a motion
  constraints   MMCP's constraints as ours
  document      motions as glTF
"""
import json
from typing import Any

from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from motion_jax.utils.errors import reason
from motion_jax_studio.mmcp import capabilities, generating
from motion_jax_studio.mmcp.constraints import MmcpError

_CODES = {413: "payload_too_large", 429: "rate_limited"}


def routes(studio: Any) -> list[Route]:
  """The routes below /mmcp/ of a `Studio`."""
  def generate(body):
    return Response(json.dumps(generating.generate(body, studio.handler)), media_type="model/gltf+json")

  return [studio.route("/capabilities", lambda: capabilities.capabilities(studio.handler), refuse=_refusal),
          studio.route("/generate", generate, "POST", studio.parsed, refuse=_refusal)]


def _refusal(error):
  if not isinstance(error, MmcpError):
    status = getattr(error, "status", 400)
    error = MmcpError(status, _CODES.get(status, "invalid_request"), reason(error, 400))
  details = {"status": error.status}
  return JSONResponse({"error": {"code": error.code, "message": str(error), "details": details}}, error.status)
