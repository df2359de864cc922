"""ASF/AMC files: bones turn about their own axes, R = C M C^-1, against scipy's rotations; damaged files."""
import pathlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion_jax.data.mocap.asf import amc_clip, read_amc

ASF = """:version 1.10
:units
  length 0.45
  angle deg
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 0 0
  orientation 0 0 0
:bonedata
""" + "".join(f"  begin\n    name {name}\n    direction {way}\n    length {length}\n    axis {axis} XYZ\n{dof}  end\n"
              for name, way, length, axis, dof in (
                  ("arm", "0 1 0", 2, "10 20 30", "    dof rx ry rz\n    limits (-1 1)\n"),
                  ("hand", "1 0 0", 3, "0 0 40", "    dof rx\n"), ("tip", "0 0 1", 1, "0 0 0", ""))) + """:hierarchy
  begin
    hand tip
    root arm
    arm hand
  end
"""
AMC = """#!procedural motion
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 10 20 30
arm 40 50 60
hand 70
2
root -1 2 3 -15 25 35
arm -45 55 65
hand -75
"""


@pytest.fixture
def folder(tmp_path):
  (tmp_path / "07.asf").write_text(ASF)
  (tmp_path / "07_01.amc").write_text(AMC)
  return tmp_path


def test_bones_turn_about_their_own_axes(folder):
  capture = read_amc(folder / "07_01.amc")
  assert capture.names == ("root", "arm", "hand", "tip") and capture.num_frames == 2 and capture.fps == 120
  euler = lambda *angles: Rotation.from_euler("xyz", angles, degrees=True)  # lower case: about fixed axes, x first
  metres = 0.0254 / 0.45
  for frame, (at, root, arm, hand) in enumerate((((1, 2, 3), (10, 20, 30), (40, 50, 60), 70),
                                                 ((-1, 2, 3), (-15, 25, 35), (-45, 55, 65), -75))):
    c1, c2 = euler(10, 20, 30), euler(0, 0, 40)
    turn = euler(*root)
    points = [np.array(at, float)]
    for bone, length in ((c1 * euler(*arm) * c1.inv(), (0, 2, 0)), (c2 * euler(hand, 0, 0) * c2.inv(), (3, 0, 0)),
                         (euler(0, 0, 0), (0, 0, 1))):
      turn = turn * bone
      points.append(points[-1] + turn.apply(length))
    np.testing.assert_allclose(capture.positions[frame], np.array(points) * metres, atol=1e-12)
    matrix = Rotation.from_quat(np.roll(capture.turned[frame, 3], -1)).as_matrix()
    np.testing.assert_allclose(matrix, turn.as_matrix(), atol=1e-12)


def test_the_unit_that_a_skeleton_states_is_reported():
  """CMU's files say that a unit is 1 / 0.45 inch; another one can be given."""
  path = pathlib.Path(__file__).parent.parent / "fixtures" / "data" / "02_01.amc"
  with pytest.warns(UserWarning, match="02_01.amc: by its skeleton file, 1 unit is 0.05644 m"):
    clip = amc_clip(path)
  assert clip.meta["unit"] == pytest.approx(0.0254 / 0.45)
  np.testing.assert_allclose(amc_clip(path, unit=2 * 0.0254 / 0.45).joints, 2 * clip.joints, atol=1e-5)
  assert amc_clip(path, source_fps=20.0, unit=0.0254 / 0.45).num_frames == read_amc(path).num_frames


@pytest.mark.parametrize("name, change, message", [
    ("07_01.amc", lambda t: t[:t.rindex("hand")], "frame 2 lacks hand; the file is cut"),
    ("07_01.amc", lambda t: t.replace("arm 40 50 60", "arm 40 50"), "line 6: got 2 numbers, expected 3"),
    ("07_01.amc", lambda t: t.replace("hand 70", "hand nan"), "line 7: NaN"),
    ("07_01.amc", lambda t: t.replace("hand 70", "foot 70"), "line 7: bone 'foot' is not in 07.asf"),
    ("07_01.amc", lambda t: "x" * 9000 + " 1 2 3\n", "line 1: got 'x{10,99}…', expected the number of a frame$"),
    ("07.asf", lambda t: t[:t.index(":hierarchy")], "no hierarchy"),
    ("07.asf", lambda t: t.replace("    length 2\n", ""), "line 17: a bone ends without its length"),
    ("07.asf", lambda t: t.replace("    arm hand\n", ""), "no parent that exists to hand"),
    ("07.asf", lambda t: t.replace("dof rx ry rz", "dof rx ry qq"), "line 16: got the channels"),
])
def test_damaged_files(folder, name, change, message):
  path = folder / name
  path.write_text(change(path.read_text()))
  with pytest.raises(ValueError, match=message):
    read_amc(folder / "07_01.amc")


def test_missing_skeleton(tmp_path):
  (tmp_path / "08_01.amc").write_text(AMC)
  with pytest.raises(FileNotFoundError, match="08_01.asf or 08.asf"):
    read_amc(tmp_path / "08_01.amc")
