"""Robots' tables and side-cars of other programs, and motions that face any way."""
import errno
import json
import os
import pathlib
import re
import shlex

import numpy as np
import pytest

from motion_jax import robots
from motion_jax.data.clip import Clip
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion import rotations as rot
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from tests.robots.test_robots import humanoid, mapping


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
  path = tmp_path_factory.mktemp("robot") / "small.xml"
  path.write_text(humanoid())
  return robots.load(path, mapping())


def standing(robot, count=4, turn=(1.0, 0, 0, 0), height=None):
  qpos = np.tile(robot.standing(), (count, 1))
  qpos[:, 3:7] = rot.multiply(np.array(turn)[None], qpos[:, 3:7])
  if height is not None:
    qpos[:, 2] = height
  return qpos


def write_table(path, robot, qpos, order="wxyz", separator=","):
  rows = qpos.copy()
  rows[:, 3:7] = qpos[:, 3:7] if order == "wxyz" else np.roll(qpos[:, 3:7], -1, axis=1)
  np.savetxt(path, rows, delimiter=separator, fmt="%.6f")
  return path


@pytest.mark.parametrize("separator", [",", ";", " ", "\t"])
def test_a_table_of_any_separator_is_read(separator, robot, tmp_path):
  qpos = standing(robot)
  path = write_table(tmp_path / "a.csv", robot, qpos, separator=separator)
  np.testing.assert_allclose(robots.read_csv(path, robot, "wxyz", 30).qpos, qpos, atol=1e-5)


def test_an_order_that_puts_the_body_into_the_floor_is_none(robot, tmp_path):
  """On its side, 0.12 m high: (x, y, z, w) read as (w, x, y, z) would be upright, with its legs in the ground."""
  half = np.sqrt(0.5)
  qpos = standing(robot, turn=(half, half, 0, 0), height=0.12)
  path = write_table(tmp_path / "a.csv", robot, qpos, "xyzw")
  assert robots.read_csv(path, robot, None, 30).meta["quaternion_order"] == "xyzw"


@pytest.mark.parametrize("order, turn", [("wxyz", (0.0, 0, 1, 0)), ("xyzw", (0.0, 1, 0, 0))])
def test_a_robot_upside_down_is_read_right_or_gets_one_note(order, turn, robot, tmp_path):
  """Facing back, it is upright in the other order: with its legs in the floor, off the floor, or standing as well."""
  def read(height, arms=0.0, **options):
    qpos = standing(robot, turn=turn, height=height)
    qpos[:, [7 + j for j, name in enumerate(robot.joints) if "shoulder_y" in name]] = arms
    read = robots.read_csv(write_table(tmp_path / "a.csv", robot, qpos, order), robot, *options.values(), fps=30)
    assert read.meta["quaternion_order"] == order
  read(0.5)
  for height, arms in ((0.62, 0.0), (1.1, np.pi)):
    with pytest.raises(InputError, match="the lowest joint at .*--quaternion"):
      read(height, arms)
    read(height, arms, quaternion=order)
  with pytest.warns(UserWarning, match="--quaternion (wxyz|xyzw) reads it upside down"), pytest.raises(AssertionError):
    read(0.95, np.pi)


@pytest.mark.parametrize("owner, name", [(pathlib.Path, "write_text"), (np, "savetxt")])
def test_a_full_disk_leaves_neither_the_table_nor_its_side_car(owner, name, robot, tmp_path, monkeypatch):
  def full(*given, **options):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
  monkeypatch.setattr(owner, name, full)
  with pytest.raises(OSError, match="No space left"):
    robots.write(robots.RobotMotion(robot, standing(robot), 30.0), tmp_path / "a", "unitree_xyzw")
  assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("format", ["gmr", "mujoco", "loco_mujoco", "mjlab", "beyondmimic"])
def test_every_npz_that_is_written_is_read_back(format, tmp_path):
  """Also without the .json beside it, which states the order of joints."""
  (tmp_path / "small.xml").write_text(humanoid())
  about = {"bodies": mapping()}
  robot = robots.load(tmp_path / "small.xml", about)
  about["orders"] = {"isaaclab": [*robot.joints[1::2], *robot.joints[::2]]}
  robot = robots.load(tmp_path / "small.xml", about)
  qpos = standing(robot, 6)
  qpos[:, 7:] += np.random.default_rng(0).uniform(-0.2, 0.2, qpos[:, 7:].shape)
  motion = robots.RobotMotion(robot, qpos, 50.0)
  path, side_car = robots.write(motion, tmp_path / "a", format)
  side_car.unlink()
  assert robots.is_robots(path)
  read = robots.read_npz(path, robot)
  assert read.fps == 50
  np.testing.assert_allclose(read.qpos, qpos, atol=1e-5)


def test_an_npz_of_another_robot_is_one_sentence(robot, tmp_path):
  np.savez(tmp_path / "c.npz", qpos=standing(robot), joint_names=[*robot.joints, *robot.joints], fps=np.float64(50))
  with pytest.raises(InputError, match="c.npz: its joints are"):
    robots.read_npz(tmp_path / "c.npz", robot)
  np.savez(tmp_path / "a.npz", qpos=np.zeros((3, 12)), fps=np.float64(50))
  with pytest.raises(InputError, match=r"a.npz: qpos has the shape \(3, 12\), expected \(frames, "):
    robots.read_npz(tmp_path / "a.npz", robot)
  np.savez(tmp_path / "b.npz", joints=np.zeros((3, 22, 3)))
  assert not robots.is_robots(tmp_path / "b.npz")


@pytest.mark.parametrize("about, named", [({"fps": [30]}, "fps"), ({"fps": "30"}, "fps"), ({"fps": 1e9}, "fps"),
                                          ({"quaternion_order": 4}, "quaternion_order"), ({"licence": 3}, "licence")])
def test_a_side_car_of_wrong_types_is_one_sentence(about, named, robot, tmp_path):
  path = write_table(tmp_path / "a.csv", robot, standing(robot))
  path.with_suffix(".json").write_text(json.dumps({"quaternion_order": "wxyz"} | about))
  with pytest.raises(InputError, match=f"a.json: {named} is "):
    robots.read_csv(path, robot)


@pytest.mark.parametrize("wrong", [{"fixed": {"14": 5}}, {"orders": {"isaaclab": "waist"}}, {"fixed": {"a": [3]}}])
def test_a_description_of_wrong_types_is_one_sentence(wrong, tmp_path):
  (tmp_path / "small.xml").write_text(humanoid())
  with pytest.raises(InputError, match=f"{next(iter(wrong))} of the description gives .* expected a list of joints"):
    robots.load(tmp_path / "small.xml", {"bodies": mapping()} | wrong)


def test_what_is_printed_runs_in_any_folder_and_for_names_with_blanks(tmp_path, capsys):
  """Of a robot's table that shows no order of its quaternions; a stem without an ending becomes a .npz file."""
  g1 = robots.load("g1")
  path = write_table(tmp_path / "my walk.csv", g1, standing(g1), "xyzw", separator=" ")
  path.write_text(f"# made by hand\n{path.read_text()}")
  assert cli.main(["render", str(path)]) == 1
  command = shlex.split(re.search(r"motion-jax (retarget .*xyz) \(or", capsys.readouterr().err)[1])
  assert cli.main([*command, "--out", str(tmp_path / "on foot")]) == 0
  seen = re.search(r"see it: motion-jax (.*)", capsys.readouterr().out)[1]
  assert shlex.split(seen) == ["render", str(tmp_path / "on foot.npz")]
  assert cli.main([*shlex.split(seen), "--out", str(tmp_path / "b.bvh")]) == 0


@pytest.mark.slow
def test_which_way_a_person_faces_changes_nothing_but_the_root():
  """Half a turn from the robot's own heading, the joints of a G1 wound up to their limits and stayed there."""
  g1 = robots.load("g1")
  joints = synthetic_joints("walk", 3, np.random.default_rng(0))
  ahead, back = (robots.retarget(Clip(joints=rot.rotate(
      rot.about_axis(np.radians(degrees), "y")[None, None], joints).astype(np.float32), fps=20), g1).angles
      for degrees in (0, 180))
  assert np.abs(back - ahead).max() < 1e-4
