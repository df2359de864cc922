"""Deadlines of connections. uvicorn has none for incomplete requests, and none for clients that do not read replies."""
from typing import Any

from motion_jax_studio.server.limits import Limits


def protocol(limits: Limits) -> Any:
  """uvicorn's HTTP protocol, which closes connections that keep the server waiting.

  A connection may go `limits.patience` seconds, or twice as long at most, without completing the headers of a request
  or without reading any of a reply. Of more than `limits.idle` connections without a request the oldest is closed.
  """
  from uvicorn.protocols.http.h11_impl import H11Protocol
  idle: dict[H11Protocol, float] = {}  # connections without a request, with the time since when; the oldest first

  class Protocol(H11Protocol):
    def connection_made(self, transport: Any) -> None:
      super().connection_made(transport)
      self._unread, self._timer = 0, self.loop.call_later(limits.patience, self._watch)
      self._update()
      while len(idle) > limits.idle:
        oldest = next(iter(idle))
        del idle[oldest]
        oldest.transport.abort()

    def data_received(self, data: bytes) -> None:
      super().data_received(data)
      self._update()

    def on_response_complete(self) -> None:
      super().on_response_complete()
      self._update()

    def connection_lost(self, error: Exception | None) -> None:
      super().connection_lost(error)
      self._timer.cancel()
      idle.pop(self, None)

    def _update(self):
      """Notes whether a request is running, or the connection has become a WebSocket's."""
      if self.transport.get_protocol() is self and (self.cycle is None or self.cycle.response_complete):
        idle.setdefault(self, self.loop.time())
      else:
        idle.pop(self, None)

    def _watch(self):
      if self.transport.get_protocol() is not self:
        return
      unread = self.transport.get_write_buffer_size()
      if unread and unread == self._unread:
        return self.transport.abort()
      if not unread and self.loop.time() - idle.get(self, self.loop.time()) >= limits.patience:
        return self.transport.close()
      self._unread, self._timer = unread, self.loop.call_later(limits.patience, self._watch)

  return Protocol
