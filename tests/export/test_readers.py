"""Files of other programs are read right, or with one note that says what to do."""
import itertools
import re
import warnings

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.mocap.gltf import Document
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
from tests.export.test_bvh import walk

CLIP = walk(12)


def notes(path, **options):
  """(the clip of a file, the warnings of reading it)"""
  with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    clip = export.load(path, **options)
  return clip, [str(warning.message) for warning in caught]


def upright(clip):
  rise = np.median(clip.joints[:, 15] - clip.joints[:, 0], axis=0)
  return rise[1] > 3 * np.abs(rise[[0, 2]]).max()


@pytest.mark.parametrize("kind, turn, flag", [
    (".npy", [2, 0, 1], "z"), (".csv", [1, 2, 0], "x"), (".trc", [2, 0, 1], "z"), (".amass.npz", [0, 2, 1], "y")])
def test_a_body_that_lies_gets_a_note_with_the_flag_that_makes_it_stand(kind, turn, flag, tmp_path):
  path = export.save(CLIP.replace(joints=CLIP.joints[..., turn] * (1 if kind != ".amass.npz" else [1, 1, -1])),
                     tmp_path / f"a{kind}")[0]
  lying, said = notes(path)
  assert not upright(lying)
  up = re.search(r"--up(?: |=-)([xyz]) .up='(-?[xyz])'", " ".join(said))
  assert up and up[2].removeprefix("-") == up[1]
  standing, said = notes(path, up=up[2])
  assert upright(standing) and not any("--up" in text for text in said)
  upright_path = export.save(CLIP, tmp_path / f"b{kind}")[0]
  assert not any("--up" in text for text in notes(upright_path)[1])


def test_exchanged_sides_are_said(tmp_path):
  np.save(tmp_path / "left_handed.npy", CLIP.joints * [-1, 1, 1])
  assert any("left and right are exchanged" in text for text in notes(tmp_path / "left_handed.npy")[1])
  np.save(tmp_path / "right.npy", CLIP.joints)
  assert not notes(tmp_path / "right.npy")[1]


TABLE = [name for joint in HUMANML3D.joints for name in (f"{joint}_x", f"{joint}_y", f"{joint}_z")]


def write_table(path, head, separator=",", times=None):
  rows = CLIP.joints.reshape(len(CLIP.joints), -1)
  rows = rows if times is None else np.column_stack([times, rows])
  number = lambda value: f"{value:.6f}".replace(".", "," if separator == ";" else ".")
  path.write_text("\n".join(separator.join(cells) for cells in [head, *([*map(number, row)] for row in rows)]))
  return path


@pytest.mark.parametrize("title, step", [("time", 0.02), ("Time", 0.02), ("Time (s)", 0.02), ("t", 0.02),
                                         ("timestamp_ms", 20), ("time [ms]", 20), ("Time [msec]", 20),
                                         ("seconds", 0.02), ("time_us", 2e4), ("timestamp_ns", 2e7), ("elapsed", 0.02)])
def test_the_rate_of_a_table_is_that_of_its_times(title, step, tmp_path):
  path = write_table(tmp_path / "a.csv", [title, *TABLE], times=step * np.arange(CLIP.num_frames))
  clip, said = notes(path)
  assert clip.fps == 50 and not said


def test_a_table_without_a_rate_says_so(tmp_path):
  clip, said = notes(write_table(tmp_path / "a.csv", TABLE))
  assert clip.fps == 20 and len(said) == 1 and "--fps" in said[0]
  assert not notes(tmp_path / "a.csv", fps=30)[1]


@pytest.mark.parametrize("separator, spelt", [*itertools.product(",;\t", ("{0}.{1}", "{0}_{2}")), *itertools.product(
    ",", ("{0}{2}", "{0}[{1}]", "{0}_{1} (m)", "{0}_pos_{1}", "{0}.{2}position", '"{0}_{1}"', "{3}_{2}"))])
def test_tables_of_any_separator_and_spelling_are_read(separator, spelt, tmp_path):
  head = [spelt.format(name[:-2], name[-1], name[-1].upper(), name[:-2].upper()) for name in TABLE]
  path = write_table(tmp_path / "a.csv", ["time", *head], separator, np.arange(CLIP.num_frames) / 20)
  np.testing.assert_allclose(notes(path)[0].joints, CLIP.joints, atol=1e-5)


def test_poses_of_video_tools_are_amass_poses_with_y_up(tmp_path):
  path = export.save(CLIP, tmp_path / "a.amass.npz")[0]
  arrays = dict(np.load(path))
  (tmp_path / "names").mkdir()
  # GVHMR's and ROMP's names; y up is AMASS' z up turned about x.
  turn = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
  from motion_jax.motion import rotations as rot
  root = rot.to_vector(rot.multiply(rot.from_matrix(turn)[None], rot.from_vector(arrays["root_orient"])))
  offset = np.array([0.0, -0.22, 0.03])  # of the pelvis, which `trans` leaves out
  moved = (arrays["trans"] + offset) @ turn.T - offset
  np.savez(tmp_path / "gvhmr.npz", global_orient=root, body_pose=arrays["pose_body"], transl=moved)
  romp = dict(pose=np.concatenate([root, arrays["pose_body"], np.zeros((len(root), 6))], 1), trans=moved)
  np.savez(tmp_path / "romp.npz", **romp)
  matrices = [rot.to_matrix(rot.from_vector(part.reshape(len(root), -1, 3))) for part in (root, arrays["pose_body"])]
  np.savez(tmp_path / "matrices.npz", global_orient=matrices[0], body_pose=matrices[1], trans=moved)
  np.savez(tmp_path / "wham.npz", pose=romp["pose"] * 0.5, trans=moved * [1, -1, -1], pose_world=romp["pose"],
           trans_world=moved)
  for name in ("gvhmr", "romp", "matrices", "wham"):
    clip, said = notes(tmp_path / f"{name}.npz")
    assert clip.fps == 30 and any("--fps" in text for text in said) and upright(clip)
    bones = lambda joints: np.linalg.norm(joints[:, 1:] - joints[:, :1], axis=-1)
    np.testing.assert_allclose(bones(clip.joints), bones(export.load(path).joints), atol=1e-4)
    np.savez(tmp_path / f"{name}.npz", **np.load(tmp_path / f"{name}.npz"), fps=25.0)
    clip, said = notes(tmp_path / f"{name}.npz")
    assert clip.fps == 25 and not any("--fps" in text for text in said)
  np.savez(tmp_path / "bare.npz", poses=arrays["poses"], trans=arrays["trans"])
  with pytest.raises(InputError, match="states no rate .*--fps"):
    export.load(tmp_path / "bare.npz")
  assert notes(tmp_path / "bare.npz", fps=25)[0].fps == 25


def test_a_native_reader_that_crashes_is_one_sentence(tmp_path):
  """Parameters of a C3D file that lead outside of it end ezc3d with a signal."""
  path = export.save(CLIP, tmp_path / "a.c3d")[0]
  assert notes(path)[0].num_frames == CLIP.num_frames
  data = bytearray(path.read_bytes())
  for place in range(512, 1024):  # the section of parameters
    data[place] = 0x7F
  path.write_bytes(data)
  with pytest.raises(InputError, match="cannot be read as C3D|is cut or no C3D file"):
    export.load(path)


def test_a_vrma_is_read_back_by_its_bones_whatever_their_nodes_are_called(tmp_path):
  path = export.save(CLIP, tmp_path / "a.vrma")[0]
  np.testing.assert_allclose(export.load(path).joints, CLIP.joints, atol=0.03)  # on VRM's spine and shoulders
  document = Document(path)
  for number, node in enumerate(document.nodes):
    node["name"] = f"n{number}"
  document.write(tmp_path / "b.vrma")
  np.testing.assert_allclose(export.load(tmp_path / "b.vrma").joints, export.load(path).joints, atol=1e-6)


def test_files_that_are_only_written_say_so(tmp_path):
  pictures = {".mp4", ".gif", ".html", ".png", ".jpg"}
  assert {name for name in export.WRITERS if "." + name.rsplit(".", 1)[1] not in export.READERS} == pictures
  with pytest.raises(InputError, match="a.usdz.*unzip it"):
    export.load(tmp_path / "a.usdz")


def test_markers_without_a_tree_have_head_and_toes_by_name(tmp_path):
  """HALPE's points, as Pose2Sim names them, below a header as numpy.savetxt writes it."""
  names = {f"{side}_{joint}": f"{side[0].upper()}{theirs}" for side in ("left", "right") for joint, theirs in (
      ("hip", "Hip"), ("knee", "Knee"), ("ankle", "Ankle"), ("foot", "BigToe"), ("shoulder", "Shoulder"),
      ("elbow", "Elbow"), ("wrist", "Wrist"))} | {"neck": "Neck", "head": "Head"}
  index = [HUMANML3D.joints.index(joint) for joint in names]
  rows = CLIP.joints[:, index].reshape(CLIP.num_frames, -1)
  head = [f"{name}_{axis}" for name in names.values() for axis in "xyz"]
  np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=",".join(head))
  read = export.load(tmp_path / "a.csv", fps=20)
  np.testing.assert_allclose(read.joints[:, index], CLIP.joints[:, index], atol=1e-5)
