"""How films look: cameras, sizes, backgrounds, rates, parts; by flags, each checked before anything is made."""
import argparse
import re
import sys

import numpy as np
import pytest
from PIL import Image

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.export import frame, npz, video
from motion_jax.utils import progress
from motion_studio import cli

SIZE = (96, 72)


@pytest.fixture(scope="module")
def walk():
  return synthetic_clips(0, 2, num_frames=30)[1]


def _body(image):
  """Pixels (N, 2) where the orange right or the blue left limbs are."""
  red, blue = (image[..., i].astype(int) for i in (0, 2))
  return np.argwhere(np.abs(red - blue) > 45)


def test_cameras_look_from_where_they_say(walk):
  views = {camera: frame(walk, 15, SIZE, camera=camera, path=False, caption="") for camera in
           ("front", "side", "top", "three-quarter", "auto")}
  assert (views["three-quarter"] == views["auto"]).all()  # of old
  images = list(views.values())[:4]
  assert all((a != b).any() for i, a in enumerate(images) for b in images[:i])
  height = {camera: np.ptp(_body(image)[:, 0]) for camera, image in views.items()}
  assert height["top"] < 0.7 * height["front"]  # from above a standing body is short
  # From the front the person's right (orange) is on the left of the picture.
  red, blue = (np.argwhere(sign * (views["front"][..., 0].astype(int) - views["front"][..., 2]) > 45)[:, 1].mean()
               for sign in (1, -1))
  assert red < blue


def test_backgrounds(walk):
  dark, white = (frame(walk, 0, SIZE, background=color) for color in ("#102030", "white"))
  assert np.abs(dark[2, 2].astype(int) - (16, 32, 48)).max() <= 1 and (white[2, 2] == 255).all()
  assert (frame(walk, 0, SIZE, background=(1.0, 1.0, 1.0)) == white).all()


def test_a_film_at_another_rate_lasts_as_long(walk, tmp_path):
  """Colours go with their frames: red until 0.3 s, then blue."""
  walk, colors = walk.cut(0, 12), np.repeat([[1.0, 0, 0], [0, 0, 1.0]], 6, axis=0)
  video(walk, tmp_path / "a.gif", SIZE, fps=10, colors=colors, caption="")
  with Image.open(tmp_path / "a.gif") as slow:
    assert slow.n_frames == 6 and slow.size == SIZE
    for t, blue in ((2, False), (4, True)):
      slow.seek(t)
      pixels = np.asarray(slow.convert("RGB")).astype(int)
      assert ((pixels[..., 2] > pixels[..., 0] + 60).sum() > 20) == blue, t


def test_frames_between_are_interpolated_smoothly(monkeypatch, walk, tmp_path):
  drawn = []
  module = sys.modules[video.__module__]
  monkeypatch.setattr(module, "_write_mp4", lambda path, *_: path.write_bytes(b"film"))
  monkeypatch.setattr(module, "find_ffmpeg", lambda: "none")
  monkeypatch.setattr(module, "frames", lambda clip, size, **_: drawn.append((clip, size)) or [])
  swing = np.sin(np.arange(20) * 2 * np.pi / 10)  # a wave of ten frames, as fast as limbs go at 20 a second
  still = walk.joints[:1].repeat(20, 0)
  still[:, 20, 0] += swing.astype(np.float32)
  video(walk.replace(joints=still), tmp_path / "a.mp4", fps=60)
  (clip, size), = drawn
  assert size == (960, 540) and clip.fps == 60 and clip.num_frames == 58
  exact = still[0, 20, 0] + np.sin(np.arange(58) / 3 * 2 * np.pi / 10)
  assert np.abs(clip.joints[6:-6, 20, 0] - exact[6:-6]).max() < 0.01  # straight lines between are 0.05 off


@pytest.mark.parametrize("options, words", [
    (dict(camera="frnt"), "did you mean front?"), (dict(background="wite"), "did you mean white?"),
    (dict(background=(2, 0, 0)), "0..1"), (dict(size=(5, 5)), "WIDTHxHEIGHT"), (dict(size=(10**6, 100)), "4096"),
    (dict(fps=1e9), "1 to 240"), (dict(fps=float("nan")), "1 to 240"),
])
def test_what_no_film_can_have(walk, tmp_path, options, words):
  with pytest.raises(ValueError, match=re.escape(words)):
    video(walk, tmp_path / "a.gif", **options)
  with pytest.raises(ValueError, match="frames 0 to 29"):
    frame(walk, 30, SIZE)
  with pytest.raises(ValueError, match="a film is .mp4 or .gif"):
    video(walk, tmp_path / "a.avi")
  assert not any(tmp_path.iterdir())


def test_flags_of_render(walk, tmp_path, capsys):
  npz(walk, tmp_path / "a.npz")
  render = lambda *flags: cli.main(["render", str(tmp_path / "a.npz"), *flags])
  out = str(tmp_path / "a.gif")
  assert render("--out", out, "--size", "64x48", "--camera", "top", "--background", "black", "--film-fps", "10",
                "--trim", "0.5s:1s") == 0
  with Image.open(out) as film:
    assert film.size == (64, 48) and film.n_frames == 5
  (tmp_path / "a.gif").unlink()
  for flags, words in ((("--size", "big"), "WIDTHxHEIGHT"), (("--camera", "tpo"), "did you mean top?"),
                       (("--background", "nocolor"), "expected a colour"),
                       (("--trim", "3s:1s"), "A before B"), (("--trim", "1"), "expected A:B")):
    assert render("--out", out, *flags) == 1
    said = capsys.readouterr().err
    assert words in said and len(said.splitlines()) == 1
  with pytest.raises(SystemExit) as ended:
    render("--out", out, "--film-fps", "0")
  assert ended.value.code == 2 and "--film-fps: got '0', expected a number from 1 to 240" in capsys.readouterr().err
  assert not (tmp_path / "a.gif").exists()
  assert render("--out", str(tmp_path / "part.npz"), "--trim", "10:20") == 0  # of every kind of file
  with np.load(tmp_path / "part.npz", allow_pickle=False) as part:
    assert part["joints"].shape == (10, 22, 3)


def test_a_film_reports_its_frames(walk, tmp_path, monkeypatch):
  said = []
  monkeypatch.setattr(progress, "count", lambda *state: said.append(state))
  video(walk.cut(0, 8), tmp_path / "a.gif", SIZE)
  assert said[:4] == [(i, 4, "") for i in range(4)] and said[4:] == [(t, 8, "frame") for t in range(8)]


def _actions(parser):
  for action in parser._actions:
    if isinstance(action, argparse._SubParsersAction):
      yield from ((parser, choice) for choice in action._choices_actions)
      for sub in action.choices.values():
        yield from _actions(sub)
    else:
      yield parser, action


def test_every_argument_has_a_help_text():
  found = list(_actions(cli._parser()))
  assert len(found) > 100
  assert [f"{parser.prog}: {action.dest}" for parser, action in found if not action.help] == []
