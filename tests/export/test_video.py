"""Pictures and films: that they show the body where it is, last as long as the motion, and leave nothing behind."""
import importlib.util
import shutil
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from motion_jax import export
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.export import render
from motion_jax.export.video import _caption
from tests.export.test_html import make

SIZE = (200, 160)


def is_color(image, low, high):
  return ((image >= low) & (image <= high)).all(-1)


ORANGE, BLUE = ((120, 40, 10), (255, 150, 110)), ((10, 60, 120), (110, 180, 255))


def test_left_is_blue_and_on_the_viewers_right():
  image = export.frame(make("stand", 3), 0, SIZE, azimuth=0, caption="")
  right, left = is_color(image, *ORANGE), is_color(image, *BLUE)
  assert right.sum() > 150 and left.sum() > 150
  assert np.nonzero(right)[1].mean() < np.nonzero(left)[1].mean(), "seen from the front, left limbs are to the right"


@pytest.mark.slow
def test_the_whole_body_is_inside_the_picture():
  for action in ("walk", "jump", "wave_left"):
    for image in list(export.frames(make(action, 30), SIZE, caption=""))[::6]:
      body = is_color(image, *ORANGE) | is_color(image, *BLUE)
      rows, columns = np.nonzero(body)
      assert rows.min() > 2 and rows.max() < SIZE[1] - 3 and columns.min() > 2 and columns.max() < SIZE[0] - 3


def test_a_sphere_is_drawn_where_it_is_projected():
  camera = render.look_at([0, 1, 0], 0.0, 0.0, 5.0, 2.0)
  at = np.array([[0.4, 1.3, 0.2]])
  radius = np.array([0.2])
  image = render.draw(camera, SIZE, -50.0, [(at, at, radius, radius, np.array([[1.0, 0, 0]]))])
  rows, columns = np.nonzero(is_color(image, (60, 0, 0), (255, 90, 90)))
  (x, y), depth = (value[0] for value in render.project(camera, at, SIZE))
  assert columns.mean() == pytest.approx(x, abs=1) and rows.mean() == pytest.approx(y, abs=1)
  expected = np.pi * (0.2 * camera.focal * SIZE[1] / depth) ** 2
  assert len(rows) == pytest.approx(expected, rel=0.08)


def test_nearer_limbs_hide_farther_ones():
  camera = render.look_at([0, 0, 0], 0.0, 0.0, 8.0, 2.0)
  ends = np.array([[0, 0, -1.0], [0, 0, 1.0]])
  radius, colors = np.array([0.5, 0.3]), np.array([[1.0, 0, 0], [0, 0, 1.0]])
  for order in ([0, 1], [1, 0]):
    image = render.draw(camera, SIZE, -50.0, [(ends[order], ends[order], radius[order], radius[order], colors[order])])
    assert image[80, 100, 2] > 100 > image[80, 100, 0]


@pytest.mark.parametrize("steep", [0.5, 2.0])
def test_a_strip_holds_all_of_a_body_that_comes_up_to_the_viewer_and_goes_away_again(tmp_path, steep):
  joints, num = synthetic_joints("stand", 60, np.random.default_rng(0)).astype(np.float32), 60
  along = np.linspace(0, 12, num)
  moves = np.stack([along, 0 * along, steep * 6 * np.sin(2 * np.pi * along / 12)], -1)[:, None]
  clip = Clip(joints=joints[:1] + moves.astype(np.float32), fps=20.0)
  strip = np.asarray(Image.open(export.strip(clip, tmp_path / "strip.png", caption="", colors=(1.0, 0.0, 0.0))))
  body = (strip[..., 0] > 120) & (strip[..., 1] < 90)
  assert not body[:3].any() and not body[-3:].any() and not body[:, :3].any() and not body[:, -3:].any()
  each = np.diff(np.flatnonzero(np.diff(np.pad(body.any(0), 1).astype(int))))[::2]  # columns of each that stands apart
  assert len(each) == 8


def test_one_frame_and_a_body_of_no_size_are_drawn(tmp_path):
  one = Clip(joints=make().joints[:1])
  assert Image.open(export.strip(one, tmp_path / "one.png", height=100)).height == 100
  assert export.frame(one.replace(joints=0 * one.joints), 0, SIZE).shape == (160, 200, 3)


def test_without_an_encoder_mp4_says_what_to_install(tmp_path, monkeypatch):
  monkeypatch.setattr(shutil, "which", lambda name: None)
  monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
  with pytest.raises(RuntimeError, match=r"pip install -q \"\.\[video\]\".*\.gif"):
    export.save(make("walk", 12), tmp_path / "a.mp4")
  assert not list(tmp_path.iterdir())


@pytest.mark.skipif(not (shutil.which("ffmpeg") or importlib.util.find_spec("imageio_ffmpeg")),
                    reason="no ffmpeg here; the extra `video` brings one")
def test_mp4(tmp_path):
  path, = export.save(make("walk", 10), tmp_path / "a.mp4", size=(201, 160))  # made even
  from motion_jax.export.video import find_ffmpeg
  said = subprocess.run([find_ffmpeg(), "-i", str(path), "-f", "null", "-"], capture_output=True, text=True).stderr
  assert "202x160" in said and "frame=   10" in said and "00:00:00.50" in said
  assert [p.name for p in tmp_path.iterdir()] == ["a.mp4"]


def test_a_failing_encoder_leaves_nothing(tmp_path, monkeypatch):
  program = tmp_path / "bin" / "ffmpeg"
  program.parent.mkdir()
  program.write_text("#!/bin/sh\necho 'Unknown encoder libx264' >&2\nexit 1\n")
  program.chmod(0o755)
  monkeypatch.setattr(shutil, "which", lambda name: str(program))
  with pytest.raises(RuntimeError, match="Unknown encoder.*try a .gif"):
    export.save(make("walk", 12), tmp_path / "out" / "a.mp4", size=SIZE)
  assert not list((tmp_path / "out").iterdir())


def test_captions_with_times_follow_one_another():
  clip = make("walk", 40)
  told = clip.replace(captions=(Caption("walks", 0.0, 1.0), Caption("sits", 1.0, 2.0)))
  assert [_caption(told, t) for t in (0, 19, 20, 39)] == ["walks", "walks", "sits", "sits"]
  assert _caption(told) == "walks | sits"
  about_all = clip.replace(captions=(Caption("one wording"), Caption("another")))
  assert _caption(about_all, 7) == _caption(about_all) == "one wording"
