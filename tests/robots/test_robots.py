"""Robots: kinematics and orders equal other people's files; a motion is followed within the robot's limits."""
import dataclasses
import json

import numpy as np
import pytest

from motion_jax import export, robots
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion import rotations as rot
from motion_jax.robots import description
from motion_jax.robots.formats import body_arrays
from motion_jax.robots.retargeting import Solver
from motion_jax.robots.robot import from_robot_axes, to_robot_axes
from motion_jax.robots.targets import DELAY, targets_of
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from tests import fixtures
from tests.conftest import ROOT

# The order of joints in IsaacLab, by places in MuJoCo's, as BeyondMimic publishes it.
ISAACLAB = [0, 6, 12, 1, 7, 13, 2, 8, 14, 3, 9, 15, 22, 4, 10, 16, 23, 5, 11, 17, 24, 18, 25, 19, 26, 20, 27, 21, 28]
LIMB = """<body name="{s}_hip" pos="0 {y} -0.08"><joint name="{s}_hip_x" axis="1 0 0" range="-0.6 0.6"/>
  <joint name="{s}_hip_y" axis="0 1 0" range="-2 1"/><geom type="capsule" size="0.04" fromto="0 0 0 0 0 -0.35"/>
  <body name="{s}_knee" pos="0 0 -0.38"><joint name="{s}_knee" axis="0 1 0" range="0 2.4"/>
   <geom type="capsule" size="0.035" fromto="0 0 0 0 0 -0.35"/>
   <body name="{s}_ankle" pos="0 0 -0.38"><joint name="{s}_ankle" axis="0 1 0" range="-0.9 0.6"/>
    <geom type="box" pos="0.04 0 -0.03" size="0.1 0.04 0.02"/></body></body></body>"""
ARM = """<body name="{s}_shoulder" pos="0 {y} 0.3"><joint name="{s}_shoulder_y" axis="0 1 0" range="-3 3"/>
  <joint name="{s}_shoulder_x" axis="1 0 0" range="-2 2"/><geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.25"/>
  <body name="{s}_elbow" pos="0 0 -0.27"><joint name="{s}_elbow" axis="0 1 0" range="-2.3 0"/>
   <geom type="capsule" size="0.03" fromto="0 0 0 0 0 -0.22"/></body></body>"""


def humanoid(limb=LIMB, free='<freejoint name="root"/>'):
  """A small humanoid with 15 joints, as MJCF."""
  sides = "".join(limb.format(s=s, y=y) for s, y in (("left", 0.1), ("right", -0.1)))
  arms = "".join(ARM.format(s=s, y=y) for s, y in (("left", 0.18), ("right", -0.18)))
  return (f'<mujoco><compiler angle="radian"/><worldbody><body name="base" pos="0 0 0.9">{free}'
          f'<geom type="box" size="0.06 0.1 0.06"/>{sides}<body name="chest" pos="0 0 0.1">'
          f'<joint name="waist" axis="0 0 1" range="-1 1"/><geom type="box" pos="0 0 0.2" size="0.05 0.1 0.15"/>{arms}'
          "</body></body></worldbody></mujoco>")


def mapping():
  parts = {"pelvis": "base", "torso": "chest"}
  for s in ("left", "right"):
    parts |= {f"{s}_{part}": f"{s}_{part}" for part in ("hip", "knee", "ankle", "shoulder", "elbow")}
    parts[f"{s}_wrist"] = [f"{s}_elbow", [0, 0, -0.25]]
  return parts


@pytest.fixture(scope="module")
def g1():
  return robots.load("g1")


@pytest.fixture(scope="module")
def walk():
  clip = next(clip for clip in synthetic_clips(seed=0) if "walk" in clip.captions[0].text)
  return clip.cut(0, 26)


@pytest.fixture(scope="module")
def followed(g1, walk):
  return robots.retarget(walk, g1)


@pytest.fixture(scope="module")
def report(followed, walk):
  return robots.report(followed, walk)


def test_kinematics_and_orders_are_those_of_a_file_that_others_wrote(g1):
  file = fixtures.load("robots/g1_bodies.npz")
  qpos = np.concatenate([file["body_pos_w"][:, 0], file["body_quat_w"][:, 0], file["joint_pos"]], axis=1)
  found = body_arrays(robots.RobotMotion(g1, qpos.astype(float), float(file["fps"][0])))
  for key, bound in (("joint_pos", 0), ("body_pos_w", 1e-6), ("body_quat_w", 1e-6)):
    assert np.abs(found[key] - file[key]).max() <= bound
  inner = slice(1, -1)  # central differences have no neighbour at the ends
  np.testing.assert_allclose(found["joint_vel"][inner], file["joint_vel"][inner], atol=1e-4)
  np.testing.assert_allclose(found["body_ang_vel_w"][inner], file["body_ang_vel_w"][inner], atol=0.3)


@pytest.mark.parametrize("name, order", [("g1_xyzw.csv", "xyzw"), ("g1_wxyz.csv", "wxyz")])
def test_the_quaternion_order_of_a_csv_is_read_off_the_pelvis(g1, name, order):
  with pytest.warns(UserWarning, match="states no rate"):
    motion = robots.read_csv(fixtures.path(f"robots/{name}"), g1)
  assert motion.meta["quaternion_order"] == order
  up = rot.rotate(motion.qpos[:, 3:7], np.array([0.0, 0, 1])[None])
  assert up[:, 2].min() > 0.9


@pytest.mark.parametrize("damage, message", [
    (lambda rows: rows[:, :35], "got 35 numbers, expected 36"),
    (lambda rows: rows * [*[1] * 3, *[2] * 4, *[1] * 29], "expected a quaternion of length 1"),
    (lambda rows: rows * [*[1] * 7, *[57.3] * 29], "look like degrees"),
    (lambda rows: 0 * rows + [*[0] * 3, *[0.5] * 4, *[0] * 29], r"--quaternion wxyz .or xyzw.")])  # it lies
def test_a_damaged_csv_is_refused(g1, tmp_path, damage, message):
  rows = np.loadtxt(fixtures.path("robots/g1_wxyz.csv"), delimiter=",")
  np.savetxt(tmp_path / "bad.csv", damage(rows), delimiter=",")
  with pytest.raises(InputError, match=message):
    robots.read_csv(tmp_path / "bad.csv", g1, fps=30)


def test_the_robot_follows_within_its_limits(g1, followed, report):
  """Planted feet do not slide, and arms keep off the body."""
  import mujoco
  assert report.feet[0] < 10 and report.pelvis[0] < 40 and report.hands[0] < 60
  low, high = g1.ranges.T
  assert (followed.angles >= low - 1e-3).all() and (followed.angles <= high + 1e-3).all()
  assert report.largest_step <= 20 / 50 + 1e-6
  assert report.slide < 15 and report.in_floor < 3
  assert robots.report(dataclasses.replace(followed, targets=()), followed.human) == report  # its targets again
  data, distance = mujoco.MjData(g1.model), []
  arm, trunk = (g1.model.geom(name).id for name in ("left_wrist_yaw", "torso_1"))
  for row in followed.qpos[::5]:
    data.qpos[:] = row
    mujoco.mj_kinematics(g1.model, data)
    distance.append(mujoco.mj_geomDistance(g1.model, data, arm, trunk, 1.0, None))
  assert min(distance) > 0


@pytest.mark.slow
def test_a_foot_that_stands_stays_in_its_place(g1):
  joints = synthetic_clips(seed=1)[0].joints[:1]
  motion = robots.retarget(Clip(np.repeat(joints, 10, axis=0), captions=()), g1)
  places, _ = g1.kinematics(motion.qpos)
  assert motion.planted.any()
  for side in ("left", "right"):
    assert np.ptp(places[5:, g1.index(f"{side}_ankle")], axis=0).max() < 0.004


@pytest.mark.slow
def test_a_stream_gives_the_configurations_of_the_whole_clip_in_bounded_delay(g1, walk, followed):
  stream, made, pushed = robots.Stream(g1, walk.fps), [], 0
  for size in (1, 2, 7, 3, 1, 12):
    made.append(stream.push(walk.joints[pushed:pushed + size]))
    pushed += size
    assert sum(map(len, made)) / 50 >= pushed / walk.fps - DELAY - 1e-9
  np.testing.assert_array_equal(np.concatenate([*made, stream.finish()]), followed.qpos)


@pytest.mark.slow
def test_a_report_measures_slide_depth_and_steps(g1, walk, followed, report):
  """Of a motion 5 cm too low that glides to the left, with an elbow that snaps where the second prompt begins."""
  before, qpos, elbow = report, followed.qpos.copy(), g1.joints.index("left_elbow_joint")
  qpos[:, 1] += 0.2 * np.arange(len(qpos)) / 50
  qpos[:, 2] -= 0.05
  qpos[20:, 7 + elbow] += 0.5
  captions = tuple(Caption("walks", start, start + 0.5) for start in (0.0, 0.4, 0.9))
  report = robots.report(dataclasses.replace(followed, qpos=qpos, captions=captions), walk)
  assert report.in_floor - before.in_floor == pytest.approx(50, abs=0.1) and abs(report.slide - 200) < 30
  assert report.largest_step == report.seams[0] > 0.4 > report.seams[1] > 0 and report.step_joint == "left_elbow_joint"


def test_fixed_joints_do_not_move(g1, walk):
  robot = g1.with_joints(23)
  motion = robots.retarget(walk.cut(0, 10), robot)
  fixed = [robot.joints.index(name) for name in robot.fixed]
  assert len(robot.moving) == 23 and np.abs(motion.angles[:, fixed]).max() < 1e-5


@pytest.mark.parametrize("format", ["unitree_xyzw", "kimodo_wxyz"])
def test_a_csv_is_read_back_at_the_rate_of_its_side_car(g1, followed, tmp_path, format):
  path, about = robots.write(followed, tmp_path / "walk", format)
  assert path.name == f"walk.{format}.csv" and np.loadtxt(path, delimiter=",").shape[1] == 36
  stated = json.loads(about.read_text())
  assert stated["quaternion_order"] == format[-4:] and stated["fps"] == 30 and len(stated["joint_order"]) == 29
  back = robots.read_csv(path, g1)
  assert back.fps == 30 and abs(back.seconds - followed.seconds) < 1 / 30
  np.testing.assert_allclose(back.qpos[::3], followed.qpos[::5][:len(back.qpos[::3])], atol=1e-5)
  between = followed.qpos[1] + 2 / 3 * (followed.qpos[2] - followed.qpos[1])  # 1/30 s are 5/3 frames of 50 a second
  np.testing.assert_allclose(back.qpos[1], between, atol=1e-4)
  for fps in (0, -30, 1e9, None, [30], "30", True):
    about.write_text(json.dumps(stated | {"fps": fps}))
    with pytest.raises(InputError, match="fps is .*, expected 1 to 1000 frames a second"):
      robots.read_csv(path, g1)


@pytest.mark.parametrize("format", sorted(set(robots.FORMATS) - {"unitree_xyzw", "kimodo_wxyz"}))
def test_npz_formats_hold_the_motion(g1, walk, followed, tmp_path, format):
  path, about = robots.write(followed, tmp_path / "walk", format)
  with np.load(path, allow_pickle=False) as file:
    arrays = {key: file[key] for key in file.files}
  stated = json.loads(about.read_text())
  assert stated["axes"].startswith("z up") and stated["fps"] == (30 if format == "holosoma" else 50)
  qpos, (places, _) = followed.qpos, g1.kinematics(followed.qpos)
  angles, bodies = qpos[:, 7:], [0, *(g1.model.jnt_bodyid[1 + np.array(ISAACLAB)] - 1)]
  expected = {
      "gmr": dict(fps=50, root_pos=qpos[:, :3], root_rot=qpos[:, [4, 5, 6, 3]], dof_pos=angles),
      "mujoco": dict(fps=50, qpos=qpos), "loco_mujoco": dict(frequency=50, qpos=qpos, split_points=[0, len(qpos)]),
      "mjlab": dict(fps=[50], joint_pos=angles, body_pos_w=places),
      "beyondmimic": dict(fps=[50], joint_pos=angles[:, ISAACLAB], body_pos_w=places[:, bodies]),
      "holosoma": dict(height=1.65)}[format]
  for key, value in expected.items():
    np.testing.assert_allclose(arrays[key], value, atol=0.15 if key == "height" else 1e-5, err_msg=key)
  if "qvel" in arrays:
    np.testing.assert_allclose(arrays["qvel"][1:-1, 6:], (angles[2:] - angles[:-2]) * 25, atol=1e-6)
  if format == "holosoma":
    np.testing.assert_allclose(arrays["global_joint_positions"][::3], walk.joints[::2][..., [2, 0, 1]], atol=1e-5)
  if "joint_names" in arrays:
    assert tuple(arrays["joint_names"])[-29:] == g1.joints
  if format != "holosoma":  # which holds the person's joints, at its own rate
    np.testing.assert_allclose(export.load(path).joints, followed.to_clip().joints, atol=1e-4)


def test_the_way_back_shows_the_same_hands(g1, walk, followed):
  clip = followed.to_clip()
  places, turned = g1.kinematics(followed.qpos)
  wrist = from_robot_axes(g1.place("left_wrist", places, turned))
  np.testing.assert_allclose(clip.joints[:, 20], wrist, atol=1e-5)
  np.testing.assert_allclose(to_robot_axes(from_robot_axes(wrist)), wrist, atol=1e-12)


HINGE = ('<joint name="{}{}" type="revolute"><parent link="{}"/><child link="{}"/><limit lower="-1" upper="1" '
         'effort="1" velocity="1"/></joint>')
RING = f'<robot name="ring"><link name="a"/><link name="b"/>{HINGE.format(*"abab")}{HINGE.format(*"baba")}</robot>'
LOOP = '<equality><connect body1="left_elbow" body2="right_elbow" anchor="0 0 0"/></equality></mujoco>'
SLIDE = LIMB.replace('axis="0 1 0" range="0 2.4"', 'type="slide" axis="0 1 0" range="0 1"')


@pytest.mark.parametrize("text, about, message", [
    ("<mujoco><worldbody>", mapping(), "cannot read this robot"), (RING, mapping(), "cannot read this robot"),
    ("<mujoco><worldbody/></mujoco>", mapping(), "expected one humanoid|names the bodies"),
    (humanoid().replace("</mujoco>", LOOP), mapping(), "closed loops"), (humanoid(SLIDE), mapping(), "sliding"),
    (humanoid(), None, "--robot-mapping FILE.json"),
    (humanoid(), {part: body for part, body in mapping().items() if part != "left_knee"}, "lacks left_knee"),
    (humanoid(), mapping() | {"tail": "base"}, "names tail"),
    (humanoid(), mapping() | {"left_knee": "nothing"}, "names the bodies nothing"),
    (humanoid(), mapping() | {"left_knee": "left_hip"}, "one point of left_hip"),
    (humanoid(), mapping() | {"left_knee": ["left_hip"]}, "expected a body, or"),
    (humanoid(), {"bodies": mapping() | {"left_wrist": ["left_elbow", ["x", 0, 0]]}}, "expected a body, or"),
    (humanoid(), json.dumps(mapping())[:-1] + ', "left_knee": "left_hip"}', "left_knee stands twice"),
    *((humanoid(), {"bodies": mapping()} | more, message) for more, message in (
        ({"stand": {"left_knee": "bent"}}, "expected a number of radians"), ({"stand": [1]}, "expected an object"),
        ({"stand": {"tail": 1}}, "stand of the description names tail"), ({"stands": {}}, "has the keys stands"),
        ({"apart": [[["tail"], ["base"]]]}, "apart of the description names tail"), ({"bodies": [1]}, "an object"),
        ({"apart": ["base"]}, "pairs of lists"), ({"fixed": {"14": ["tail"]}}, "fixed of .* names tail")))])
def test_what_is_no_robot_or_no_mapping_of_it_is_one_sentence(tmp_path, text, about, message):
  path = tmp_path / ("a.urdf" if text == RING else "a.xml")
  path.write_text(text)
  if isinstance(about, str):
    (tmp_path / "map.json").write_text(about)
    about = tmp_path / "map.json"
  with pytest.raises(InputError, match=message):
    robots.load(path, about)


def test_a_robot_without_limits_is_said(tmp_path):
  (tmp_path / "free.xml").write_text(humanoid(LIMB.replace('range="-2 1"', "")))
  with pytest.warns(UserWarning, match="left_hip_y, right_hip_y have no limits"):
    assert np.isinf(robots.load(tmp_path / "free.xml", mapping()).ranges).any()


@pytest.mark.parametrize("path", sorted((ROOT / "examples" / "robots").glob("*.json")), ids=lambda path: path.stem)
def test_the_mappings_of_the_examples_are_whole(path):
  about = description.read(path, path)
  parts = {part: description.body_and_point(path, part, value) for part, value in about["bodies"].items()}
  description.check_bodies(path, parts, {body for body, _ in parts.values()})


@pytest.mark.slow
def test_robots_of_ones_own_move_the_same_wherever_their_frames_point(tmp_path, walk):
  """Feet, knees and the chest of a file may have any axes: targets are relative to the upright pose."""
  (tmp_path / "plain.xml").write_text(humanoid())
  # The foot's frame turned by 90 degrees about z, what hangs in it turned back.
  turned = LIMB.replace('<body name="{s}_ankle" pos="0 0 -0.38"><joint name="{s}_ankle" axis="0 1 0"',
                        '<body name="{s}_ankle" pos="0 0 -0.38" euler="0 0 1.5707963"><joint name="{s}_ankle" '
                        'axis="1 0 0"').replace('pos="0.04 0 -0.03" size="0.1 0.04 0.02"',
                                                'pos="0 -0.04 -0.03" size="0.04 0.1 0.02"')
  (tmp_path / "turned.xml").write_text(humanoid(turned))
  short = walk.cut(0, 12)
  plain, other = (robots.retarget(short, robots.load(tmp_path / name, mapping()))
                  for name in ("plain.xml", "turned.xml"))
  np.testing.assert_allclose(other.qpos, plain.qpos, atol=1e-3)
  assert plain.qpos.shape[1] == 7 + 15 and robots.report(plain, short).feet[0] < 30
  export.strip(plain, tmp_path / "small.png", num=2, height=80)
  assert (tmp_path / "small.png").stat().st_size > 500


@pytest.mark.slow
def test_the_command_writes_files_and_a_report(walk, tmp_path, capsys):
  export.npz(walk.cut(0, 12), tmp_path / "walk.npz")
  assert cli.main(["retarget", f"{tmp_path}/walk.npz", "--format", "unitree_xyzw,mujoco", "--picture",
                   f"{tmp_path}/walk.png"]) == 0
  printed = capsys.readouterr().out
  assert "largest step of a joint" in printed and (tmp_path / "walk.mujoco.npz").is_file()
  assert cli.main(["retarget", f"{tmp_path}/walk.unitree_xyzw.csv", "--out", f"{tmp_path}/back.bvh"]) == 0
  assert (tmp_path / "back.bvh").is_file()
  export.npz(walk.cut(0, 2), tmp_path / "short.npz")
  assert cli.main(["retarget", f"{tmp_path}/short.npz", "--out", f"{tmp_path}/named.gmr.npz"]) == 0
  assert (tmp_path / "named.gmr.npz").is_file()  # the ending chooses the format


@pytest.mark.parametrize("arguments, message", [
    (["--format", "nao"], "got robot format 'nao'"), (["--robot", "r2d2"], "got robot 'r2d2'"),
    (["--robot", "none.urdf"], "there is no robot file none.urdf"),
    (["--joints", "24"], "expected 23, 29"),
    (["--picture", "x.txt"], "expected a file that ends in")])
def test_the_command_refuses_in_one_line(walk, tmp_path, capsys, arguments, message):
  export.npz(walk.cut(0, 4), tmp_path / "walk.npz")
  assert cli.main(["retarget", f"{tmp_path}/walk.npz", *arguments]) == 1
  assert message in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("limb, first, caught", [
    ("left_arm", 15, [-2.9, 1.9, 2.5]), pytest.param("left_arm", 15, [2.5, 2.0, -2.4], marks=pytest.mark.exhaustive),
    ("legs", 0, [-2.5, -0.5, -2.7, 0.0, -0.8, 0.2, -2.3, 0.4, 2.7])])
def test_a_limb_that_is_caught_on_the_wrong_side_gets_out(g1, walk, limb, first, caught):
  """Joints far from where they should be: hands and pelvis are in their places within half a second."""
  target, solver = targets_of(walk.cut(0, 4), g1, 50.0)[0], Solver(g1, 50.0)
  solver.step(target)
  before, configuration = solver.off(solver.configuration), solver.configuration.q.copy()
  configuration[7 + first:7 + first + len(caught)] = caught
  solver.configuration.update(configuration)
  solver.step(target)
  assert solver.off(solver.configuration)[limb] > 0.15
  for _ in range(25):
    solver.step(target)
  after = solver.off(solver.configuration)
  assert all(after[limb] < before[limb] + 0.01 for limb in after), (before, after)


def test_an_arm_that_stretches_and_bends_the_other_way_follows(g1, walk):
  """A wave: the forearm sweeps through straight. An elbow that gave way backward was caught at its limit."""
  target, solver = targets_of(walk.cut(0, 4), g1, 50.0)[0], Solver(g1, 50.0)
  elbow, off = 7 + g1.joints.index("right_elbow_joint"), []
  for degrees in np.concatenate([[60.0], np.linspace(60, -80, 30)]):
    side = rot.unit(np.array([0.2, -1.0, 0.3]))
    fore = rot.rotate(rot.about_axis(np.radians(degrees), "x"), side)
    qpos = solver.step(target._replace(arms=target.arms | {"right": (side, fore)}))
    off.append(solver.off(solver.configuration)["right_arm"])
    assert qpos[elbow] < 1.45, "straight"
  assert max(off) < 0.1 and off[-1] < 0.03, off
