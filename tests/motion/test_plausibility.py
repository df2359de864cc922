"""Whether joints could be a person's: their unit is told by their bones, what is no body is refused in one line."""
import warnings

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.datasets import humanml3d
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.export import bvh
from motion_jax.models.shared.known_motion import on_our_body
from motion_jax.motion import plausibility
from motion_jax.motion.pose import to_pose
from motion_jax.motion.skeleton import HUMANML3D


@pytest.fixture(scope="module")
def joints():
  return synthetic_clips(num=2, num_frames=24)[1].joints.astype(np.float64)


@pytest.mark.parametrize("unit, name, metres, size", [
    ("cm", "centimetres", 0.01, 0.8), ("mm", "millimetres", 0.001, 1.15), ("in", "inches", 0.0254, 0.8),
    ("ft", "feet", 0.3048, 1.15)])
def test_bones_show_the_unit(joints, tmp_path, unit, name, metres, size):
  np.save(tmp_path / "a.npy", joints * size / metres)
  with pytest.warns(UserWarning, match=f"a.npy: by its bones it is in {name}"):
    told = export.load(tmp_path / "a.npy")
  np.testing.assert_allclose(told.joints, joints * size, atol=1e-5)
  with warnings.catch_warnings():
    warnings.simplefilter("error")
    said = export.load(tmp_path / "a.npy", unit=unit)
  np.testing.assert_allclose(said.joints, joints * size, atol=1e-5)


@pytest.mark.parametrize("size", [0.4, 1.0, 1.6])
def test_metres_stay_to_the_bit(joints, tmp_path, size):
  np.save(tmp_path / "a.npy", (joints * size).astype(np.float32))
  with warnings.catch_warnings():
    warnings.simplefilter("error")
    np.testing.assert_array_equal(export.load(tmp_path / "a.npy").joints, (joints * size).astype(np.float32))


def test_z_up(joints, tmp_path):
  np.save(tmp_path / "z.npy", joints[..., [2, 0, 1]])
  with pytest.warns(UserWarning, match="--up z"):
    export.load(tmp_path / "z.npy")
  np.testing.assert_allclose(export.load(tmp_path / "z.npy", up="z").joints, joints, atol=1e-6)
  bvh(synthetic_clips(num=2, num_frames=24)[1], tmp_path / "a.bvh")
  with pytest.raises(ValueError, match="a.bvh: bones are 100 times .* in centimetres"):
    export.load(tmp_path / "a.bvh", unit="m")


def _at(joints, where, value):
  changed = joints.copy()
  changed[where] = value
  return changed


@pytest.mark.parametrize("damage, message", [
    (lambda j: _at(j, (7, 7), (0, 0, 3e4)), "frame 7: left_ankle is 30 km from left_knee"),
    (lambda j: _at(j, (slice(None), 7), (0, 0, 3e4)), "frame 0: left_ankle is 30 km"),
    (lambda j: j * 0.0117, "bones are 0.01.* times as long as a person's; no usual unit"),
    (lambda j: j * 1e300, "24 of 24 frames hold NaN or infinity"),
    (lambda j: j + 1e6, "1,000 km from the origin"),
    (lambda j: _at(j, slice(9, None), j[9:] + 40), "frame 9: pelvis has moved 69.* m since"),
    (lambda j: j[:, np.random.default_rng(0).permutation(22)], "bones fit no person's: joints in another order"),
])
def test_what_is_no_person(joints, tmp_path, damage, message):
  np.save(tmp_path / "bad.npy", damage(joints))
  with pytest.raises(ValueError, match=message) as error:
    export.load(tmp_path / "bad.npy")
  assert str(tmp_path / "bad.npy") in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("fps", [np.inf, np.nan, 0, -1, 1e-310, 1e9])
def test_rates_that_no_camera_has(joints, tmp_path, fps):
  np.savez(tmp_path / "a.npz", joints=joints, fps=fps)
  with pytest.raises(ValueError, match="frames per second, expected 1 to 1000"):
    export.load(tmp_path / "a.npz")
  with pytest.raises(ValueError, match="frames per second, expected 1 to 1000"):
    export.load(tmp_path / "a.npz", fps=fps)


@pytest.mark.parametrize("step, fps, jumps, moves", [
    (1.2, 20, True, False), (1.2, 15, False, False), (0.9, 100, False, False),  # over 1 m and 20 m/s
    (3.2, 60, True, True), (3.2, 40, True, False), (2.8, 100, True, False)])  # over 3 m and 150 m/s
def test_a_jump_is_far_and_fast(joints, step, fps, jumps, moves):
  """One of the two alone is a low rate or a quick body; far more of both is no body."""
  moved = _at(joints, slice(9, None), joints[9:] + (step, 0, 0))
  fault = plausibility.fault(moved, HUMANML3D, fps)
  assert ("frame 9: pelvis has moved" in fault) == moves and bool(fault) == moves
  if not moves:
    with warnings.catch_warnings(record=True) as told:
      warnings.simplefilter("always")
      plausibility.check(moved, HUMANML3D, fps)
    assert ["jump over 1 m in 1 frame(s), the first is frame 9" in str(one.message) for one in told] == [True] * jumps


def test_a_bone_that_changes_its_length_is_named(joints):
  for factor, told in ((2.6, "the bone to left_wrist changes its length by 0.4"), (2.0, None)):
    stretched = joints.copy()
    stretched[12:, 20] = stretched[12:, 18] + (stretched[12:, 20] - stretched[12:, 18]) * factor
    with pytest.warns(UserWarning, match=told) if told else warnings.catch_warnings():
      if not told:
        warnings.simplefilter("error")
      plausibility.check(stretched, HUMANML3D, 20.0)


def test_doors_of_python_ask_too(tmp_path):
  """What is made in memory comes in by no file: models that go on from a clip, figures, folders of features."""
  clips = synthetic_clips(num=3, num_frames=48)
  big = clips[1].replace(joints=clips[1].joints * 100)
  with pytest.raises(ValueError, match="clip '.*': bones are 100 times .* in centimetres"):
    on_our_body(big, 20.0, HUMANML3D)
  with pytest.raises(ValueError, match="the bone to left_ankle is 4.* m long, expected at most 1.5 m to draw"):
    export.save(big, tmp_path / "a.html")
  humanml3d.write_folder(clips, tmp_path / "data", mirror=False)
  path = tmp_path / "data" / "new_joints" / f"{clips[1].id}.npy"
  np.save(path, np.load(path) * 100)
  with pytest.warns(UserWarning, match=f"left out 1 with joints that are no person's .{clips[1].id}."):
    assert len(humanml3d.read_folder(tmp_path / "data")) == 2


def test_the_longest_motion_that_is_drawn(joints):
  with pytest.raises(ValueError, match="200,000 frames .*expected at most 100,000"):
    to_pose(np.broadcast_to(joints[:1], (200_000, 22, 3)))
