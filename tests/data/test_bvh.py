"""BVH files: forward kinematics against scipy's rotations, odd but legal files, and damaged ones."""
import pathlib
import time

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.data.mocap.asf import amc_clip
from motion_jax.data.mocap.bvh import bvh_clip, read_bvh
from motion_jax.data.mocap.files import read_mapping
from motion_jax.utils.errors import InputError
from tests.data.bvh_files import bvh_text, write_bvh

TWO = """HIERARCHY
ROOT a
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT b { OFFSET 0 10 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT c
    {
      OFFSET 0 5 1
      CHANNELS 4 Yposition Yrotation Xrotation Zrotation
      End Site
      {
        OFFSET 2 0 0
      }
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333333
1 2 3 10 20 30 40 50 60 7 70 80 90
-1 0 4 -15 25 35 -45 55 65 8 -75 85 95
"""


def test_any_channel_order(tmp_path):
  """Rotations multiply in the order of the channels; a position channel takes the place of that axis of OFFSET."""
  (tmp_path / "two.bvh").write_text(TWO)
  file = read_bvh(tmp_path / "two.bvh")
  assert file.names == ("a", "b", "c", "c_end") and file.parents == (-1, 0, 1, 2) and file.fps == 30
  for frame, v in enumerate(np.array([[float(w) for w in line.split()] for line in TWO.splitlines()[-2:]])):
    a, b, c = (Rotation.from_euler(order, v[part], degrees=True)
               for order, part in (("ZYX", slice(3, 6)), ("ZXY", slice(6, 9)), ("YXZ", slice(10, 13))))
    at_b = v[:3] + a.apply([0, 10, 0])
    at_c = at_b + (a * b).apply([0, v[9], 1])
    end = at_c + (a * b * c).apply([2, 0, 0])
    np.testing.assert_allclose(file.positions[frame], [v[:3], at_b, at_c, end], atol=1e-12)
    quaternion = np.roll(b.as_quat(), 1)
    np.testing.assert_allclose(file.rotations[frame, 1] * np.sign(file.rotations[frame, 1, 0]),
                               quaternion * np.sign(quaternion[0]), atol=1e-12)


def test_positions_of_zero_leave_a_joint_at_its_offset_and_not_the_root(tmp_path):
  """As MakeHuman writes poses; at 29.97 frames a second, which are not 30."""
  place = "Xposition Yposition Zposition"
  (tmp_path / "a.bvh").write_text(bvh_text("ab", (-1, 0), [(100, 0, 0), (0, 10, 0)], [place] * 2,
                                           [np.full((2, 3), 0.5), np.zeros((2, 3))], 1.001 / 30))
  file = read_bvh(tmp_path / "a.bvh")
  np.testing.assert_allclose(file.positions[:, :2], [[[0.5, 0.5, 0.5], [0.5, 10.5, 0.5]]] * 2)
  assert file.fps == pytest.approx(29.97, abs=1e-3)


def test_clip_is_resampled_in_metres(tmp_path):
  """30 to 20 frames a second, centimetres: every second result is every third frame."""
  joints = synthetic_joints("walk", 61, np.random.default_rng(0))
  clip = bvh_clip(write_bvh(tmp_path / "walk.bvh", joints), captions=(), split="train")
  assert clip.fps == 20 and clip.num_frames == 41 and clip.id == "walk" and clip.split == "train"
  assert clip.meta["mapping"] == "humanml3d" and clip.meta["unit"] == 0.01
  np.testing.assert_allclose(clip.joints[::2], joints[::3], atol=1e-6)
  np.testing.assert_allclose(clip.joints[1::2], (joints[1:-1:3] + joints[2::3]) / 2, atol=1e-6)


@pytest.mark.parametrize("name", ["09_01.bvh", "02_01.amc"])
def test_cmu_files_become_the_archive_s_clips(name):
  """The first quarter of a second of CMU's clips, without the T-pose before it, against the joints of our archive."""
  folder = pathlib.Path(__file__).parent.parent / "fixtures" / "data"
  clip = (amc_clip if name.endswith("amc") else bvh_clip)(folder / name)
  expected = np.load(folder / "cmu_joints.npz", allow_pickle=False)[name]
  assert clip.joints.shape == expected.shape
  assert np.linalg.norm(clip.joints - expected, axis=-1).max() < 5e-4  # the archive rounds to half a millimetre


@pytest.mark.parametrize("change, message", [
    (lambda t: t[:t.index("MOTION")], "ends before MOTION"),
    (lambda t: t.replace("Frames: 2", "Frames: 3"), "after 2 of 3 frames; it is cut"),
    (lambda t: t[:t.rindex(" ")] + "\n", "line 23: got 12 numbers, expected 13"),
    (lambda t: t.replace(" 80 90", " nan 90"), "line 22: number 12 is NaN"),
    (lambda t: t.replace(" 80 90", " x 90"), "line 22: .* not all numbers"),
    (lambda t: t.replace("Frame Time: 0.0333333", "Frame Time: 0"), "line 21: .* expected 0.001 to 1"),
    (lambda t: t.replace("3 Zrotation", "3 Qrotation"), "line 7: .*Qrotation"),
    (lambda t: t.replace("OFFSET 2 0 0", "OFFSET 2 0"), "line 14: got 2 numbers"),
])
def test_damaged_files(tmp_path, change, message):
  (tmp_path / "bad.bvh").write_text(change(TWO))
  with pytest.raises(ValueError, match=message):
    read_bvh(tmp_path / "bad.bvh")


def test_a_missing_file(tmp_path):
  with pytest.raises(FileNotFoundError, match="none.bvh"):
    read_bvh(tmp_path / "none.bvh")


@pytest.mark.parametrize("text, words", [
    ('{"left_hip": "left_hip", "right_wrist": [["right_wrist"]]}', "right_wrist should be a joint's name or a list"),
    ('{"head": 5}', "head should be"), ('{"head": []}', "head should be"), ('{"head": {"neck": 1}}', "head should be"),
    ('{"head": "a", "head": "b"}', "names head twice"), ("[]", "expected an object"), ("{", "no valid JSON")])
def test_a_mapping_of_wrong_types_is_one_line(tmp_path, text, words):
  (tmp_path / "m.json").write_text(text)
  with pytest.raises(InputError, match=r"m\.json.*" + words):
    read_mapping(tmp_path / "m.json")


def test_thousands_of_joints_take_linear_time(tmp_path):
  """On one line, too: each joint's name ends where its brace opens."""
  joint = "{ OFFSET 0 0.1 0 CHANNELS 3 Zrotation Xrotation Yrotation "
  end, count = "End Site { OFFSET 0 1 0 } }", 3000
  hierarchy = f"ROOT a {joint}" + "".join(f"JOINT b {i} {joint}{end}" for i in range(1, count)) + end
  (tmp_path / "a.bvh").write_text(f"HIERARCHY {hierarchy}\nMOTION\nFrames: 1\nFrame Time: 0.05\n{'0 ' * 3 * count}")
  start = time.process_time()
  capture = read_bvh(tmp_path / "a.bvh")
  assert time.process_time() - start < 2.5  # 5 where each joint looks at the rest of the line
  assert capture.names[-3] == f"b {count - 1}" and capture.positions.shape == (1, 2 * count, 3)


def test_an_end_site_has_no_joints(tmp_path):
  (tmp_path / "a.bvh").write_text("HIERARCHY ROOT a { OFFSET 0 0 0 End Site { OFFSET 0 1 0 End Site { OFFSET 0 1 0")
  with pytest.raises(InputError, match="'Site' is inside an End Site"):
    read_bvh(tmp_path / "a.bvh")
