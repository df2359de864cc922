"""Checks before any other code sees a request: origin, host, token, rate and size."""
import asyncio
import dataclasses
import hmac
import json
import logging
import time
import urllib.parse
from typing import Any

from motion_jax.utils.errors import reason
from motion_jax_studio.server.limits import Limits, TokenBucket

LOOPBACK = ("127.0.0.1", "localhost", "::1")
_log = logging.getLogger("motion_jax_studio.server")
_ADDRESSES = 1000  # of clients with a rate limit at the same time
_HEADERS = [(b"x-content-type-options", b"nosniff"), (b"referrer-policy", b"no-referrer"),
            (b"cache-control", b"no-store"), (b"x-frame-options", b"SAMEORIGIN"),
            (b"content-security-policy", b"default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; "  # meshopt
             b"img-src 'self' data: blob:; media-src 'self' blob:; style-src 'self' 'unsafe-inline'; "
             b"connect-src 'self' blob:; worker-src 'self' blob:; object-src 'none'; base-uri 'none'")]


class Refused(Exception):
  """A refused request, with an HTTP status and one sentence."""

  def __init__(self, status: int, message: str) -> None:
    super().__init__(message)
    self.status = status


class SecurityMiddleware:
  """ASGI middleware around the whole application.

  A request from a browser must come from a page of this server (Origin). A server that listens to this machine only
  requires a local host name (Host, against DNS rebinding). Requests below the `guarded` paths need the token. Failures
  inside become JSON with one sentence.
  """

  def __init__(self, app: Any, token: str, limits: Limits, guarded: tuple[str, ...], local: bool,
               public_url: str | None = None) -> None:
    self._app, self._token, self._limits, self._guarded, self._local = app, token, limits, guarded, local
    self._public = urllib.parse.urlsplit(public_url or "").netloc.lower()  # of a proxy in front
    self._clients: dict[str, _Client] = {}

  async def __call__(self, scope, receive, send):
    if scope["type"] not in ("http", "websocket"):
      return await self._app(scope, receive, send)
    try:
      self._check(scope)
    except Refused as error:
      return await _refuse(scope, receive, send, error)
    if scope["type"] == "websocket":
      return await self._app(scope, receive, send)

    async def with_headers(message):
      if message["type"] == "http.response.start":
        message = message | {"headers": [*message["headers"], *_HEADERS]}
      await send(message)

    try:
      await self._app(scope, _limited(receive, self._limits), with_headers)
    except Refused as error:
      await _refuse(scope, receive, send, error)
    except Exception:  # unexpected; the application has sent its reply already
      _log.exception("a request failed")

  def _check(self, scope):
    headers = {name.decode("latin1").lower(): value.decode("latin1") for name, value in scope["headers"]}
    host = headers.get("host", "")
    if self._local and _name_of(host) not in LOOPBACK and host.lower() != self._public:
      raise Refused(403, f"got a request for the host {host[:80]!r}, this studio accepts only this machine: "
                    "open it as 127.0.0.1 or localhost, or name the proxy in front of it by --public-url")
    origin = headers.get("origin")
    if origin is not None and _place_of(origin) not in {host.lower(), self._public} - {""}:
      raise Refused(403, f"got a request from a page of {origin[:80]!r}, only the studio's own pages may send requests "
                    "and those of a proxy that --public-url names")
    if not scope["path"].startswith(self._guarded):
      return
    query = urllib.parse.parse_qs(scope.get("query_string", b"").decode("latin1"))
    given = headers.get("authorization", "").removeprefix("Bearer ").strip() or query.get("token", [""])[0]
    client, is_right = self._client(scope), hmac.compare_digest(given.encode(), self._token.encode())
    if not (is_right and client.is_known) and not client.guesses.take(time.monotonic()):
      raise Refused(429, f"got more than {self._limits.wrong_tokens:g} wrong tokens a second; wait a moment")
    if not is_right:
      raise Refused(401, "the token is missing or wrong; open the address that the studio printed")
    client.is_known = True
    if not client.requests.take(time.monotonic()):
      raise Refused(429, f"got more than {self._limits.requests:g} requests a second; wait a moment")
    length = headers.get("content-length", "0")
    if not length.isdecimal() or len(length) > 15 or int(length) > self._limits.body_bytes:
      raise Refused(413, f"got a body of {length[:20]} bytes, expected at most {self._limits.body_bytes:,}")

  def _client(self, scope):
    address = (scope.get("client") or ("?",))[0]
    if address not in self._clients:
      while len(self._clients) >= _ADDRESSES:
        del self._clients[next(iter(self._clients))]
      self._clients[address] = _Client(TokenBucket(self._limits.requests), TokenBucket(self._limits.wrong_tokens))
    return self._clients[address]


@dataclasses.dataclass
class _Client:
  """Rate limits of one address. Once it has sent the right token, wrong guesses from it no longer lock it out."""
  requests: TokenBucket
  guesses: TokenBucket
  is_known: bool = False


def _name_of(host):
  """The name in a Host header, without its port."""
  try:
    return (urllib.parse.urlsplit(f"//{host}").hostname or "").lower()
  except ValueError:
    return ""


def _place_of(origin):
  """Host and port of an Origin header; None if it has none."""
  try:
    return urllib.parse.urlsplit(origin).netloc.lower() or None
  except ValueError:
    return None


def _limited(receive, limits):
  """A receive function that raises Refused if a body without a content length grows too long, or stalls."""
  total, is_complete = 0, False

  async def count():
    nonlocal total, is_complete
    try:
      message = await asyncio.wait_for(receive(), None if is_complete else limits.patience)
    except TimeoutError:
      raise Refused(408, f"got no more of the body within {limits.patience:g} s") from None
    total, is_complete = total + len(message.get("body", b"")), not message.get("more_body", False)
    if total > limits.body_bytes:
      raise Refused(413, f"got a body of more than {limits.body_bytes:,} bytes")
    return message

  return count


async def _refuse(scope, receive, send, error):
  if scope["type"] == "websocket":  # before it is accepted: the browser sees a failed handshake
    if "websocket.http.response" not in scope.get("extensions", {}):
      await receive()
      return await send({"type": "websocket.close", "code": 1008, "reason": reason(error, 110)})
    kind = "websocket.http.response"
  else:
    kind = "http.response"
  body = json.dumps({"error": {"status": error.status, "message": reason(error, 400)}}).encode()
  headers = [(b"content-type", b"application/json"), (b"content-length", str(len(body)).encode()), *_HEADERS]
  if error.status == 429:
    headers.append((b"retry-after", b"1"))
  if error.status == 401:
    headers.append((b"www-authenticate", b"Bearer"))
  await send({"type": f"{kind}.start", "status": error.status, "headers": headers})
  await send({"type": f"{kind}.body", "body": body})
