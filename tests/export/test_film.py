"""How films look: cameras, sizes, backgrounds, rates, parts; by flags, each checked before anything is made."""
import contextlib
import re

import numpy as np
import pytest
from PIL import Image

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.export import frame, npz, video
from motion_jax.motion.retiming import resample
from motion_jax_studio import cli

SIZE = (96, 72)


@pytest.fixture(scope="module")
def walk():
  return synthetic_clips(0, 2, num_frames=30)[1]


def test_cameras_look_from_where_they_say(walk):
  views = {camera: frame(walk, 15, SIZE, camera=camera, path=False, caption="") for camera in
           ("front", "side", "top", "three-quarter", "auto")}
  assert (views["three-quarter"] == views["auto"]).all()  # of old
  images = list(views.values())[:4]
  assert all((a != b).any() for i, a in enumerate(images) for b in images[:i])
  top, front = (np.ptp(np.argwhere(np.abs(views[camera][..., 0].astype(int) - views[camera][..., 2]) > 45)[:, 0])
                for camera in ("top", "front"))  # rows of orange or blue limbs
  assert top < 0.7 * front  # from above a standing body is short


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


def test_frames_between_are_interpolated_smoothly():
  """Of a wave of ten frames, as fast as limbs go at 20 a second; straight lines between are 0.05 off."""
  waves = [np.sin(np.arange(count) / step * 2 * np.pi / 10) for count, step in ((20, 1), (58, 3))]
  found = resample(waves[0][:, None, None], 20.0, 60.0, smooth=True)[:, 0, 0]
  assert np.abs(found - waves[1])[6:-6].max() < 0.01


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
  for flags, words in ((("--size", "big"), "WIDTHxHEIGHT"), (("--trim", "3s:1s"), "A before B")):
    with contextlib.suppress(SystemExit):
      assert render("--out", out, *flags) == 1
    said = capsys.readouterr().err
    assert words in said and len(said.splitlines()) == 1
  assert not (tmp_path / "a.gif").exists()
  assert render("--out", str(tmp_path / "part.npz"), "--trim", "10:20") == 0  # of every kind of file
  with np.load(tmp_path / "part.npz", allow_pickle=False) as part:
    assert part["joints"].shape == (10, 22, 3)
