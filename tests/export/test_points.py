"""Tables of joint positions: what is written is read back, and what is no motion is refused in one sentence."""
import ezc3d
import numpy as np
import pytest

from motion_jax import export
from motion_jax.motion.skeleton import HUMANML3D, KIT
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from tests.export.test_bvh import walk

KINDS = [".csv", ".trc", ".c3d"]


@pytest.mark.parametrize("skeleton, far", [(HUMANML3D, 2e-6), (KIT, 2e-3)])  # metres, millimetres
@pytest.mark.parametrize("kind", [*KINDS, ".npz"])
def test_joints_of_a_skeleton_are_read_back_in_their_places_and_unit(kind, skeleton, far, tmp_path):
  clip = walk(30, 0.2).on_skeleton(skeleton)
  export.save(clip, tmp_path / f"walk{kind}")
  found = export.load(tmp_path / f"walk{kind}")
  assert found.fps == pytest.approx(clip.fps) and found.skeleton is skeleton
  np.testing.assert_allclose(found.joints, clip.joints, atol=far)


def test_opensim_and_laboratories_face_along_x(tmp_path):
  """OpenSim: x ahead, y up, z to the right. C3D here: x ahead, y to the left, z up."""
  clip = walk(30, 0.2)
  ours = 1000 * clip.joints.astype(np.float64)
  export.save(clip, tmp_path / "walk.trc")
  export.save(clip, tmp_path / "walk.c3d")
  rows = [line.split("\t") for line in (tmp_path / "walk.trc").read_text().splitlines()[6:]]
  marker = np.array([[float(cell) for cell in row[2:5]] for row in rows])
  np.testing.assert_allclose(marker, np.stack([ours[:, 0, 2], ours[:, 0, 1], -ours[:, 0, 0]], axis=1), atol=1e-3)
  point = ezc3d.c3d(str(tmp_path / "walk.c3d"))["data"]["points"][:3, 0].T
  np.testing.assert_allclose(point, ours[:, 0, [2, 0, 1]], atol=1e-3)


def test_points_of_other_names_are_read_by_them_or_by_a_mapping(tmp_path):
  clip = walk(30, 0.2)
  export.save(clip, tmp_path / "walk.csv")
  text = (tmp_path / "walk.csv").read_text()
  for ours, theirs in zip(HUMANML3D.joints, (f"p{i}" for i in range(22))):
    text = text.replace(f",{ours}_", f",{theirs}_")
  (tmp_path / "own.csv").write_text(text)
  with pytest.raises(InputError, match="no skeleton that is known"):
    export.load(tmp_path / "own.csv")
  found = export.load(tmp_path / "own.csv", mapping={joint: f"p{i}" for i, joint in enumerate(HUMANML3D.joints)})
  np.testing.assert_allclose(found.joints, clip.joints, atol=1e-6)


def test_several_clips_and_the_command_line(tmp_path):
  export.save([walk(4), walk(5)], tmp_path / "walk.amass.npz")
  assert sorted(path.name for path in tmp_path.iterdir()) == ["walk_0.amass.npz", "walk_1.amass.npz"]
  export.npz(walk(6), tmp_path / "walk.npz")
  names = [f"{tmp_path}/again{kind}" for kind in (*KINDS, ".amass.npz", ".vrma", ".usda")]
  assert cli.main(["render", f"{tmp_path}/walk.npz", "--pelvis-offset", "0,-0.35,0.01", "--out", ",".join(names)]) == 0
  with np.load(names[3]) as file:
    assert file["pelvis_offset"].tolist() == [0, -0.35, 0.01]


@pytest.mark.parametrize("text, sentence", [
    ("", "header"), ("a,b\n1,2\n", "NAME_x"), ("1,2,3\n4,5,6\n", "Unitree"), ("time,hip_x,hip_y,hip_z\n", "no frames"),
    ("time,hip_x,hip_y,hip_z\n0,1,2\n", "row 2"), ("time,hip_x,hip_y,hip_z\n0,1,far,2\n", "row 2"),
    ("time,hip_x,hip_y,hip_z\n0,1,2,3\n0,1,2,3\n", "rise evenly")])
def test_a_table_that_is_no_motion_is_refused(text, sentence, tmp_path):
  (tmp_path / "a.csv").write_text(text)
  with pytest.raises(InputError, match=sentence):
    export.load(tmp_path / "a.csv")


def test_a_gap_is_named(tmp_path):
  clip = walk(6)
  clip.joints[3, HUMANML3D.joints.index("left_knee")] = np.nan
  export.save(clip, tmp_path / "walk.c3d")
  with pytest.raises(InputError, match="point left_knee of frame 4 is missing"):
    export.load(tmp_path / "walk.c3d")


@pytest.mark.parametrize("gap", ["", "nan"])
@pytest.mark.parametrize("kind", [".csv", ".trc"])
def test_points_that_no_joint_depends_on_may_have_gaps(kind, gap, tmp_path):
  path, = export.save(walk(6), tmp_path / f"a{kind}")
  mark, heads = ("\t", 3) if kind == ".trc" else (",", 0)
  lines = path.read_text().split("\n")
  for k in range(len(lines) - 1):
    if k == heads:
      lines[k] += "Wand\t\t" if heads else ",Wand_x,Wand_y,Wand_z"
    elif k >= (6 if heads else 1):
      lines[k] += mark.join(["", *([gap] * 3 if k % 3 else ["1", "2", "3"])])
  path.write_text("\n".join(lines))
  with pytest.warns(UserWarning, match="Wand have gaps, and no joint depends on them"):
    np.testing.assert_allclose(export.load(path).joints, walk(6).joints, atol=1e-3)
  cells = lines[-2].split(mark)
  column = 2 + 3 * HUMANML3D.joints.index("left_knee")
  path.write_text("\n".join([*lines[:-2], mark.join([*cells[:column], *[gap] * 3, *cells[column + 3:]]), ""]))
  with pytest.raises(InputError, match="point left_knee.* of frame 6 is missing"):
    export.load(path)


@pytest.mark.parametrize("kind", [".trc", ".c3d"])
def test_a_cut_file_is_refused(kind, tmp_path):
  export.save(walk(30, 0.2), tmp_path / f"walk{kind}")
  data = (tmp_path / f"walk{kind}").read_bytes()
  for share in (0.02, 0.5):
    (tmp_path / f"cut{kind}").write_bytes(data[:int(share * len(data))])
    with pytest.raises(InputError, match="cut"):
      export.load(tmp_path / f"cut{kind}")
