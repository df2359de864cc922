"""The Starlette application: the page, the requests of /v1, and a WebSocket per stream (docs/protocol.md)."""
import asyncio
import contextlib
import functools
import json
import pathlib
import time
from typing import Any

import anyio.to_thread
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

import motion_jax
from motion_jax.export.html import VIEWER, resting_body
from motion_jax.utils import progress
from motion_jax.utils.errors import InputError, reason
from motion_jax_studio.server import export_choices, exporting, mmcp, openapi, project, suggestions
from motion_jax_studio.server.library import Library
from motion_jax_studio.server.limits import ChoiceError, Limits, TokenBucket
from motion_jax_studio.server.requests import RequestHandler
from motion_jax_studio.server.security import LOOPBACK, Refused, SecurityMiddleware
from motion_jax_studio.server.streams import Stream

_MOST_WORKS = 50  # requests whose progress can be read at the same time
ASSETS = pathlib.Path(__file__).parents[1] / "assets"
_TYPES = {".html": "text/html; charset=utf-8", ".js": "text/javascript; charset=utf-8",
          ".css": "text/css; charset=utf-8", ".svg": "image/svg+xml",
          ".json": "application/json", ".png": "image/png", ".woff2": "font/woff2",
          ".txt": "text/plain; charset=utf-8", ".wasm": "application/wasm"}


class Studio:
  """The state of the application: models, limits, running streams."""

  def __init__(self, library: Library, token: str, host: str = "127.0.0.1", limits: Limits | None = None,
               public_url: str | None = None) -> None:
    """public_url: address of a proxy in front of the studio, whose pages are accepted."""
    self.library, self.token, self.host, self.limits = library, token, host, limits or Limits()
    self.public_url = public_url
    self.handler = RequestHandler(library, self.limits)
    self.streams: set[Stream] = set()
    self.places = 0  # streams, including sockets that have not sent a message yet
    self.works: dict[str, progress.Work] = {}  # by the name in the request's x-work header
    self.began = time.monotonic()

  def app(self) -> SecurityMiddleware:
    """The ASGI application inside the security middleware."""
    routes = [
        WebSocketRoute("/v1/stream", self._stream),
        Route("/v1/status", self._status), Route("/v1/models", self._models),
        Route("/v1/progress", self._progress), Route("/v1/cancel", self._cancel, methods=["POST"]),
        Route("/v1/suggestions", self._suggestions),
        Route("/v1/generate", self._json(self.handler.generate), methods=["POST"]),
        Route("/v1/multi-prompt", self._json(self.handler.multi_prompt), methods=["POST"]),
        Route("/v1/edit", self._json(self.handler.edit), methods=["POST"]),
        Route("/v1/project", self._json(lambda body: project.checked(body, self.limits)), methods=["POST"]),
        Route("/v1/import", self._import, methods=["POST"]),
        Route("/v1/export", self._export, methods=["POST"]),
        Route("/v1/export-choices", self._export_choices),
        Route("/mmcp/capabilities", self._mmcp_capabilities),
        Route("/mmcp/generate", self._mmcp_generate, methods=["POST"]),
        Route("/openapi.json", lambda request: JSONResponse(openapi.described(self.limits))),
        Route("/body.json", _body_page), *_pages()]
    handlers = {404: _plain_error, 405: _plain_error, Exception: _fault}
    inner = Starlette(routes=routes, exception_handlers=handlers)
    return SecurityMiddleware(inner, self.token, self.limits, self.host in LOOPBACK, self.public_url)

  def close(self) -> None:
    """Ends all streams."""
    for stream in list(self.streams):
      stream.close()

  # --- requests ----------------------------------------------------------------------------------------------------

  async def _status(self, request: Request) -> Response:
    return JSONResponse({"version": motion_jax.__version__, "protocol": 1, "streams": len(self.streams),
                         "seconds": round(time.monotonic() - self.began, 1),
                         "models": {name: slot.state for name, slot in self.library.slots.items()}})

  async def _models(self, request: Request) -> Response:
    about = await anyio.to_thread.run_sync(lambda: [slot.about() for slot in self.library.slots.values()])
    return JSONResponse({"models": about})

  async def _progress(self, request: Request) -> Response:
    work = self.works.get(request.query_params.get("work", ""))
    return JSONResponse(work.state() if work else progress.Work().state())

  async def _cancel(self, request: Request) -> Response:
    work = self.works.get(request.query_params.get("work", ""))
    if work is not None:
      work.cancelled = True
    return JSONResponse({"cancelled": work is not None})

  async def _suggestions(self, request: Request) -> Response:
    async def answer():
      name, words = request.query_params.get("model"), request.query_params.get("words", "")[:self.limits.prompt]
      return JSONResponse(await anyio.to_thread.run_sync(suggestions.found, self.library.slot(name).model, words))

    return await _reply(answer)

  @contextlib.contextmanager
  def _followed(self, request):
    """Reports progress inside the block, also of its threads, under the name in the header x-work."""
    name, work = request.headers.get("x-work", "")[:40], progress.Work()
    if name and len(self.works) < _MOST_WORKS:
      self.works[name] = work
    try:
      with progress.follow(work):
        yield
    finally:
      if self.works.get(name) is work:
        del self.works[name]

  def _json(self, work: Any) -> Any:
    """A handler of JSON requests. A thread parses the body, runs work(body) and writes the reply, because JSON of large
    motions takes long; an InputError becomes status 400."""
    async def handle(request: Request) -> Response:
      async def answer():
        data = await _content(request)
        with self._followed(request):
          return await anyio.to_thread.run_sync(lambda: JSONResponse(work(_parsed(data, self.limits))))

      return await _reply(answer)

    return handle

  async def _import(self, request: Request) -> Response:
    async def answer():
      data, name = await _content(request), request.query_params.get("name", "")
      return await anyio.to_thread.run_sync(lambda: JSONResponse(self.handler.read(data, name)))

    return await _reply(answer)

  async def _export(self, request: Request) -> Response:
    async def answer():
      data = await _content(request)

      def work():
        body = _parsed(data, self.limits)
        with self.handler.place():
          return exporting.exported(body, self.limits)

      with self._followed(request):
        file, media, name = await anyio.to_thread.run_sync(work)
      return Response(file, media_type=media, headers={"content-disposition": f'attachment; filename="{name}"'})

    return await _reply(answer)

  async def _export_choices(self, request: Request) -> Response:
    return JSONResponse(await anyio.to_thread.run_sync(export_choices.choices))

  async def _mmcp_capabilities(self, request: Request) -> Response:
    return JSONResponse(await anyio.to_thread.run_sync(mmcp.capabilities, self.handler))

  async def _mmcp_generate(self, request: Request) -> Response:
    try:
      data = await _content(request)
      return await anyio.to_thread.run_sync(lambda: Response(
          json.dumps(mmcp.generate(_parsed(data, self.limits), self.handler)), media_type=mmcp.MEDIA))
    except mmcp.MmcpError as error:
      return JSONResponse(error.body(), error.status)
    except Refused as error:
      code = "payload_too_large" if error.status == 413 else "rate_limited"
      return JSONResponse(mmcp.MmcpError(error.status, code, str(error)).body(), error.status)
    except ValueError as error:
      return JSONResponse(mmcp.MmcpError(400, "invalid_request", reason(error, 400)).body(), 400)

  # --- streams -----------------------------------------------------------------------------------------------------

  async def _stream(self, socket: WebSocket) -> None:
    await socket.accept()
    if self.places >= self.limits.streams:
      return await _end(socket, 1013, f"{self.limits.streams} streams run already; close one of them")
    self.places += 1
    outbox: asyncio.Queue[Any] = asyncio.Queue()
    loop = asyncio.get_running_loop()

    def put(item):
      if outbox.qsize() < self.limits.unsent:
        outbox.put_nowait(item)
      else:  # blocks wait for acknowledgement, so this page sends messages without reading replies
        receiver.cancel()

    def send(item):
      with contextlib.suppress(RuntimeError):  # the event loop has ended
        loop.call_soon_threadsafe(put, item)

    stream = Stream(self.library, self.limits, send)
    self.streams.add(stream)
    sender = asyncio.create_task(_deliver(socket, outbox))
    receiver = asyncio.create_task(self._listen(socket, stream))
    try:
      await asyncio.wait([sender, receiver], return_when=asyncio.FIRST_COMPLETED)
    finally:
      stream.close()
      self.streams.discard(stream)
      self.places -= 1
      for task in (sender, receiver):
        task.cancel()
      for task in (sender, receiver):
        with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError, OSError):
          await task

  async def _listen(self, socket, stream):
    """Passes the page's messages on until it closes the socket or exceeds a limit."""
    bucket = TokenBucket(self.limits.messages)
    while True:
      message = await socket.receive()
      if message["type"] == "websocket.disconnect":
        return
      text = message.get("text")
      if text is None:
        return await _end(socket, 1003, "got a binary message, expected JSON")
      if len(text) > self.limits.message_bytes:
        return await _end(socket, 1009, f"got a message of {len(text):,} characters, expected at most "
                          f"{self.limits.message_bytes:,}")
      if not bucket.take(time.monotonic()):
        return await _end(socket, 1008, f"got more than {self.limits.messages:g} messages a second")
      try:
        stream.receive(_parsed(text, self.limits))
      except InputError as error:
        await socket.send_json({"type": "error", "fatal": False, "message": reason(error, 400)})


async def _deliver(socket, outbox):
  """Sends the messages of the stream's thread; waits while the connection is full."""
  while (item := await outbox.get()) is not None:
    if isinstance(item, bytes):
      await socket.send_bytes(item)
    else:
      await socket.send_text(json.dumps(item))
  await socket.close(1011)


async def _end(socket, code, message):
  await socket.send_json({"type": "error", "fatal": True, "message": message})
  await socket.close(code, message[:100])


async def _content(request):
  """The body of a request."""
  try:
    return await request.body()
  except ClientDisconnect:
    raise Refused(400, "the connection was closed before the body was complete") from None


def _parsed(data, limits):
  """Parse JSON. The number of values is limited: parsing blocks all other threads, and short lists cost the most time
  and memory."""
  count = sum(data.count(sign if isinstance(data, str) else sign.encode()) for sign in ",[{")
  if count > limits.values:
    raise Refused(413, f"got JSON of {count:,} values, expected at most {limits.values:,}")
  try:
    return json.loads(data, parse_constant=_no_number)
  except (ValueError, RecursionError) as error:
    raise InputError(f"got no valid JSON ({reason(error, 80)})") from None


def _no_number(name):
  raise ValueError(f"{name} is no number of JSON")


async def _reply(answer):
  try:
    return await answer()
  except Refused as error:
    return _error(error.status, str(error))
  except progress.Cancelled:
    return _error(409, "this request was cancelled")
  except (InputError, ValueError) as error:
    return _error(422 if isinstance(error, ChoiceError) else 400, reason(error, 400))


def _error(status, message):
  return JSONResponse({"error": {"status": status, "message": message}}, status)


async def _plain_error(request, error):
  message = "there is no such page" if error.status_code == 404 else f"this address does not take {request.method}"
  return _error(error.status_code, f"{message}; /openapi.json lists all addresses")


async def _fault(request, error):
  """An unexpected exception: the traceback goes only to the log, see `SecurityMiddleware`."""
  return _error(500, f"the studio met a fault of the program ({type(error).__name__}); its terminal says more")


def _pages():
  """A route for each file of the page, so that no path from a request is ever opened."""
  routes = [Route("/viewer.js", _page(VIEWER))]  # the viewer of exported pages
  for path in sorted(ASSETS.rglob("*")):
    if path.is_file() and path.suffix in _TYPES:
      name = path.relative_to(ASSETS).as_posix()
      routes.append(Route(f"/{name}", _page(path)))
      if name == "index.html":
        routes.append(Route("/", _page(path)))
  return routes


@functools.cache
def _resting_body():
  return json.dumps(resting_body())


async def _body_page(request):
  """The body mesh that the page attaches to the joints of a motion."""
  return Response(await anyio.to_thread.run_sync(_resting_body), media_type="application/json")


def _page(path):
  content, media = path.read_bytes(), _TYPES[path.suffix]

  async def page(request):
    return Response(content, media_type=media)

  return page
