"""GIF films: the pictures come back with their times, and memory holds one of them at a time."""
import weakref

import numpy as np
from PIL import Image

from motion_jax.export import gif


def pictures(num, size=(30, 40)):
  """A square that walks over a shaded ground, and stands still in between."""
  ground = np.zeros((*size, 3), np.uint8)
  ground[..., 1] = np.linspace(60, 220, size[1]).astype(np.uint8)
  for t in range(num):
    image = ground.copy()
    image[8:16, t // 2 % 30:t // 2 % 30 + 8] = (250, 40, 40)
    yield image


def test_pictures_come_back(tmp_path):
  images = list(pictures(9))
  palette = gif.common_palette(images[::4])
  gif.write(tmp_path / "a.gif", iter(images), 30, palette, tolerance=0)
  with Image.open(tmp_path / "a.gif") as film:
    assert (film.n_frames, film.size, film.info["loop"]) == (9, (40, 30), 0)
    durations = []
    for t, image in enumerate(images):
      film.seek(t)
      expected = Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE).convert("RGB")
      np.testing.assert_array_equal(np.asarray(film.convert("RGB")), np.asarray(expected))
      durations.append(film.info["duration"])
  assert sum(durations) == 300 and set(durations) == {30, 40}  # 9 frames at 30 a second


def test_what_hardly_changes_is_not_written_again(tmp_path):
  rng = np.random.default_rng(0)
  noisy = [np.uint8(image + rng.integers(0, 5, image.shape)) for image in pictures(20, (90, 120))]
  palette = gif.common_palette(noisy[::6])
  sizes = []
  for name, tolerance in (("exact", 0), ("near", 8)):
    gif.write(tmp_path / name, iter(noisy), 20, palette, tolerance)
    sizes.append((tmp_path / name).stat().st_size)
  assert sizes[1] < sizes[0] / 3
  with Image.open(tmp_path / "near") as film:
    film.seek(19)
    shown = np.asarray(film.convert("RGB")).astype(int)
  exact = np.asarray(Image.fromarray(noisy[19]).quantize(palette=palette, dither=Image.Dither.NONE).convert("RGB"))
  allowed = np.maximum(np.abs(exact.astype(int) - noisy[19]).max(-1), 8)
  assert (np.abs(shown - noisy[19]).max(-1) <= allowed).all()


def test_a_long_film_holds_few_pictures(tmp_path):
  alive, most = set(), 0

  def watched():
    nonlocal most
    for number, image in enumerate(pictures(60)):
      alive.add(number)
      weakref.finalize(image, alive.discard, number)
      most = max(most, len(alive))
      yield image

  gif.write(tmp_path / "a.gif", watched(), 20, gif.common_palette(list(pictures(2))))
  assert most <= 3
