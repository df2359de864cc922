"""A robot's shapes as capsules for the project's own renderer, which needs no OpenGL and draws the same everywhere."""
from types import SimpleNamespace

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.figure import COLORS, BodyPart, Figure
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.robots.robot import SIDES, from_robot_axes

_LIGHT, _DARK = COLORS["middle"], COLORS["dark"]


def figure_of(motion) -> Figure:
  """The figure of a `RobotMotion`: capsules of its shapes, boxes and meshes as the capsules that fill them."""
  robot = motion.robot
  places, turned = robot.kinematics(motion.qpos)
  bodies, a, b, radii, groups = _capsules(robot)
  ends = [from_robot_axes(places[:, bodies] + rot.rotate(turned[:, bodies], points[None])) for points in (a, b)]
  parts = tuple(BodyPart(0, 0, (0, 0, 0), (0, 0, 0), 0, radius, radius, group) for radius, group in zip(radii, groups))
  ahead = from_robot_axes(rot.rotate(robot.turn("pelvis", turned), np.array([1.0, 0, 0])[None])) * [1, 0, 1]
  ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-9)
  clip = motion.to_clip()
  thigh = robot.index("left_knee"), robot.index("left_hip")
  length = np.linalg.norm(places[0, thigh[0]] - places[0, thigh[1]])
  return Figure(HUMANML3D, np.asarray(clip.joints, np.float64), SimpleNamespace(offsets=np.array([[0, length, 0]])),
                parts, *ends, ahead, 0.0, skinned=False)


def _capsules(robot):
  """(bodies (P,), ends a and b (P, 3) in the bodies' frames, radii (P,), groups of colours) of the shapes."""
  import mujoco
  model, capsules = robot.model, []
  seen = model.geom_rgba[:, 3] > 0
  for geom in np.flatnonzero((model.geom_bodyid > 0) & seen):
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    center, half = np.zeros(3), size.copy()
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
      half = np.full(3, size[0])
    elif kind in (mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER):
      rounded = size[0] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0
      half = np.array([size[0], size[0], size[1] + rounded])
    elif kind not in (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
      center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    if half.max() < 0.01:
      continue  # points of contact
    group = _DARK if model.geom_rgba[geom, :3].mean() < 0.5 else _LIGHT
    for low, high, radius in _filling(half):
      points = model.geom_pos[geom] + rot.rotate(model.geom_quat[geom][None], center + np.stack([low, high]))
      capsules.append((int(model.geom_bodyid[geom]) - 1, points[0], points[1], radius, _group(robot, geom, group)))
  bodies, a, b, radii, groups = zip(*capsules)
  return np.array(bodies), np.stack(a), np.stack(b), np.array(radii), groups


def _filling(half):
  """[(end, end, radius)] of capsules that fill a box of half sizes (3,): along its longest side, side by side."""
  order = np.argsort(half)
  thin, middle, long = half[order]
  reach = np.zeros(3)
  reach[order[2]] = long - thin
  count = max(int(np.ceil(middle / thin - 0.2)), 1) if thin > 0 else 1
  for step in np.linspace(-1, 1, count) if count > 1 else (0.0,):
    across = np.zeros(3)
    across[order[1]] = step * (middle - thin)
    yield across - reach, across + reach, float(max(thin, 0.005))


def _group(robot, geom, color):
  name = robot.model.body(int(robot.model.geom_bodyid[geom])).name
  side = next((side for side in SIDES if name.startswith((side, side[0] + "_"))), "")
  return "dark" if color is _DARK else side or "middle"
