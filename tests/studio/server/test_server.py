"""The program as a user starts it: the address at once, a port that is taken, Ctrl-C, and a client without JAX."""
import re
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest

from motion_jax.utils import cache
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from motion_jax_studio.client import Client, joints_of
from motion_jax_studio.server import server
from motion_jax_studio.server.library import Library
from tests.conftest import devices_env


def test_the_client_streams_says_and_asks(address):
  client = Client(address)
  assert [model["name"] for model in client.models()] == ["tiny", "editor"]
  with client.stream("a person walks", seed=3, speed=0, frames=96) as live:
    pieces = []
    for joints in live:
      pieces.append(joints)
      if len(pieces) == 2:
        live.say("a person jumps")
  made = np.concatenate(pieces)
  assert made.shape == (96, 22, 3) and live.last["committed"] == 96 and live.last["contacts"].shape[1] == 4
  assert [message["prompt"] for message in live.messages if message["type"] == "words"] == ["a person walks",
                                                                                       "a person jumps"]
  motion = client.generate("a person walks", seconds=1, model="tiny", sampling={"num_steps": 4})[0]
  assert joints_of(motion).shape == (20, 22, 3)
  with pytest.raises(ValueError, match="empty prompt"):
    client.generate(" ")


def test_the_client_needs_no_jax():
  code = "import motion_jax_studio.client, sys; assert not {'jax', 'starlette', 'scipy'} & set(sys.modules)"
  assert subprocess.run([sys.executable, "-c", code], env=devices_env(1), check=False).returncode == 0


def test_a_port_that_is_taken_is_told(capsys):
  with socket.socket() as other:
    other.bind(("127.0.0.1", 0))
    other.listen()
    port = other.getsockname()[1]
    assert cli.main(["studio", "--port", str(port)]) == 1
  said = capsys.readouterr().err
  assert f"port {port} of 127.0.0.1 is taken" in said and "--port" in said and len(said.splitlines()) == 1


@pytest.mark.parametrize("words, told", [
    (["--host", "0.0.0.0"], "--token"), (["--model", "nowhere"], "nowhere"), (["--token", "short"], "16 or more"),
    (["--host", "192.0.2.1", "--token", "long-enough-a-token"], "cannot listen on 192.0.2.1")])
def test_what_cannot_be_served_is_told(capsys, words, told):
  assert cli.main(["studio", *words]) == 1
  said = capsys.readouterr().err
  assert told in said and len(said.splitlines()) == 1


@pytest.mark.parametrize("words, package", [(["studio", "--port", "0"], "uvicorn"), (["make", "p.json"], "msgspec")])
def test_a_missing_package_is_reported_before_anything_else(capsys, monkeypatch, words, package):
  monkeypatch.setattr(server.importlib.util, "find_spec", lambda name: None if name == package else name)
  assert cli.main(words) == 1
  output = capsys.readouterr()
  assert f"needs the packages {package}: pip install" in output.err and not output.out


def test_the_token_is_kept_for_the_user_alone(tmp_path):
  folder = tmp_path / "state"
  token = server.stored_token(folder)
  path = folder / "studio-token"
  assert len(token) >= 16 and path.stat().st_mode & 0o777 == 0o600
  assert server.stored_token(folder) == token
  path.chmod(0o640)  # others may have read it
  assert (other := server.stored_token(folder)) != token and path.stat().st_mode & 0o777 == 0o600
  for content in ("", "short", "ä" * 20):
    path.write_text(content)
    assert server.stored_token(folder) not in (content, other, "")
  blocked = tmp_path / "file"
  blocked.write_text("")
  for place in (blocked, blocked / "below"):
    assert server.stored_token(place) != server.stored_token(place)


def test_a_user_without_a_home_gets_a_token_and_no_cache(monkeypatch):
  """As in a container whose user has no name."""
  def nameless(number):
    raise KeyError(number)

  monkeypatch.setattr("pwd.getpwuid", nameless)
  for name in ("HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME"):
    monkeypatch.delenv(name, raising=False)
  assert len(server.stored_token()) >= 16 and server.stored_token() != server.stored_token()
  monkeypatch.setattr(cache, "_folder", None)
  cache.keep_in_user_cache()
  assert cache._folder is None


def test_addresses_can_be_opened():
  assert server.address_of("127.0.0.1", 80, "a b") == "http://127.0.0.1:80/?token=a%20b"
  assert server.address_of("::1", 80, "x") == "http://[::1]:80/?token=x"
  assert server.address_of("0.0.0.0", 80, "x") == f"http://{socket.gethostname()}:80/?token=x"
  with pytest.raises(InputError, match="cannot listen"):
    server.take_port("no.such.host.invalid", 0)


def test_a_model_that_fails_leaves_the_others(library):
  def load(name):
    if name == "lost":
      raise OSError("no such file")
    return library.model(name, "stream")

  models = Library(["lost", "tiny"], load, warm=False)
  models.start().join(60)
  assert models.model("tiny", "stream") is library.model("tiny", "stream")
  with pytest.raises(InputError, match="the model lost could not be loaded: no such file"):
    models.pipeline("lost", "stream")


@pytest.mark.slow
def test_the_address_comes_at_once_and_the_end_within_two_seconds(tiny_run, tmp_path):
  """Ended while models are being read or compiled, which hears nothing. A restart has the same address, and a refused
  socket is no error in the log."""
  from websockets.exceptions import InvalidStatus
  from websockets.sync.client import connect
  env, port, addresses = devices_env(1) | {"XDG_STATE_HOME": str(tmp_path)}, "0", set()
  for number in (signal.SIGINT, signal.SIGTERM):
    program = subprocess.Popen([sys.executable, "-m", "motion_jax_studio.cli", "studio", "--model", str(tiny_run),
                                "--port", port], env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
      line = program.stdout.readline()
      match = re.fullmatch(r"the studio is at (http://(127\.0\.0\.1:(\d+))/\?token=\S{16,})\n", line)
      assert match, line
      address, host, port = match.groups()
      addresses.add(address)
      assert Client(address).models()[0]["state"] in ("waiting", "loading", "compiling", "ready")
      with pytest.raises(InvalidStatus):
        connect(f"ws://{host}/v1/stream?token=wrong", origin=f"http://{host}")
      began = time.monotonic()
      program.send_signal(number)
      said = program.communicate(timeout=20)[1].strip()
      assert time.monotonic() - began < 2.5 and program.returncode == 128 + number
      assert said == "motion-jax: stopped; nothing half-written is left"
    finally:
      program.kill()
      program.wait()
  assert len(addresses) == 1
