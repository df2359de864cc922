"""Robots' .npz files back to motions: those that `formats.write` writes, and others with the same keys."""
import pathlib

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.plausibility import check_rate
from motion_jax.robots.formats import order_of, side_car
from motion_jax.robots.motion import RobotMotion
from motion_jax.robots.robot import Robot
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import load_npz, npz_names
from motion_jax.utils.numerals import named

_GMR = {"root_pos", "root_rot", "dof_pos"}
_BODIES = {"joint_pos", "body_pos_w", "body_quat_w"}
_KINDS = (_GMR, {"qpos"}, _BODIES)


def is_robots(path: str | pathlib.Path) -> bool:
  """Whether a .npz file holds a robot's motion: GMR's keys, MuJoCo's, LocoMuJoCo's, or those of mjlab and IsaacLab."""
  keys = set(npz_names(path))
  return any(kind <= keys for kind in _KINDS)


def read_npz(path: str | pathlib.Path, robot: Robot, fps: float | None = None) -> RobotMotion:
  """The motion of a robot in a .npz file of any known keys. fps: replaces the rate that it states.

  The order of the joints, mjlab's or IsaacLab's, follows from where the bodies are. Raises InputError for other keys,
  other joints than the robot's, or numbers that are no motion.
  """
  path = pathlib.Path(path)
  keys = set(npz_names(path))
  kind = next((kind for kind in _KINDS if kind <= keys), None)
  if kind is None:
    raise InputError(f"{path} holds {named(sorted(keys))}, expected "
                     f"{'; '.join(named(sorted(kind)) for kind in _KINDS)}")
  arrays = load_npz(path, (*kind, "fps", "frequency"), ("joint_names",), required=tuple(kind))
  shapes = {name: arrays[name].shape for name in kind}
  if len({shape[0] for shape in shapes.values() if shape}) != 1 or not all(shapes.values()) or not all(
      np.isfinite(arrays[name]).all() for name in kind):
    raise InputError(f"{path}: its arrays {shapes} are no frames of finite numbers; write it again")
  qpos = _gmr(path, arrays, robot) if kind is _GMR else _bodies(path, arrays, robot) if kind is _BODIES else _qpos(
      path, arrays, robot)
  norms = np.linalg.norm(qpos[:, 3:7], axis=1)
  if np.abs(norms - 1).max() > 0.02:
    raise InputError(f"{path}: its root quaternions have lengths of {norms.min():.3g} to {norms.max():.3g}, expected 1")
  about = side_car(path)
  rate = fps or next((float(arrays[name].ravel()[0]) for name in ("fps", "frequency") if name in arrays and
                      arrays[name].size), None) or about.get("fps")
  if rate is None:
    raise InputError(f"{path} states no rate; give it by --fps (fps=)")
  check_rate(rate, str(path))
  return RobotMotion(robot, qpos, float(rate), source=path.name, license=about.get("licence") or "",
                     meta={"robot": robot.name, "quaternion_order": "xyzw" if kind is _GMR else "wxyz"})


def _whole(path, array, width, name):
  if array.ndim != 2 or array.shape[1] != width:
    raise InputError(f"{path}: {name} has the shape {array.shape}, expected (frames, {width}) for this robot; --joints "
                     "chooses a variant")
  return array.astype(np.float64)


def _joined(robot, root, quaternion, names, angles):
  qpos = np.zeros((len(root), robot.model.nq))
  qpos[:, :3], qpos[:, 3:7] = root, quaternion
  for column, name in enumerate(names):
    qpos[:, 7 + robot.joints.index(name)] = angles[:, column]
  return qpos


def _gmr(path, arrays, robot):
  angles = _whole(path, arrays["dof_pos"], len(robot.moving), "dof_pos")
  return _joined(robot, _whole(path, arrays["root_pos"], 3, "root_pos"),
                 np.roll(_whole(path, arrays["root_rot"], 4, "root_rot"), 1, axis=1), robot.moving, angles)


def _qpos(path, arrays, robot):
  qpos = _whole(path, arrays["qpos"], robot.model.nq, "qpos")
  names = arrays["joint_names"].ravel().tolist() if "joint_names" in arrays else list(robot.joints)
  names = names[1:] if len(names) == len(robot.joints) + 1 else names  # the root's own joint comes first
  if sorted(names) != sorted(robot.joints):
    raise InputError(f"{path}: its joints are {named(names)}; the robot {robot.name} has {named(robot.joints)}")
  return _joined(robot, qpos[:, :3], qpos[:, 3:7], names, qpos[:, 7:])


def _bodies(path, arrays, robot):
  angles = _whole(path, arrays["joint_pos"], len(robot.joints), "joint_pos")
  places, turned = arrays["body_pos_w"].astype(np.float64), arrays["body_quat_w"].astype(np.float64)
  candidates = []
  for order in ("mujoco", *sorted({"isaaclab"} & set(robot.orders))):
    joints, listed = order_of(robot, order)
    if places.shape[1:] == (len(listed), 3) and turned.shape[1:] == (len(listed), 4):
      qpos = _joined(robot, places[:, 0], rot.unit(turned[:, 0]), [robot.joints[j] for j in joints], angles)
      candidates.append((np.abs(robot.kinematics(qpos[:1])[0][:, listed] - places[:1]).max(), qpos))
  if not candidates:
    raise InputError(f"{path}: got body_pos_w {places.shape} and body_quat_w {turned.shape}, which are not the bodies "
                     f"of the robot {robot.name}")
  return min(candidates, key=lambda candidate: candidate[0])[1]
