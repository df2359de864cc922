"""Files at other frame rates, and with a T-pose first."""
import numpy as np
import pytest

from motion_jax import export
from motion_jax.export.rates import at_rate, is_loop
from motion_jax.export.rig import on_rig
from motion_jax.motion.looping import looped
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_studio import cli
from tests.export.test_bvh import walk


@pytest.mark.parametrize("fps", [24, 25, 30, 50, 60, 120])
def test_another_rate_keeps_bones_and_comes_back(fps):
  clip = walk(47, 0.2).cut(0, 33)  # the whole would be a loop
  other = at_rate(clip, fps)
  assert other.num_frames == int(32 * fps / 20 + 1e-6) + 1 and other.fps == fps
  lengths = bone_lengths(clip.joints, HUMANML3D)
  off = np.abs(bone_lengths(other.joints, HUMANML3D) - lengths.mean(0)).max()
  assert off < np.abs(lengths - lengths.mean(0)).max() + 1e-4
  if fps % 20 == 0:
    np.testing.assert_allclose(other.joints[::fps // 20], clip.joints, atol=1e-5)
  assert np.abs(other.joints[0] - clip.joints[0]).max() < 1e-5


def test_a_loop_still_meets_its_beginning():
  clip = walk(40, 0.2)
  clip = clip.replace(joints=looped(clip.joints, clip.fps))
  assert is_loop(clip) and not is_loop(walk(47, 0.2).cut(0, 33))
  for fps in (24, 25, 30, 50, 60, 120):
    other = at_rate(clip, fps)
    assert is_loop(other) and abs((other.num_frames - 1) / fps - 39 / 20) < 0.5 / fps + 1e-9
    np.testing.assert_allclose(other.joints[-1], clip.joints[-1], atol=1e-5)


def test_the_command_line_writes_rates_and_a_t_pose(tmp_path):
  clip = walk(20, 0.2)
  export.save(clip, tmp_path / "walk.npz")
  assert not cli.main(["render", str(tmp_path / "walk.npz"), "--out-fps", "60", "--t-pose", "--out",
                       f"{tmp_path / 'a.npz'},{tmp_path / 'a.bvh'},{tmp_path / 'a.glb'}"])
  assert export.load(tmp_path / "a.npz").num_frames == 58
  for name in ("a.bvh", "a.glb"):
    with pytest.warns(UserWarning, match="frame 0 is a pose"):
      found = export.load(tmp_path / name)
    assert found.fps == 60 and found.num_frames == 58
  for rig in (None, "ue5"):
    moved = on_rig(clip, rig, t_pose=True)
    elbow, wrist = (moved.rig.joints[f"left_{joint}"] for joint in ("elbow", "wrist"))
    assert len(moved.root) == 21
    arm = [moved.turned[0, joint] for joint in (elbow, wrist)]
    np.testing.assert_allclose(np.abs(arm[0]), [1, 0, 0, 0] if rig is None else np.abs(arm[1]), atol=1e-12)
