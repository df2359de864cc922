"""Checks the built page in headless Chromium and prints numbers: python site/try/check.py OUT [--pictures FOLDER]

Loads, times and switches prompts with one thread and with two, compares joints, noise and word pieces with Python,
opens its BVH and GLB again, tries odd input, a tab in the background, WebGPU by software, no WebAssembly, no SIMD and a
file that is missing. Needs the extra `test`, chromium and chromedriver.
"""
import argparse
import contextlib
import functools
import http.server
import os
import pathlib
import shutil
import threading
import time

import numpy as np
from selenium import webdriver

import motion_jax as mj

ODD = ["", "   ", "\U0001f600", "a person walks \U0001f600", "una persona camina hacia adelante", "人が歩く",
       "a person floobles", "a person walks and " * 105, "x" * 2000]


# Ten pictures a second leave the processor to what is measured.
SELDOM = "const draw = requestAnimationFrame; window.requestAnimationFrame = (f) => setTimeout(() => draw(f), 80)"


class Handler(http.server.SimpleHTTPRequestHandler):
  isolated, missing = False, ""

  def end_headers(self):
    if self.isolated:
      self.send_header("Cross-Origin-Opener-Policy", "same-origin")
      self.send_header("Cross-Origin-Embedder-Policy", "require-corp")
    super().end_headers()

  def do_GET(self):
    if self.missing and self.missing in self.path:
      return self.send_error(503)
    super().do_GET()

  def log_message(self, *_):
    pass


@contextlib.contextmanager
def served(folder, **choices):
  kind = type("Chosen", (Handler,), choices)
  server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(kind, directory=str(folder)))
  threading.Thread(target=server.serve_forever, daemon=True).start()
  yield f"http://127.0.0.1:{server.server_port}/", kind
  server.shutdown()


@contextlib.contextmanager
def browser(width=400, height=500, dark=False, flags=(), before=SELDOM):
  """Headless Chromium; a small window and few pictures, as the processor draws. before: a script that runs first."""
  options = webdriver.ChromeOptions()
  options.binary_location = shutil.which("chromium")
  for flag in ("--headless=new", "--no-sandbox", "--enable-unsafe-swiftshader", f"--window-size={width},{height}",
               *flags):
    options.add_argument(flag)
  driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
  if dark:
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
        "features": [{"name": "prefers-color-scheme", "value": "dark"}]})
  driver.set_script_timeout(120)
  driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": before})
  if width < 400:
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride",
                           {"width": width, "height": height, "deviceScaleFactor": 2, "mobile": True})
  try:
    yield driver
  finally:
    driver.quit()


def processor_seconds(driver):
  """User and system time of the processes that run pages of this browser, all their threads (Linux)."""
  folder, total = driver.capabilities["chrome"]["userDataDir"], 0
  for process in pathlib.Path("/proc").glob("[0-9]*"):
    with contextlib.suppress(OSError):
      command = (process / "cmdline").read_text()
      if "--type=renderer" in command and folder in command:
        total += sum(map(int, (process / "stat").read_text().rpartition(")")[2].split()[11:13]))
  return total / os.sysconf("SC_CLK_TCK")


def start(driver, url):
  """Opens the page; what its first frame took after its files were there, in processor and in wall seconds."""
  driver.get(url)
  wait(driver, "document.getElementById('doing').textContent.startsWith('starting') || state.begun")
  before = processor_seconds(driver)
  wait(driver, "state.frames")
  spent = processor_seconds(driver) - before
  found = driver.execute_script("const {ready, first} = window.motionTry.state; "
                                "return [ready.fetched, ready.started, first]")
  print(f"first frame {(found[1] + found[2]) / 1000:.2f} s after the files are there, {spent:.2f} processor seconds; "
        f"files after {found[0] / 1000:.2f} s, model started in {found[1] / 1000:.2f} s", flush=True)


def wait(driver, expression, seconds=120):
  end = time.monotonic() + seconds
  while time.monotonic() < end:
    if found := driver.execute_script(f"const {{state}} = window.motionTry ?? {{state: {{}}}}; return {expression}"):
      return found
    time.sleep(0.05)
  raise AssertionError(f"{expression} did not become true; the note says {note(driver)!r}")


def note(driver):
  return driver.execute_script("return document.getElementById('note').textContent")


def timings(driver):
  return driver.execute_script("""const {state} = window.motionTry, sorted = [...state.blocks].sort((a, b) => a - b);
    return {threads: state.ready.threads, load: state.ready.loaded, fetched: state.ready.fetched,
            started: state.ready.started, first: state.first, median: sorted[sorted.length >> 1],
            worst: sorted.at(-1), starved: state.starved,
            frames: state.frames, time: state.time}""")


def show(name, values):
  print(f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in values.items()), flush=True)


def say(driver, prompt):
  driver.execute_script("document.getElementById('prompt').value = arguments[0]; "
                        "document.getElementById('form').requestSubmit()", prompt)


@functools.cache
def python_joints():
  """What Python makes of the page's first prompt and seed: (120, 22, 3) metres."""
  return mj.load("cmdm-small-fast").generate(["a person walks forward"], num_frames=120, seeds=[0])[0].joints


def from_python(driver):
  """Largest distance of the frames that there are, 120 at the most, from Python's, in millimetres."""
  ours = np.array(driver.execute_script("return [...window.motionTry.joints().slice(0, 120 * 66)]"), np.float32)
  ours = ours.reshape(-1, 22, 3)
  return np.linalg.norm(ours - python_joints()[:len(ours)], axis=-1).max() * 1000


def check_motion(folder, captions):
  """One thread: times, a prompt switch, odd input, a pause, and what Python makes of the same."""
  with served(folder) as (url, _), browser() as driver:
    start(driver, url)
    wait(driver, "state.frames >= 120")
    show("one thread, ms", timings(driver))
    print(f"joints of 6 s beside Python's: at most {from_python(driver):.4f} mm")
    check_files(driver, pathlib.Path(folder).parent)
    before = driver.execute_script("return window.motionTry.state.time")
    say(driver, "a person sits down")
    wait(driver, "state.prompts.length === 2 && state.frames >= state.said.from + 12")
    seen = driver.execute_script("const {state} = window.motionTry; return [state.first, state.said.from / 20]")
    print(f"prompt switch at {before:.1f} s: first block after {seen[0]:.0f} ms, seen from {seen[1]:.1f} s on")
    wait(driver, "state.time > state.said.from / 20 + 4")
    joints = np.array(driver.execute_script("return [...window.motionTry.joints()]")).reshape(-1, 22, 3)
    switched = round(seen[1] * 20)
    step = np.linalg.norm(np.diff(joints, axis=0), axis=-1).max(1) * 20
    print(f"pelvis {joints[:switched, 0, 1].min():.2f} m before, {joints[switched:, 0, 1].min():.2f} m after; "
          f"fastest joint {step[:switched - 1].max():.1f} m/s before, "
          f"{step[switched - 2:switched + 1].max():.1f} at the seam, {step[switched + 1:].max():.1f} after; "
          f"{timings(driver)['starved']:.2f} s waited")
    for prompt in ODD:
      say(driver, prompt)
      time.sleep(1)
      assert driver.execute_script("return document.body.dataset.state") == "ready"
      print(f"  {prompt[:40]!r}: {note(driver) or '(no note)'}")
    if captions:
      driver.execute_script("window.motionTry.inspect(arguments[0])", captions)
      pieces = wait(driver, "state.pieces")
      tokenizer = mj.load("cmdm-small-fast").encoder.tokenizer
      differ = [caption for caption, found in zip(captions, pieces) if found != tokenizer.encode(caption).ids]
      print(f"word pieces of {len(captions)} captions: {len(differ)} differ {differ[:3]}")
    print("second visit:", end=" ")
    start(driver, url)
    # In the background: no frames are shown, so no more than what is ahead is made; after it, it goes on.
    driver.switch_to.new_window("tab")
    driver.get("about:blank")
    time.sleep(6)
    driver.switch_to.window(driver.window_handles[0])
    after = timings(driver)
    time.sleep(3)
    show("after 6 s in the background", after)
    show("3 s later", timings(driver))


def check_files(driver, folder):
  """Downloads of the tab, read by motion_jax, beside Python's joints and the joints that the tab shows."""
  for kind in ("bvh", "glb"):
    made = driver.execute_async_script(
        "const done = arguments[1]; "
        "window.motionTry.made(arguments[0]).arrayBuffer().then((b) => done([...new Uint8Array(b)]))", kind)
    path = folder / f"tab.{kind}"
    path.write_bytes(bytes(made))
    joints = mj.export.load(path, unit="cm" if kind == "bvh" else "m").joints[:120]
    far = np.linalg.norm(joints - python_joints(), axis=-1) * 1000
    print(f"{path.name}: {len(made):,} bytes; joints as motion_jax reads them beside Python's motion: "
          f"mean {far.mean():.1f} mm, at most {far.max():.1f} mm, pelvis at most {far[:, 0].max():.3f} mm", flush=True)


def check_webgpu(folder):
  flags = "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader", "--enable-features=Vulkan"
  with served(folder) as (url, _), browser(flags=flags) as driver:
    driver.get(url)
    adapter = driver.execute_async_script(
        "const done = arguments[0]; if (!navigator.gpu) return done('no navigator.gpu'); "
        "navigator.gpu.requestAdapter().then((a) => done(a ? `${a.info.vendor} ${a.info.architecture}` : null))")
    print("WebGPU adapter:", adapter)
    driver.get(f"{url}?engine=webgpu")
    wait(driver, "state.frames >= 24 || document.body.dataset.state === 'failed'", 400)
    if note(driver):
      return print("WebGPU:", note(driver))
    show("WebGPU, ms", timings(driver))
    print(f"WebGPU, joints of the first frames beside Python's: at most {from_python(driver):.4f} mm")


def check_threads(folder, count):
  with served(folder, isolated=True) as (url, _), browser() as driver:
    print(f"{count} threads:", end=" ")
    start(driver, f"{url}?threads={count}")
    wait(driver, "state.frames >= 120")
    show(f"{count} threads, ms", timings(driver))
    print(f"{count} threads, joints of 6 s beside Python's: at most {from_python(driver):.4f} mm")


def check_failures(folder):
  with served(folder) as (url, _), browser(before="delete window.WebAssembly") as driver:
    driver.get(url)
    wait(driver, "document.body.dataset.state === 'failed'")
    print("no WebAssembly:", note(driver))
  with served(folder) as (url, kind), browser() as driver:
    driver.get(f"{url}?nosimd")
    wait(driver, "document.body.dataset.state === 'failed'")
    print("no SIMD:", note(driver))
    kind.missing = "step.onnx"
    driver.get(url)
    wait(driver, "document.body.dataset.state === 'failed'")
    print("a missing file:", note(driver))
    kind.missing = ""
    driver.find_element("id", "again").click()
    wait(driver, "state.frames >= 12")
    print("after Try again: ready,", note(driver) or "no note")


def pictures(folder, out):
  out = pathlib.Path(out)
  out.mkdir(parents=True, exist_ok=True)
  for name, size in (("desktop", (1200, 800)), ("phone", (390, 780))):
    for dark in (False, True):
      with served(folder) as (url, _), browser(*size, dark) as driver:
        driver.get(url)
        driver.save_screenshot(str(out / f"{name}-{'dark' if dark else 'light'}-loading.png"))
        wait(driver, "state.frames >= 36")
        driver.execute_script("window.motionTry.state.time = 1.5")
        time.sleep(2)
        driver.save_screenshot(str(out / f"{name}-{'dark' if dark else 'light'}.png"))


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("folder", help="folder that build.py wrote")
  parser.add_argument("--captions", help="text file, a caption a line, whose word pieces are compared")
  parser.add_argument("--pictures", help="folder for screenshots")
  parser.add_argument("--only", choices=("motion", "threads", "webgpu", "failures", "pictures"))
  args = parser.parse_args()
  captions = pathlib.Path(args.captions).read_text(encoding="utf-8").splitlines() if args.captions else []
  checks = {
      "motion": lambda: check_motion(args.folder, captions),
      "threads": lambda: [check_threads(args.folder, count) for count in (1, 2)],
      "webgpu": lambda: check_webgpu(args.folder), "failures": lambda: check_failures(args.folder)}
  if args.pictures:
    checks["pictures"] = lambda: pictures(args.folder, args.pictures)
  for name, check in checks.items():
    if args.only in (None, name):
      check()


if __name__ == "__main__":
  main()
