"""The Starlette application: the page, the requests of /v1, and a WebSocket per stream (docs/protocol.md)."""
import asyncio
import contextlib
import functools
import json
import pathlib
import time
from collections.abc import Callable
from typing import Any

import anyio.to_thread
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

import motion_jax
from motion_jax.export.html import VIEWER, resting_body
from motion_jax.utils import progress
from motion_jax.utils.errors import InputError, reason
from motion_jax.utils.plugins import Registry
from motion_jax_studio.server import exporting, fields, openapi, project, suggestions
from motion_jax_studio.server.library import Library
from motion_jax_studio.server.limits import ChoiceError, Limits, TokenBucket
from motion_jax_studio.server.request_types import types_of
from motion_jax_studio.server.requests import RequestHandler
from motion_jax_studio.server.security import LOOPBACK, Refused, SecurityMiddleware
from motion_jax_studio.server.streams import Stream

# {name: function(studio) -> routes below /name/} of further protocols, each an entry point of this group.
PROTOCOLS: Registry[Callable] = Registry("motion_jax_studio.protocols", {})
_AT_ONCE = ("status", "progress", "cancel")  # answered even if all threads work
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
    protocols = {name: PROTOCOLS[name](self) for name in PROTOCOLS}
    routes = [WebSocketRoute("/v1/stream", self._stream), *self._v1(),
              *(Mount(f"/{name}", routes=routes) for name, routes in protocols.items()),
              Route("/openapi.json", lambda request: JSONResponse(openapi.document(self.limits))),
              Route("/body.json", _body_page), *_pages()]
    handlers = {404: _plain_error, 405: _plain_error, Exception: _fault}
    inner = Starlette(routes=routes, exception_handlers=handlers)
    guarded = tuple(f"/{name}/" for name in ("v1", *protocols))
    return SecurityMiddleware(inner, self.token, self.limits, guarded, self.host in LOOPBACK, self.public_url)

  def close(self) -> None:
    """Ends all streams."""
    for stream in list(self.streams):
      stream.close()

  # --- requests ----------------------------------------------------------------------------------------------------

  def _v1(self):
    """The routes of `openapi.ENDPOINTS`."""
    handler = self.handler
    works = {
        "status": self._status, "progress": self._progress, "cancel": self._cancel, "generate": handler.generate,
        "models": lambda: {"models": [slot.about() for slot in self.library.slots.values()]},
        "suggestions": lambda model=None, words="": suggestions.suggest(
            self.library.slot(model).model, words[:self.limits.prompt]),
        "multi-prompt": handler.multi_prompt, "edit": handler.edit, "import": lambda data, name="": handler.read(
            data, name), "project": lambda body: project.validate(body, self.limits), "export": self._export,
        "export-choices": exporting.choices}
    return [self.route(f"/v1/{name}", works[name], *self._reader(row), takes=row.query, at_once=name in _AT_ONCE)
            for name, row in openapi.ENDPOINTS.items()]

  def _reader(self, row):
    """(method, function of the bytes of a body) of an endpoint."""
    kind = getattr(types_of(self.limits), row.body or "", None)
    if kind is not None:
      return "POST", lambda data: fields.parse(kind, self.parsed(data), self.limits)
    return ("POST" if row.body or row.changes else "GET"), {"json": self.parsed, "bytes": bytes, None: None}[row.body]

  def route(self, path: str, work: Callable[..., Any], method: str = "GET", read: Callable[[bytes], Any] | None = None,
            takes: Any = (), refuse: Callable[[Exception], Response] | None = None, at_once: bool = False) -> Route:
    """A route of `path` whose reply is work(read(body), **query), or work(**query) without `read`: a Response, or JSON.

    A thread reads the body, works and writes the reply, because JSON of large motions takes long. takes: names of the
    query that work has. refuse(error): the reply to a Refused, a Cancelled or a ValueError. at_once: no thread.
    """
    def reply(request, data):
      query = {name: request.query_params[name] for name in takes if name in request.query_params}
      answer = work(*([read(data)] if read else ()), **query)
      return answer if isinstance(answer, Response) else JSONResponse(answer)

    async def handle(request: Request) -> Response:
      try:
        data = await _content(request)
        if at_once:
          return reply(request, data)
        with self._followed(request):
          return await anyio.to_thread.run_sync(reply, request, data)
      except (Refused, progress.Cancelled, ValueError) as error:
        return (refuse or _refusal)(error)

    return Route(path, handle, methods=[method])

  def parsed(self, data: bytes | str) -> Any:
    """The value of JSON. The number of values is limited: parsing blocks all other threads, and short lists cost the
    most time and memory."""
    count = sum(data.count(sign if isinstance(data, str) else sign.encode()) for sign in ",[{")
    if count > self.limits.values:
      raise Refused(413, f"got JSON of {count:,} values, expected at most {self.limits.values:,}")
    try:
      return json.loads(data, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:
      raise InputError(f"got no valid JSON ({reason(error, 80)})") from None

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

  def _status(self):
    return {"version": motion_jax.__version__, "protocol": 1, "streams": len(self.streams),
            "seconds": round(time.monotonic() - self.began, 1),
            "models": {name: slot.state for name, slot in self.library.slots.items()}}

  def _progress(self, work=""):
    return self.works.get(work, progress.Work()).state()

  def _cancel(self, work=""):
    if work in self.works:
      self.works[work].cancelled = True
    return {"cancelled": work in self.works}

  def _export(self, request):
    with self.handler.place():
      file, media, name = exporting.export_file(request)
    return Response(file, media_type=media, headers={"content-disposition": f'attachment; filename="{name}"'})

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
        stream.receive(self.parsed(text))
      except (InputError, Refused) as error:
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


def _no_number(name):
  raise ValueError(f"{name} is no number of JSON")


def _refusal(error):
  """The reply to an error that the client can fix."""
  if isinstance(error, progress.Cancelled):
    return _error(409, "this request was cancelled")
  status = error.status if isinstance(error, Refused) else 422 if isinstance(error, ChoiceError) else 400
  return _error(status, reason(error, 400))


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
