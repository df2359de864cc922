"""What a studio refuses before anything else looks at it."""
import asyncio
import contextlib
import math
import socket
import time
import types
import urllib.parse

import pytest
from starlette.testclient import TestClient, WebSocketDenialResponse

from motion_jax.export.html import VIEWER
from motion_jax.utils.errors import InputError
from motion_jax_studio.server import app, security, server
from motion_jax_studio.server.app import ASSETS, Studio
from motion_jax_studio.server.limits import Limits, TokenBucket
from tests.studio.server.conftest import BASE, SOCKET, TOKEN, refusal


@pytest.fixture
def stranger(studio):
  """A page that was not told the token."""
  return TestClient(studio.app(), base_url=BASE)


@pytest.mark.parametrize("path", ["/v1/status", "/v1/nothing", "/mmcp/capabilities"])
def test_without_the_token_there_is_nothing(stranger, path):
  assert "token is missing or wrong" in refusal(stranger.get(path), 401)
  assert refusal(stranger.get(path, headers={"authorization": "Bearer " + TOKEN[:-1]}), 401)
  assert refusal(stranger.get(f"{path}?token={TOKEN}x"), 401)
  assert stranger.get(f"{path}?token={TOKEN}").status_code in (200, 404)


def test_a_stream_takes_the_token_too(stranger):
  for url in ("/v1/stream", "/v1/stream?token=wrong"):
    with pytest.raises(WebSocketDenialResponse) as denied, stranger.websocket_connect(SOCKET + url):
      pass
    assert refusal(denied.value, 401)
  with stranger.websocket_connect(f"{SOCKET}/v1/stream?token={TOKEN}"):
    pass


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:9", "http://localhost:8765", "null",
                                    "http://127.0.0.1:8765.evil.example", "http://["])
def test_other_pages_may_not_ask(client, origin):
  assert "only the studio's own pages" in refusal(client.get("/v1/status", headers={"origin": origin}), 403)
  address = f"{SOCKET}/v1/stream?token={TOKEN}"
  with pytest.raises(WebSocketDenialResponse) as denied, client.websocket_connect(address, headers={"origin": origin}):
    pass
  assert refusal(denied.value, 403)


def test_no_other_name_leads_here(client, library):
  """DNS rebinding: the attacker's name points to this machine, so its pages have this machine's origin."""
  evil = {"host": "evil.example:8765", "origin": "http://evil.example:8765"}
  assert "open it as 127.0.0.1" in refusal(client.get("/v1/status", headers=evil), 403)
  for host in ("localhost:8765", "[::1]:8765"):
    assert client.get("/v1/status", headers={"host": host, "origin": f"http://{host}"}).status_code == 200
  # A studio for other machines is known by names that it cannot know; the token keeps strangers out.
  app = Studio(library, TOKEN, host="0.0.0.0").app()
  reply = TestClient(app, base_url="http://desk.lan").get("/v1/status", headers={"authorization": f"Bearer {TOKEN}"})
  assert reply.status_code == 200


def test_pages_of_a_named_proxy_may_ask(library):
  """Proxies keep the visitor's Host, or send the studio's own."""
  url = server.checked_url("https://hub.example.com/proxy/8765")
  client = TestClient(Studio(library, TOKEN, public_url=url).app(), headers={"authorization": f"Bearer {TOKEN}"})
  for host, origin, status in (("hub.example.com", "https://hub.example.com", 200), ("evil.example", None, 403),
                               ("localhost:8765", "https://hub.example.com", 200),
                               ("localhost:8765", "https://evil.example", 403)):
    headers = {"host": host} | ({"origin": origin} if origin else {})
    assert client.get("http://localhost/v1/status", headers=headers).status_code == status, (host, origin)
  assert url == "https://hub.example.com/proxy/8765/"
  for wrong in ("hub.example.com", "ftp://hub", "https://hub/?a=b", "http://[", ""):
    with pytest.raises(InputError, match="--public-url"):
      server.checked_url(wrong)


def test_other_machines_need_a_token():
  server.check_address("127.0.0.1", None)
  server.check_address("0.0.0.0", "long-enough-a-token")
  with pytest.raises(InputError, match="--token"):
    server.check_address("0.0.0.0", None)
  with pytest.raises(InputError, match="16 or more"):
    server.check_address("127.0.0.1", "fifteen-letters")


def test_bodies_have_a_limit(studio, client):
  big = b"x" * (studio.limits.body_bytes + 1)
  assert "expected at most" in refusal(client.post("/v1/import?name=a.npz", content=big), 413)
  assert "a body of more than" in refusal(client.post("/v1/import?name=a.npz", content=iter([big[:9], big])), 413)
  assert refusal(client.post("/v1/generate", content=b"{}", headers={"content-length": "1e9"}), 413)


def test_requests_have_a_rate(client, monkeypatch):
  monkeypatch.setattr(security, "time", types.SimpleNamespace(monotonic=lambda: 0.0))  # a slow machine asks slowly
  replies = [client.get("/v1/status") for _ in range(90)]
  late = [reply for reply in replies if reply.status_code != 200]
  assert late and "requests a second" in refusal(late[0], 429) and late[0].headers["retry-after"] == "1"
  assert sum(reply.status_code == 200 for reply in replies) >= 60


def test_guessed_tokens_have_a_rate_that_spares_known_addresses(studio, stranger, client, monkeypatch):
  """A right guess after too many wrong ones is refused too; an address that has sent the token before is not."""
  monkeypatch.setattr(security, "time", types.SimpleNamespace(monotonic=lambda: 0.0))
  guess = lambda token: stranger.get("/v1/status", headers={"authorization": f"Bearer {token}"}).status_code
  assert [guess(f"guess {i}") for i in range(16)] == [401] * 15 + [429] and guess(TOKEN) == 429
  assert client.get("/v1/status").status_code == 200  # the same limits, another application
  assert [client.get("/v1/status?token=x", headers={"authorization": ""}).status_code for _ in range(16)][-1] == 429
  assert client.get("/v1/status").status_code == 200


def test_json_of_very_many_values_is_refused_and_no_json_is_parsed_in_the_event_loop(client, monkeypatch):
  content, loops = b"[" * 4_000_001, []
  assert "4,000,001 values, expected at most 4,000,000" in refusal(client.post("/v1/generate", content=content), 413)
  monkeypatch.setattr(app.json, "loads", lambda *_, **__: loops.append(asyncio._get_running_loop()))
  for path in ("/v1/generate", "/v1/multi-prompt", "/v1/edit", "/v1/export", "/v1/project", "/mmcp/generate"):
    client.post(path, content=b"{}")
  assert loops == [None] * 6


def test_a_broken_upload_is_no_fault(address, caplog):
  """Sent in part and given up: no traceback."""
  url = urllib.parse.urlsplit(address)
  for path in ("v1/import?name=a.npz", "v1/generate?", "mmcp/generate?"):
    with socket.create_connection((url.hostname, url.port)) as broken:
      broken.sendall(f"POST /{path}&token={TOKEN} HTTP/1.1\r\nhost: {url.netloc}\r\n".encode()
                     + b"content-length: 99\r\n\r\n{")
      time.sleep(0.1)
  time.sleep(0.3)
  assert not caplog.records


def test_connections_that_wait_are_closed(serve, caplog):
  """Without a request, with half of its headers or body, or a reply that is not read: other clients are served."""
  url = urllib.parse.urlsplit(serve(Limits(patience=0.3, idle=4)))
  connect = lambda: socket.create_connection((url.hostname, url.port), timeout=10)
  whole = f"GET /v1/status?token={TOKEN} HTTP/1.1\r\nhost: {url.netloc}\r\n".encode()
  silent = [connect() for _ in range(40)]
  with connect() as half:
    half.sendall(whole)
    with connect() as page:
      page.sendall(whole + b"\r\n")
      assert page.recv(99).startswith(b"HTTP/1.1 200"), "others are served meanwhile"
      page.sendall(whole)  # half of a second request
      while page.recv(9999):
        pass
    assert half.recv(9) == b""
  for one in silent:
    with one, contextlib.suppress(ConnectionResetError):
      assert one.recv(9) == b""
  with connect() as body:
    body.sendall(whole.replace(b"GET /v1/status?", b"POST /v1/import?name=a.npz&") + b"content-length: 9\r\n\r\n{")
    assert b"408" in body.recv(99)
  with connect() as deaf, contextlib.suppress(ConnectionResetError):
    deaf.sendall(100 * (whole.replace(b"v1/status", b"viewer.js") + b"\r\n"))
    time.sleep(1.2)
    read = 0
    while part := deaf.recv(1 << 20):
      read += len(part)
    assert read < 100 * VIEWER.stat().st_size
  assert not [record for record in caplog.records if record.exc_info]


def test_a_bucket_fills_again():
  bucket = TokenBucket(2.0)
  assert [bucket.take(0.0) for _ in range(8)] == [True] * 6 + [False] * 2
  assert bucket.take(0.5) and not bucket.take(0.5) and not bucket.take(-math.inf)
  assert [bucket.take(900.0) for _ in range(7)] == [True] * 6 + [False], "a long rest allows no longer burst"


def test_a_fault_shows_no_traceback(client, studio, monkeypatch, caplog):
  def broken(body):
    raise RuntimeError("/home/somebody/secret.py")

  monkeypatch.setattr(studio.handler, "read", lambda data, name: broken(data))
  told = refusal(client.post("/v1/import?name=a.npz", content=b"x"), 500)
  assert "RuntimeError" in told and "secret" not in told and "secret" in caplog.text


@pytest.mark.parametrize("path", ["/../app.py", "/%2e%2e/app.py", "/..%2fapp.py", "//etc/passwd", "/assets/../app.py",
                                  "/studio.js/../../app.py", "/index.html%00.js"])
def test_only_the_pages_own_files_are_served(client, path):
  reply = client.get(path)
  served = [file.read_bytes() for file in ASSETS.rglob("*") if file.is_file()]
  assert reply.status_code == 404 or reply.content in served


def test_the_page_is_served_whole_and_loads_nothing_from_elsewhere(stranger):
  page = stranger.get("/")
  assert page.status_code == 200 and page.text == stranger.get("/index.html").text
  policy = page.headers["content-security-policy"]  # which lets the viewer read pictures inside a character
  assert "default-src 'self'" in policy
  assert "img-src 'self' data: blob:" in policy and "connect-src 'self' blob:" in policy
  assert page.headers["referrer-policy"] == "no-referrer" and page.headers["x-content-type-options"] == "nosniff"
  for file in ASSETS.rglob("*"):
    if file.is_file():
      assert stranger.get(f"/{file.relative_to(ASSETS).as_posix()}").content == file.read_bytes()
    if file.suffix in (".html", ".css"):
      assert "//" not in file.read_text().replace("http://www.w3.org", "")


def test_wrong_addresses_are_told(client):
  assert "/openapi.json" in refusal(client.get("/v1/nothing"), 404)
  assert "does not take GET" in refusal(client.get("/v1/generate"), 405)
