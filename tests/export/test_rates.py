"""Files at other frame rates, and with a T-pose first."""
import numpy as np
import pytest

from motion_jax import export
from motion_jax.export.rates import at_rate
from motion_jax.export.rig import on_rig
from motion_jax.motion.looping import is_loop, looped
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax_studio import cli
from tests.export.test_bvh import walk
from tests.export.test_rigs import places_of


@pytest.mark.filterwarnings("ignore")  # AMASS' neutral adult
@pytest.mark.parametrize("ending", [".npz", ".bvh", ".glb", ".csv", ".trc", ".c3d", ".amass.npz"])
def test_every_file_states_the_rate_of_its_frames(ending, tmp_path):
  """A rate that no reader takes where a file states none."""
  path, = export.save(walk(8).replace(fps=32.0), tmp_path / f"a{ending}")
  assert export.load(path).fps == 32 and export.load(path).num_frames == 8


def rewrite(path, rate):
  """The file with another rate in the place where it states one."""
  if path.suffix == ".trc":
    path.write_text(path.read_text().replace("\n32\t32\t", f"\n{rate}\t32\t"))
  elif path.suffix == ".csv":
    head, *rows = (line.split(",") for line in path.read_text().splitlines())
    times = [head] + [[row[0], f"{k / rate:.9f}", *row[2:]] for k, row in enumerate(rows)]
    path.write_text("\n".join(map(",".join, times)))
  else:
    with np.load(path) as file:
      np.savez(path, **{key: np.float64(rate) if key in ("fps", "mocap_framerate", "mocap_frame_rate") else file[key]
                        for key in file.files})


@pytest.mark.parametrize("ending, rates", [(".trc", ("0", "-32", "1e9", "0.5")), (".csv", (2000, 0.5)),
                                           (".npz", (0, -32, np.nan, 1e9)), (".amass.npz", (0, -32, np.nan, 0.5))])
@pytest.mark.filterwarnings("ignore")
def test_a_rate_that_no_motion_has_is_refused(ending, rates, tmp_path):
  """It is not replaced by another one either, or a motion would run at a wrong speed; fps= gives the right one."""
  for rate in rates:
    path, = export.save(walk(8).replace(fps=32.0), tmp_path / f"a{ending}")
    rewrite(path, rate)
    with pytest.raises(ValueError, match=r"frames (per|a) second"):
      export.load(path)
  for fps in (0, -3, 1001, np.nan):
    with pytest.raises(ValueError, match="frames per second, expected 1 to 1000"):
      export.load(path, fps=fps)
    with pytest.raises(ValueError, match="frames per second, expected 1 to 1000"):
      at_rate(walk(8), fps)


def test_without_a_rate_it_is_read_off_the_times(tmp_path):
  """By which 5 % of a frame may be rounded away, and no more."""
  path, = export.save(walk(8).replace(fps=32.0), tmp_path / "a.trc")
  rewrite(path, "unknown")
  assert export.load(path).fps == 32
  lines = path.read_text().splitlines()
  for shift, even in ((0.04, True), (0.06, False)):
    cells = lines[-2].split("\t")
    cells[1] = f"{(6 + shift) / 32:.6f}"
    path.write_text("\n".join([*lines[:-2], "\t".join(cells), lines[-1]]))
    if even:
      assert export.load(path).fps == 32
    else:
      with pytest.raises(ValueError, match="times do not rise evenly"):
        export.load(path)


@pytest.mark.parametrize("fps", [24, 30, 60])
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
  assert is_loop(clip.joints) and not is_loop(walk(47, 0.2).cut(0, 33).joints)
  for fps in (24, 25, 60):
    other = at_rate(clip, fps)
    assert is_loop(other.joints) and abs((other.num_frames - 1) / fps - 39 / 20) < 0.5 / fps + 1e-9
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
    feet = places_of(moved)[:, [moved.rig.joints[f"{side}_foot"] for side in ("left", "right")], 1].min(1)
    assert feet[0] == pytest.approx(np.percentile(feet[1:], 10), abs=0.02), "it stands where the motion does"
    arm = [moved.turned[0, joint] for joint in (elbow, wrist)]
    np.testing.assert_allclose(np.abs(arm[0]), [1, 0, 0, 0] if rig is None else np.abs(arm[1]), atol=1e-12)
