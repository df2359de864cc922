"""Files of robot motion that other programs read: what each holds, in which order, and a side-car that says so.

No CSV and no .npz of this field names its quaternion order, its axes or its order of joints. Every file written here
gets a name that says which it is, `walk.unitree_xyzw.csv`, and `walk.unitree_xyzw.json` beside it with robot, order,
axes, units, rate, source and licence.
"""
import json
import os
import pathlib
import shlex
import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.retiming import resample
from motion_jax.robots.motion import RobotMotion
from motion_jax.robots.robot import SIDES, Robot, to_robot_axes
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.json_values import plain
from motion_jax.utils.numerals import FRAME_RATES, named


class Format(NamedTuple):
  """A kind of file: its ending, the rate that its readers take (None: any), what it is, and arrays of a motion."""
  ending: str
  fps: float | None
  about: str
  arrays: Callable[[RobotMotion], dict]
  quaternion: str = "wxyz"
  order: str = "mujoco"


def _csv(order):
  def rows(motion):
    quaternion = motion.qpos[:, 3:7] if order == "wxyz" else np.roll(motion.qpos[:, 3:7], -1, axis=1)
    return {"rows": np.concatenate([motion.qpos[:, :3], quaternion, _moving(motion)], axis=1)}
  return rows


def _moving(motion):
  """The angles of the joints that are not fixed."""
  return motion.angles[:, [motion.robot.joints.index(name) for name in motion.robot.moving]]


def _qpos(motion):
  return {"qpos": motion.qpos, "qvel": motion.velocities(), "fps": np.float64(motion.fps),
          "joint_names": np.array(motion.robot.joints)}


def _gmr(motion):
  return {"fps": np.float64(motion.fps), "root_pos": motion.qpos[:, :3],
          "root_rot": np.roll(motion.qpos[:, 3:7], -1, axis=1), "dof_pos": _moving(motion)}


def body_arrays(motion: RobotMotion, order: str = "mujoco") -> dict[str, np.ndarray]:
  """BeyondMimic's arrays: joint_pos, joint_vel (T, N) and of each body position, quaternion (w, x, y, z), linear and
  angular velocity in the world, float32.

  order: "mujoco", joints and bodies depth first as mjlab has them, or another that the robot's description names, such
  as "isaaclab", breadth first. Velocities are central differences.
  """
  robot = motion.robot
  joints, bodies = order_of(robot, order)
  places, turned = (a[:, bodies] for a in robot.kinematics(motion.qpos))
  turned = rot.continuous(turned)
  step = np.gradient(places, 1 / motion.fps, axis=0) if motion.num_frames > 1 else 0 * places
  return {key: value.astype(np.float32) for key, value in dict(
      joint_pos=motion.angles[:, joints], joint_vel=motion.velocities()[:, 6:][:, joints], body_pos_w=places,
      body_quat_w=turned, body_lin_vel_w=step, body_ang_vel_w=_angular_velocity(turned, motion.fps)).items()}


def order_of(robot: Robot, order: str) -> tuple[list[int], list[int]]:
  """(joints, bodies): their places in MuJoCo's order; bodies hang on the joint that moves them."""
  if order == "mujoco":
    return list(range(len(robot.joints))), list(range(len(robot.body_names)))
  names = robot.orders.get(order)
  if names is None or set(names) != set(robot.joints):
    known = named(sorted({"mujoco", *robot.orders} - {"fixed"}))
    raise InputError(f"robot {robot.name} has no order {order!r} of its joints, expected {known}")
  body_of = {robot.model.joint(j).name: int(robot.model.jnt_bodyid[j]) - 1 for j in range(1, robot.model.njnt)}
  return [robot.joints.index(name) for name in names], [0, *(body_of[name] for name in names)]


def _angular_velocity(turned, fps):
  """Angular velocities (T, B, 3) in the world of quaternions (T, B, 4): central differences."""
  if len(turned) < 2:
    return np.zeros((*turned.shape[:-1], 3))
  first = np.maximum(np.arange(len(turned)) - 1, 0)
  last = np.minimum(np.arange(len(turned)) + 1, len(turned) - 1)
  step = rot.to_vector(rot.multiply(turned[last], rot.conjugate(turned[first])))
  return step * (fps / (last - first))[:, None, None]


def _tracker(order):
  return lambda motion: {"fps": np.array([motion.fps])} | body_arrays(motion, order)


def _holosoma(motion):
  clip = motion.human
  if clip is None:
    raise InputError("holosoma retargets a person's joints itself: it needs the human motion, which this one lacks")
  joints = to_robot_axes(resample(np.asarray(clip.joints, np.float64), clip.fps, motion.fps))
  height = float(np.percentile(joints[:, 15, 2] - joints[..., 2].min(1), 90)) + 0.12  # the head joint to the crown
  return {"global_joint_positions": joints.astype(np.float32), "height": np.float64(height)}


def _loco_mujoco(motion):
  model = motion.robot.model
  names = [model.joint(j).name for j in range(model.njnt)]
  return {"joint_names": np.array(names), "frequency": np.float64(motion.fps), "njnt": np.int64(model.njnt),
          "jnt_type": np.asarray(model.jnt_type), "qpos": motion.qpos, "qvel": motion.velocities(),
          "split_points": np.array([0, motion.num_frames])}


FORMATS = {
    "unitree_xyzw": Format(".csv", 30.0, "root position, quaternion x y z w, angles; no header: Unitree's LAFAN1 "
                           "files, BeyondMimic, mjlab and unitree_rl_lab read it", _csv("xyzw"), "xyzw"),
    "kimodo_wxyz": Format(".csv", 30.0, "root position, quaternion w x y z, angles; no header: Kimodo, ARDY and "
                          "ProtoMotions read it", _csv("wxyz")),
    "gmr": Format(".npz", None, "GMR's root_pos, root_rot (x y z w) and dof_pos, as .npz instead of its pickle",
                  _gmr, "xyzw"),
    "mjlab": Format(".npz", 50.0, "BeyondMimic's arrays, joints and bodies depth first, for mjlab", _tracker("mujoco")),
    "beyondmimic": Format(".npz", 50.0, "BeyondMimic's arrays, joints and bodies breadth first, for IsaacLab",
                          _tracker("isaaclab"), order="isaaclab"),
    "holosoma": Format(".npz", 30.0, "the person's 22 joints, z up, which holosoma-retargeting takes", _holosoma),
    "mujoco": Format(".npz", None, "qpos and qvel for MuJoCo and MJX", _qpos),
    "loco_mujoco": Format(".npz", None, "a LocoMuJoCo Trajectory", _loco_mujoco)}


def write(motion: RobotMotion, stem: str | pathlib.Path, format: str) -> list[pathlib.Path]:
  """Writes STEM.FORMAT.csv or .npz and its side-car STEM.FORMAT.json, both or none; returns both paths."""
  if format not in FORMATS:
    raise InputError(f"got robot format {format!r}, expected {named(FORMATS)}")
  kind, stem = FORMATS[format], pathlib.Path(stem)
  if kind.fps is not None:
    motion = motion.at_rate(kind.fps)
  arrays = kind.arrays(motion)
  path = stem.with_name(f"{stem.name}.{format}{kind.ending}")
  about = path.with_name(f"{stem.name}.{format}.json")
  with atomic_path(path) as table, atomic_path(about) as about_file:  # both are complete before either gets its name
    about_file.write_text(json.dumps(_about(motion, format), indent=2) + "\n")
    with open(table, "wb") as file:
      if kind.ending == ".csv":
        np.savetxt(file, arrays["rows"], fmt="%.6f", delimiter=",")
      else:
        np.savez_compressed(file, **arrays)
      file.flush()
      os.fsync(file.fileno())
  return [path, about]


def _about(motion, format):
  kind, robot = FORMATS[format], motion.robot
  joints, bodies = order_of(robot, kind.order)
  person = format == "holosoma"
  names = [robot.joints[j] for j in joints]
  return plain({
      "format": format, "holds": kind.about, "robot": robot.name,
      "joint_order": names if kind.ending == ".npz" and format != "gmr" else [n for n in names if n in robot.moving],
      "body_order": [robot.body_names[b] for b in bodies], "fixed_joints": list(robot.fixed),
      "quaternion_order": kind.quaternion, "axes": "z up, x ahead, y left", "length_unit": "m", "angle_unit": "rad",
      "fps": motion.fps, "frames": motion.num_frames,
      "joints_of_a_person": "HumanML3D's 22" if person else None,
      "prompts": [caption.text for caption in motion.captions], "source": motion.source,
      "model": motion.meta.get("model"), "seed": motion.meta.get("seed"),
      "licence": motion.license, "licence_of_the_robot": robot.licence})


def read_csv(path: str | pathlib.Path, robot: Robot, quaternion: str | None = None, fps: float | None = None
             ) -> RobotMotion:
  """A robot's CSV without header: rows of root position, quaternion and angles.

  quaternion: "xyzw" or "wxyz"; None reads it off the pelvis, which is upright in one order alone in most motions. fps:
  None is the rate of a side-car of `write`, else 30 with a warning, for the file has none.

  Raises InputError for other columns, quaternions that are not of length 1, or an order that the file does not show.
  """
  path = pathlib.Path(path)
  about = side_car(path)
  if quaternion is None:
    quaternion = about.get("quaternion_order")
  if quaternion not in (None, "xyzw", "wxyz"):
    raise InputError(f"got quaternion order {quaternion!r}, expected 'xyzw' or 'wxyz'")
  rows = _rows(path, 7 + len(robot.moving))
  four = rows[:, 3:7]
  off = np.abs(np.linalg.norm(four, axis=1) - 1)
  if off.max() > 0.02:
    raise InputError(f"{path} row {int(off.argmax()) + 1}: columns 4 to 7 have length {1 - off.max():.3g} or "
                     f"{1 + off.max():.3g}, expected a quaternion of length 1; are these Euler angles or degrees?")

  def qpos_as(order):
    qpos = np.zeros((len(rows), robot.model.nq))
    qpos[:, :3], qpos[:, 3:7] = rows[:, :3], rot.unit(four if order == "wxyz" else np.roll(four, 1, axis=1))
    for column, name in enumerate(robot.moving):
      qpos[:, 7 + robot.joints.index(name)] = rows[:, 7 + column]
    return qpos

  quaternion = quaternion or _guess(path, robot, qpos_as)
  qpos = qpos_as(quaternion)
  if np.abs(qpos[:, 7:]).max() > 2 * np.pi:
    raise InputError(f"{path}: an angle is {np.abs(qpos[:, 7:]).max():.3g}, expected radians; these look like degrees")
  if fps is None and "fps" not in about:
    warnings.warn(f"{path} states no rate, taken as 30 frames a second; --fps sets another", stacklevel=2)
  return RobotMotion(robot, qpos, float(fps or about.get("fps", 30.0)), source=path.name,
                     license=about.get("licence") or "", meta={"robot": robot.name, "quaternion_order": quaternion})


def side_car(path: pathlib.Path) -> dict:
  """The content of the .json side-car of a robot's file, {} without one. InputError for values of a wrong type."""
  from motion_jax.utils.input_files import parse_json
  from motion_jax.utils.text_files import read_text
  beside = path.with_suffix(".json")
  about = parse_json(read_text(beside), str(beside)) if beside.is_file() else {}
  if not isinstance(about, dict):
    return {}
  number = lambda value: type(value) in (int, float) and FRAME_RATES[0] <= value <= FRAME_RATES[1]
  text = lambda value: value is None or isinstance(value, str)
  for key, fits, expected in (("fps", number, f"{FRAME_RATES[0]} to {FRAME_RATES[1]} frames a second"),
                              ("quaternion_order", text, "xyzw or wxyz"), ("licence", text, "a text")):
    if key in about and not fits(about[key]):
      raise InputError(f"{beside}: {key} is {str(about[key])[:60]}, expected {expected}; mend it, or remove the file, "
                       "which is read beside the table of its name")
  return about


def _rows(path, width):
  from motion_jax.utils.text_files import read_lines, split_cells
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}")
  numbered = [(number, line) for number, line in enumerate(read_lines(path), 1)
              if line.strip() and not line.startswith("#")]
  rows = []
  for (number, line), cells in zip(numbered, split_cells([line for _, line in numbered])):
    try:
      row = [float(cell) for cell in cells]
    except ValueError:
      what = "a CSV with a header is of another format" if number == numbered[0][0] else "it is damaged"
      raise InputError(f"{path} line {number}: got {line[:40]!r}, expected {width} numbers; {what}") from None
    if len(row) != width or not np.isfinite(row).all():
      finite = "" if np.isfinite(row).all() else ", not all finite"
      raise InputError(f"{path} line {number}: got {len(row)} numbers{finite}, expected {width}: root position, "
                       f"quaternion and {width - 7} angles")
    rows.append(row)
  if not rows:
    raise InputError(f"{path} holds no rows")
  return np.array(rows)


def _guess(path, robot, qpos_as):
  """The order in which the pelvis is upright, unless that takes the body off the floor and the other does not."""
  upright, lowest = {}, {}
  for order in ("wxyz", "xyzw"):
    qpos = qpos_as(order)
    upright[order] = float(np.median(1 - 2 * (qpos[:, 4] ** 2 + qpos[:, 5] ** 2)))  # z of the turned z axis
    sample = qpos[np.linspace(0, len(qpos) - 1, min(len(qpos), _SAMPLED)).astype(int)]
    places, turned = robot.kinematics(sample)
    hands = [robot.place(f"{side}_wrist", places, turned) for side in SIDES]
    lowest[order] = float(np.median(np.concatenate([places, np.stack(hands, 1)], axis=1)[..., 2].min(1)))
  best, other = sorted(upright, key=lambda order: -upright[order])
  on_the_floor = _ON_THE_FLOOR[0] < lowest[other] < _IN_THE_FLOOR
  if lowest[best] < -_IN_THE_FLOOR and -_IN_THE_FLOOR < lowest[other] < _IN_THE_FLOOR:
    return other
  off_the_floor = on_the_floor and not _ON_THE_FLOOR[0] < lowest[best] < _ON_THE_FLOOR[1]  # a handstand?
  if off_the_floor or upright[best] < 0.5 or upright[best] - upright[other] < 0.3:
    raise InputError(f"{path}: nothing in the file says whether its quaternions are (w, x, y, z) or (x, y, z, w): the "
                     f"pelvis is upright by {upright['wxyz']:.2f} and {upright['xyzw']:.2f}, the lowest joint at "
                     f"{lowest['wxyz']:.2f} and {lowest['xyzw']:.2f} m; state it: motion-jax retarget "
                     f"{shlex.quote(str(path))} --quaternion wxyz (or xyzw)")
  if _ON_THE_FLOOR[0] < lowest[other] < _ON_THE_FLOOR[1]:
    warnings.warn(f"{path}: by its quaternions as {best} it stands; --quaternion {other} reads it "
                  f"{'upside down' if upright[other] < -0.5 else 'lying'}, on the floor as well", stacklevel=3)
  return best


_SAMPLED, _IN_THE_FLOOR = 16, 0.3  # frames; metres of the lowest joint below the floor
_ON_THE_FLOOR = -0.1, 0.15         # metres of the lowest joint of a body that stands
