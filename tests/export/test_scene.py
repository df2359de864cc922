"""What a motion was asked to do is seen in pictures: a path on the floor, balls, pale bodies; without it nothing is."""
import numpy as np
import pytest
from PIL import Image

from motion_jax import export
from motion_jax.control.compiling import compile
from motion_jax.control.constraints import EffectorTarget, Keyframe, RootPath
from motion_jax.export.scene import marks_of
from tests.export.test_html import make

GREEN, RED = (lambda p: (p[..., 1] > p[..., 0] + 30) & (p[..., 1] > p[..., 2] + 20)), (
    lambda p: (p[..., 0] > p[..., 1] + 90) & (p[..., 2] > p[..., 1] + 20))


@pytest.mark.slow
def test_pictures_and_films_show_what_was_asked(tmp_path):
  clip = make("walk", 41)
  asked = compile([RootPath([[0, 0], [0, 2.5]]), EffectorTarget("left_hand", [1], [[0.6, 1.5, 1]]),
                   Keyframe(clip.joints[3].astype(np.float64), 1.5)], 41, 20.0, clip.joints.astype(np.float64))
  marks = marks_of(asked, 0.0)
  assert marks.of(figures=False) == [20] and marks.of(figures=True) == [30]
  path, = export.save([clip, clip], tmp_path / "two.png", control=[asked, None], num=3, height=120)
  shown, plain = np.split(np.asarray(Image.open(path).convert("RGB")).astype(int), [-120])  # one above the other
  assert len(shown) >= 120 and GREEN(shown).sum() > 50 and RED(shown).sum() > 5
  assert not GREEN(plain).any() and not RED(plain).any()
  film = export.frame(clip, 5, size=(160, 120), control=asked).astype(int)
  assert GREEN(film).sum() > 20 and RED(film).sum() > 2
