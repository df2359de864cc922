"""The HTML page: whole, offline, and alive in a headless browser where one is installed."""
import base64
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from PIL import Image

from motion_jax import export
from motion_jax.control.compiling import compile
from motion_jax.control.constraints import EffectorTarget, Keyframe, RootPath
from motion_jax.control.signal import none
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_joints


def make(action="walk", num_frames=30, caption=None):
  joints = synthetic_joints(action, num_frames, np.random.default_rng(0)).astype(np.float32)
  return Clip(joints=joints, captions=(Caption(caption or f"a person does: {action}"),), id=action)


def data_of(path):
  text = path.read_text(encoding="utf-8")
  return json.loads(re.search(r'<script id="motion" type="application/json">(.*?)</script>', text, re.S)[1])


def test_page_holds_the_motion(tmp_path):
  clips = [make("walk"), make("wave_left", 12).replace(fps=32.0)]
  path, = export.save(clips, tmp_path / "a.html")
  data = data_of(path)
  assert [(clip["frames"], clip["fps"]) for clip in data["clips"]] == [(30, 20), (12, 32)]
  for clip, one in zip(clips, data["clips"]):
    joints = np.frombuffer(base64.b64decode(one["joints"]), "<f4").reshape(-1, 22, 3)
    np.testing.assert_array_equal(joints, clip.joints)
    turned = np.frombuffer(base64.b64decode(one["turned"]), "<i2").reshape(-1, 22, 4)
    assert len(turned) == clip.num_frames
    np.testing.assert_allclose(np.linalg.norm(turned / 32767, axis=-1), 1, atol=1e-3)
    assert one["captions"][0]["text"] == clip.captions[0].text


def test_frames_may_have_colors_of_their_own(tmp_path):
  colors = np.full((30, 3), np.nan)
  colors[:10], colors[20:25] = (0.25, 0.5, 0.9), (0.9, 0.5, 0.1)
  path, = export.save(make(), tmp_path / "a.html", colors=colors)
  assert data_of(path)["clips"][0]["tints"] == [{"first": 0, "past": 10, "color": [0.25, 0.5, 0.9]},
                                                {"first": 20, "past": 25, "color": [0.9, 0.5, 0.1]}]
  with pytest.raises(ValueError, match=r"colors of shape \(29, 3\)"):
    export.html(make(), tmp_path / "b.html", colors=colors[1:])


def asked_of(clip, off=(0.03, 0.0, 0.04)):
  """Path, target and pose, all met but for the target, which is so many metres away."""
  return [RootPath(clip.joints[:21, 0][:, [0, 2]], np.arange(21) / 20),
          EffectorTarget("left_hand", [0.5], [clip.joints[10, 20] + off]),
          Keyframe(clip.joints[24], 1.2, "world")]


@pytest.mark.slow
def test_what_was_asked_is_in_the_page_and_how_far_off_the_motion_is(tmp_path):
  clip = make()
  signal = compile(asked_of(clip), 30)
  points = [[0.0, 0.0], [0.5, 1.0]]
  path, = export.save(clip, tmp_path / "a.html", control=signal, way_points=points)
  drawn = data_of(path)["clips"][0]["constraints"]
  assert drawn["points"] == points and [target[0] for target in drawn["targets"]] == [10]
  assert [pose["frame"] for pose in drawn["poses"]] == [24]
  joints = np.frombuffer(base64.b64decode(drawn["poses"][0]["joints"]), "<f4").reshape(22, 3)
  np.testing.assert_allclose(joints, clip.joints[24], atol=1e-5)
  assert len(np.frombuffer(base64.b64decode(drawn["poses"][0]["turned"]), "<i2")) == 22 * 4
  assert abs(np.array(drawn["lines"][0]) - signal.positions[0, :21, 0][:, [0, 2]]).max() < 1e-4
  assert drawn["off"]["frame"] == 10 and drawn["off"]["joint"] == "left wrist" and 49 < drawn["off"]["worst"] < 51
  assert 0 < drawn["off"]["mean"] < 10
  nothing = data_of(export.html([clip, clip], tmp_path / "b.html", control=[signal, none(1, 30)]))["clips"]
  own, other = nothing[0]["constraints"], nothing[1]["constraints"]
  assert "off" in own and "off" not in other and other["lines"] == []


def test_page_loads_nothing_from_anywhere(tmp_path):
  text = export.html(make(num_frames=4), tmp_path / "a.html").read_text(encoding="utf-8")
  shell = re.sub(r"<script>.*</script>", "", text, flags=re.S)
  assert not re.search(r"(src|href)\s*=|@import|url\(|fetch\(|import\(", shell)
  assert text.count("<script") == 2 + text.split("<script>")[1].count("<script"), "one script of data, one of code"
  assert "three.js authors" in text and "MIT License" in text
  assert len(text) < 1_300_000


def test_captions_cannot_break_the_page(tmp_path):
  evil = "</script><script>alert(1)</script><!-- @DATA@ @VIEWER@ & \"quoted\" \\u003c \U0001f57a"
  path = export.html(make(num_frames=4, caption=evil), tmp_path / "a.html")
  assert data_of(path)["clips"][0]["captions"][0]["text"] == evil
  assert "alert(1)</script>" not in path.read_text(encoding="utf-8")


BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None, reason="no Chromium here to open the page with")
def test_a_browser_plays_the_page_and_shows_what_was_asked(tmp_path):
  clip, command = make(), [
      BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
      "--window-size=900,600", "--virtual-time-budget=3000", f"--user-data-dir={tmp_path / 'profile'}"]
  asked = compile(asked_of(clip, (0.5, 0.3, 0)), 30)
  page = f"file://{export.html([clip, make('wave_left')], tmp_path / 'a.html', control=[asked, None])}#0.25"
  dom = subprocess.run([*command, "--dump-dom", page], capture_output=True, text=True, timeout=180).stdout
  assert 'data-state="ready"' in dom and 'data-frame="5"' in dom and 'id="constraints"' in dom
  assert "1. a person does: walk" in dom and '<option value="1">2. a person does: wave_left</option>' in dom
  assert "worst 583 mm (left wrist at 0.50 s)" in dom
  done = subprocess.run([*command, "--enable-logging=stderr", f"--screenshot={tmp_path / 'a.png'}", page],
                        capture_output=True, text=True, timeout=180, check=True)
  said = [line for line in done.stderr.splitlines() if "CONSOLE" in line and "GL Driver Message" not in line]
  assert not said, "no warnings of the page in the browser's console"
  image = np.asarray(Image.open(tmp_path / "a.png").convert("RGB")).astype(int)
  red, green, blue = np.moveaxis(image, -1, 0)
  assert image[:20, :20].min() > 220
  assert (red > blue + 60).sum() > 500 and (blue > red + 60).sum() > 500, "orange and blue limbs"
  assert ((green > red + 40) & (green > blue + 20)).sum() > 200, "the path"
  assert ((red > green + 110) & (blue > green + 30)).sum() > 60, "the target"
