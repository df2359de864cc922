"""Runs a studio: opens the port, prints the address, and ends within two seconds of Ctrl-C."""
import errno
import importlib.util
import logging
import os
import pathlib
import secrets
import socket
import sys
import threading
import urllib.parse
import webbrowser
from collections.abc import Sequence
from typing import Any

from motion_jax.utils import progress
from motion_jax.utils.errors import InputError
from motion_jax.utils.home import home_folder
from motion_jax.utils.install import pip_install
from motion_jax_studio.server.security import LOOPBACK

_SHORTEST = 16   # characters of a token
_PATIENCE = 1.5  # seconds for pages and threads to end


def require_packages(what: str, *names: str) -> None:
  """Raises InputError if packages of the extra `studio` are not installed."""
  if missing := [name for name in names if importlib.util.find_spec(name) is None]:
    raise InputError(f"{what} needs the packages {', '.join(missing)}: {pip_install('studio')}")


def check_address(host: str, token: str | None) -> None:
  """Raises InputError for an address that other machines can reach, if no token was given."""
  if host not in LOOPBACK and token is None:
    raise InputError(f"got --host {host}, which other machines can reach: also give --token TEXT, which they need to "
                     f"open the page; 127.0.0.1 accepts only this machine")
  if token is not None and (len(token) < _SHORTEST or not token.isascii() or not token.isprintable()):
    raise InputError(f"got a token of {len(token)} characters, expected {_SHORTEST} or more plain letters, digits and "
                     "signs")


def stored_token(folder: pathlib.Path | None = None) -> str:
  """This user's token, the same for every start, so that open pages and bookmarks stay valid.

  It is stored in a file that only the user can read, in $XDG_STATE_HOME or ~/.local/state. If it cannot be stored, each
  call returns a new one. A file that others can read, or without a token, is replaced.
  """
  try:
    path = (folder or home_folder("XDG_STATE_HOME", ".local/state") / "motion_jax") / "studio-token"
    if path.is_file() and (os.name != "posix" or not path.stat().st_mode & 0o077):
      token = path.read_text("ascii", "replace").strip()
      if len(token) >= _SHORTEST and token.isascii() and token.isprintable():
        return token
    token = secrets.token_urlsafe(16)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="ascii") as file:
      file.write(token + "\n")
    return token
  except OSError:
    return secrets.token_urlsafe(16)


def take_port(host: str, port: int) -> socket.socket:
  """A listening socket. Raises InputError if the port is in use or the host is not this machine."""
  try:
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
    taken = socket.socket(family, socket.SOCK_STREAM)
    try:
      if os.name == "posix":
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
      taken.bind((host, port))
      taken.listen(128)
    except OSError:
      taken.close()
      raise
    return taken
  except OSError as error:
    if error.errno == errno.EADDRINUSE:
      raise InputError(f"port {port} of {host} is taken, maybe by another studio; choose another one with --port, or "
                       "--port 0 for a free one") from None
    raise InputError(f"cannot listen on {host} port {port}: {error.strerror or error}") from None


def serve(names: Sequence[str], host: str = "127.0.0.1", port: int = 8765, token: str | None = None,
          open_page: bool = False, public_url: str | None = None) -> None:
  """Run a studio until Ctrl-C. Prints its address, or that of the proxy in front of it, before the slow imports."""
  public_url = public_url and checked_url(public_url)
  check_address(host, token)
  require_packages("the studio", "msgspec", "starlette", "uvicorn", "websockets")
  listener = take_port(host, port)
  token = token or stored_token()
  address = f"{public_url}?token={urllib.parse.quote(token)}" if public_url else address_of(
      host, listener.getsockname()[1], token)
  print(f"the studio is at {address}\nCtrl-C ends it", flush=True)
  if open_page:
    threading.Thread(target=_open, args=(address,), daemon=True).start()
  import uvicorn

  from motion_jax_studio.server.app import Studio
  from motion_jax_studio.server.library import Library
  library = Library(names)
  studio = Studio(library, token, host, public_url=public_url)

  class Server(uvicorn.Server):
    def handle_exit(self, sig, frame):
      studio.close()
      # Compiling threads cannot be stopped; a second is enough to close the pages.
      timer = threading.Timer(_PATIENCE, lambda: os._exit(128 + sig))
      timer.daemon = True
      timer.start()
      super().handle_exit(sig, frame)

  logging.getLogger("uvicorn.error").addFilter(_is_news)
  library.start()
  with progress.follow(progress.Work()):  # pages show the progress of requests, not this terminal
    Server(settings(studio)).run(sockets=[listener])


def checked_url(text: str) -> str:
  """The address of a proxy, ending with /. Raises InputError for another text."""
  try:
    parts = urllib.parse.urlsplit(text)
    known = parts.scheme in ("http", "https") and parts.hostname and not parts.query and not parts.fragment
  except ValueError:
    known = False
  if not known:
    raise InputError(f"got --public-url {text[:80]!r}, expected the address that a browser opens, such as "
                     "https://hub.example.com/user/me/proxy/8765/")
  return text.rstrip("/") + "/"


def address_of(host: str, port: int, token: str) -> str:
  """The address for a browser, with this machine's name for a host that stands for all addresses."""
  name = socket.gethostname() if host in ("0.0.0.0", "::", "") else host
  return f"http://{f'[{name}]' if ':' in name else name}:{port}/?token={urllib.parse.quote(token)}"


def _open(address):
  if not webbrowser.open(address):
    print("no browser was found; open the address by hand", file=sys.stderr)


def settings(studio: Any, app: Any = None) -> Any:
  """The `uvicorn.Config` of a `Studio`, or of an application around it."""
  import uvicorn

  from motion_jax_studio.server import connections
  return uvicorn.Config(app or studio.app(), log_level="warning", access_log=False, lifespan="off",
                        ws="websockets-sansio",
                        http=connections.protocol(studio.limits), limit_concurrency=studio.limits.connections,
                        ws_max_size=2 * studio.limits.message_bytes, ws_per_message_deflate=False,
                        timeout_graceful_shutdown=1, server_header=False, proxy_headers=False)


def _is_news(record: logging.LogRecord) -> bool:
  """Log filter for two events that uvicorn logs as errors: a WebSocket that was refused, or is open at shutdown."""
  return not any(text in record.getMessage() for text in ("without completing handshake", "timeout graceful shutdown"))
