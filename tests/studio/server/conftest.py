"""A studio with a tiny model, in process."""
import contextlib
import importlib.util
import sys
import threading
import tomllib

import jax
import numpy as np
import pytest

from tests.conftest import ROOT

# Only CI is sure to have the extra; tests/test_imports.py proves that it has.
collect_ignore_glob = [] if all(map(importlib.util.find_spec, ("msgspec", "starlette", "motionmcp"))) else ["test_*.py"]

TOKEN = "a-token-of-the-tests"
BASE, SOCKET = "http://127.0.0.1:8765", "ws://127.0.0.1:8765"


@pytest.fixture(scope="session")
def library(tiny_run, tiny_generator):
  """Two models of random weights, ready: "tiny" streams, "editor" edits."""
  from motion_jax import loading
  from motion_jax_studio.server.library import Library
  folders = {"tiny": tiny_run, "editor": tiny_generator}

  def load(name):
    model = loading.load(folders[name])
    if name == "tiny":  # gates that training begins with are nearly shut: words would change nothing
      rng = np.random.default_rng(0)
      model.params = jax.tree.map(lambda x: x + 0.2 * rng.standard_normal(x.shape).astype(x.dtype), model.params)
    return model

  library = Library(list(folders), load)
  library.start()
  for slot in library.slots.values():
    assert slot.ready.wait(300) and slot.state == "ready", slot.error
  return library


@pytest.fixture(scope="session", autouse=True)
def protocols(tmp_path_factory):
  """The entry points of pyproject.toml, as an installation has them: {name: object}."""
  project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
  points = project["entry-points"]["motion_jax_studio.protocols"]
  folder = tmp_path_factory.mktemp("installed")
  about = folder / "motion_jax_as_installed-1.dist-info"
  about.mkdir()
  (about / "METADATA").write_text("Metadata-Version: 2.1\nName: motion-jax-as-installed\nVersion: 1\n")
  (about / "entry_points.txt").write_text("\n".join(["[motion_jax_studio.protocols]", *(
      f"{name} = {value}" for name, value in points.items())]))
  sys.path.insert(0, str(folder))
  yield points
  sys.path.remove(str(folder))


@pytest.fixture
def studio(library):
  from motion_jax_studio.server.app import Studio
  studio = Studio(library, TOKEN)
  yield studio
  streams = list(studio.streams)
  studio.close()
  assert all(stream.join(20) for stream in streams)


@pytest.fixture
def client(studio):
  """Asks as the studio's own page does."""
  from starlette.testclient import TestClient
  return TestClient(studio.app(), base_url=BASE, headers={"authorization": f"Bearer {TOKEN}", "origin": BASE})


@contextlib.contextmanager
def _served(studio, app=None):
  """The address of a studio's application behind a real port."""
  import uvicorn

  from motion_jax_studio.server import server
  listener = server.take_port("127.0.0.1", 0)
  running = uvicorn.Server(server.settings(studio, app))
  thread = threading.Thread(target=lambda: running.run(sockets=[listener]), daemon=True)
  thread.start()
  try:
    yield server.address_of("127.0.0.1", listener.getsockname()[1], TOKEN)
  finally:
    studio.close()
    running.should_exit = True
    thread.join(20)
  assert not thread.is_alive()


@pytest.fixture
def serve(library):
  """A function that opens a studio with other limits on a real port -> its address."""
  from motion_jax_studio.server.app import Studio
  with contextlib.ExitStack() as stack:
    yield lambda limits=None: stack.enter_context(_served(Studio(library, TOKEN, limits=limits)))


@pytest.fixture
def address(studio):
  """Of a studio behind a real port."""
  with _served(studio, studio.app()) as address:
    yield address


@pytest.fixture
def address_below_a_path(studio):
  """Of a studio behind a proxy that serves it at /motion/ alone, as Jupyter, RunPod and nginx do."""
  app = studio.app()

  async def proxy(scope, receive, send):
    if scope["type"] in ("http", "websocket"):
      path = scope["path"].removeprefix("/motion")
      scope = scope | {"path": path if path != scope["path"] else "/v0/outside"}
    await app(scope, receive, send)

  with _served(studio, proxy) as address:
    yield address.replace("/?", "/motion/?")


def refusal(reply, status=400):
  """The sentence of a refused request: one line, no traceback."""
  assert reply.status_code == status, reply.text
  error = reply.json()["error"]
  assert error["status"] == status and "\n" not in error["message"] and "Traceback" not in error["message"]
  return error["message"]


@pytest.fixture(scope="module")
def driver():
  from tests.studio.server.browser import CHROMIUM, DRIVER, webdriver
  options = webdriver.ChromeOptions()
  options.binary_location = CHROMIUM
  for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
               "--enable-unsafe-swiftshader", "--window-size=1000,800", "--hide-scrollbars"):
    options.add_argument(flag)
  options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
  driver = webdriver.Chrome(options, webdriver.ChromeService(DRIVER))
  # Chromium draws in software: where other work has the cores, an answer waits many seconds for the next picture.
  driver.command_executor.client_config.timeout = 600
  driver.implicitly_wait(3)
  yield driver
  driver.quit()


@pytest.fixture
def page(driver, address_below_a_path):
  from tests.studio.server.browser import Page
  first = driver.current_window_handle
  driver.switch_to.new_window("tab")  # a tab that goes to about:blank twice may never answer again where work is slow
  driver.get_log("browser")
  driver.get(address_below_a_path)
  page = Page(driver)
  page.wait("ready")
  yield page
  faults = [row["message"] for row in driver.get_log("browser") if row["level"] == "SEVERE"]
  faults = [text for text in faults if "status of 400" not in text]  # what a test lets the studio refuse
  driver.close()  # its stream ends before the studio does
  driver.switch_to.window(first)
  assert not faults, faults


@pytest.fixture
def timeline(page):
  """The page's timeline with two blocks that have been made."""
  page.find("#mode-timeline").click()
  page.add_block("a person walks")
  page.add_block("a person jumps")
  assert page.prompts() == ["a person walks", "a person jumps"]
  page.wait("stale === false && window.__studio.busy === null")
  return page
