"""What a motion was asked to do is seen in pictures: a path on the floor, balls, pale bodies; without it nothing is."""
import numpy as np
from PIL import Image

from motion_jax import export
from motion_jax.control.compiling import compile
from motion_jax.control.constraints import EffectorTarget, Keyframe, RootPath
from motion_jax.control.signal import none
from motion_jax.data.clip import Clip
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.export.scene import marks_of

GREEN, RED = (lambda p: (p[..., 1] > p[..., 0] + 30) & (p[..., 1] > p[..., 2] + 20)), (
    lambda p: (p[..., 0] > p[..., 1] + 90) & (p[..., 2] > p[..., 1] + 20))


def test_marks_of_each_kind():
  joints = synthetic_joints("walk", 41, np.random.default_rng(0)).astype(np.float64)
  asked = compile([RootPath([[0, 0], [0, 2]], [0, 1]), EffectorTarget("left_hand", [0.5], [[0.3, 1, 1]]),
                   Keyframe(joints[3], 1.5)], 41, 20.0, joints)
  marks = marks_of(asked, 0.0)
  assert len(marks.lines) == 1 and len(marks.lines[0][0]) == 21 and not marks.lines[0][0][:, 1].any()
  assert marks.of(figures=False) == [10] and marks.of(figures=True) == [30]
  assert marks_of(None, 0.0) == ([], []) == tuple(marks_of(none(1, 9), 0.0))


def test_pictures_and_films_show_what_was_asked(tmp_path):
  clip = Clip(synthetic_joints("walk", 41, np.random.default_rng(0)))
  asked = compile([RootPath([[0, 0], [0, 2.5]]), EffectorTarget("left_hand", [1], [[0.6, 1.5, 1]])], 41)
  seen = {}
  for name, signal in (("with", asked), ("without", None)):
    export.save(clip, tmp_path / f"{name}.png", control=signal, num=3, height=120)
    seen[name] = np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB")).astype(int)
  assert GREEN(seen["with"]).sum() > 50 and RED(seen["with"]).sum() > 5
  assert not GREEN(seen["without"]).any() and not RED(seen["without"]).any()
  film = export.frame(clip, 5, size=(160, 120), control=asked).astype(int)
  assert GREEN(film).sum() > 20 and RED(film).sum() > 2
  two = export.save([clip, clip], tmp_path / "two.png", control=[asked, asked], num=3, height=120)
  assert np.asarray(Image.open(two[0])).shape[0] == 2 * seen["with"].shape[0]
