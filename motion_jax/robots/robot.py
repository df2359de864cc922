"""A robot: its MuJoCo model and which of its bodies follow which human joints. Needs the extra `robot` (mujoco, mink).

The world of a robot has z up, x ahead and y to the left, metres, as MuJoCo and ROS have it; `to_robot_axes` turns from
y up, z ahead, x to the left. Configurations `qpos` are MuJoCo's: root position (3), root quaternion (w, x, y, z), then
an angle in radians for each joint.
"""
import dataclasses
import functools
import json
import pathlib
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.robots import description
from motion_jax.robots.description import SIDES
from motion_jax.shapes import Array, Float, Num
from motion_jax.utils.errors import InputError, reading
from motion_jax.utils.install import pip_install
from motion_jax.utils.numerals import named

ASSETS = pathlib.Path(__file__).parent / "assets"
SHIPPED = ("g1",)
_AXES = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x' = z, y' = x, z' = y
SITE = "part:"  # before the name of a part in the name of its site
_SOLE = 0.01  # metres above its lowest point up to which a foot's shape is its sole


def to_robot_axes(points: Num[Array, "*lead 3"]) -> Float[np.ndarray, "*lead 3"]:
  """Points (..., 3) with y up, z ahead in a robot's axes: z up, x ahead."""
  return np.asarray(points, np.float64) @ _AXES.T


def from_robot_axes(points: Num[Array, "*lead 3"]) -> Float[np.ndarray, "*lead 3"]:
  """The inverse of `to_robot_axes`."""
  return np.asarray(points, np.float64) @ _AXES


def turn_to_robot_axes(turned: Num[np.ndarray, "*lead 4"]) -> Float[np.ndarray, "*lead 4"]:
  """World rotations (..., 4), quaternions (w, x, y, z), in a robot's axes."""
  return np.concatenate([turned[..., :1], to_robot_axes(turned[..., 1:])], axis=-1)


@dataclasses.dataclass(frozen=True, eq=False)
class Robot:
  """A humanoid. Made by `load`.

  model: mujoco.MjModel, with a site named after each part; parts: {human part of PARTS: (body, point (3,) in its
  frame)}; stand: angles of the upright pose with hanging arms;
  fixed: joints that do not move; posture: {joint: weight with which it keeps its upright angle}; apart:
  pairs of lists of bodies that must not touch; orders: named orders of joints.
  """
  name: str
  title: str
  model: Any
  parts: dict[str, tuple[str, Float[np.ndarray, " 3"]]]
  stand: dict[str, float]
  fixed: tuple[str, ...] = ()
  apart: tuple = ()
  orders: dict[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
  licence: str = ""
  posture: dict[str, float] = dataclasses.field(default_factory=dict)

  @property
  def joints(self) -> tuple[str, ...]:
    """The hinges, in MuJoCo's order."""
    return tuple(self.model.joint(j).name for j in range(1, self.model.njnt))

  @property
  def moving(self) -> tuple[str, ...]:
    """The joints that are not fixed."""
    return tuple(name for name in self.joints if name not in self.fixed)

  @property
  def body_names(self) -> tuple[str, ...]:
    """All bodies of the robot, depth first, as MuJoCo has them."""
    return tuple(self.model.body(b).name for b in range(1, self.model.nbody))

  @property
  def ranges(self) -> Float[np.ndarray, "n 2"]:
    """The limits of the joints, radians; infinite where a joint has none."""
    limited = self.model.jnt_limited[1:, None].astype(bool)
    return np.where(limited, self.model.jnt_range[1:], [-np.inf, np.inf])

  @functools.cached_property
  def rest(self) -> Float[np.ndarray, "b 4"]:
    """World rotations (B, 4) of the bodies in the upright pose; body frames of a file may point anywhere."""
    return self.kinematics(self._upright()[None])[1][0]

  def standing(self) -> Float[np.ndarray, " q"]:
    """The upright configuration, soles on the floor."""
    return self._standing.copy()

  @functools.cached_property
  def _standing(self):
    qpos = self._upright()
    places, turned = self.kinematics(qpos[None])
    low = min((places[0, b] + rot.rotate(turned[0, b][None], points))[:, 2].min() for b, points in self.soles())
    qpos[2] -= low
    return qpos

  def _upright(self):
    qpos = np.zeros(self.model.nq)
    qpos[3] = 1
    for name, angle in self.stand.items():
      qpos[7 + self.joints.index(name)] = angle
    return qpos

  def kinematics(self, qpos: Num[np.ndarray, "t q"]) -> tuple[Float[np.ndarray, "t b 3"], Float[np.ndarray, "t b 4"]]:
    """World positions (T, B, 3) and quaternions (w, x, y, z) (T, B, 4) of all bodies, in the order of `body_names`."""
    import mujoco
    data = mujoco.MjData(self.model)
    places = np.empty((len(qpos), self.model.nbody - 1, 3))
    turned = np.empty((len(qpos), self.model.nbody - 1, 4))
    for t, row in enumerate(qpos):
      data.qpos[:] = row
      mujoco.mj_kinematics(self.model, data)
      places[t], turned[t] = data.xpos[1:], data.xquat[1:]
    return places, turned

  def index(self, part: str) -> int:
    """The number of the body of a human part, in the order of `body_names`."""
    return self.body_names.index(self.parts[part][0])

  def place(self, part: str, places: Num[np.ndarray, "t b 3"], turned: Num[np.ndarray, "t b 4"]
            ) -> Float[np.ndarray, "t 3"]:
    """Positions (T, 3) of a human part, from the results of `kinematics`."""
    body = self.index(part)
    return places[:, body] + rot.rotate(turned[:, body], self.parts[part][1][None])

  def turn(self, part: str, turned: Num[np.ndarray, "t b 4"]) -> Float[np.ndarray, "t 4"]:
    """World rotations (T, 4) of a human part from the upright pose, from the results of `kinematics`."""
    body = self.index(part)
    return rot.multiply(turned[:, body], rot.conjugate(self.rest[body])[None])

  def soles(self) -> list[tuple[int, Float[np.ndarray, "n 3"]]]:
    """[(body, points (N, 3) of its sole in the body's frame)] of the left and the right foot."""
    return self._soles

  @functools.cached_property
  def _soles(self):
    return [self._sole(self.index(f"{side}_ankle")) for side in SIDES]

  def _sole(self, body):
    model, soles = self.model, []
    for geom in np.flatnonzero(model.geom_bodyid == body + 1):
      center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
      corners = center + half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
      soles.append(model.geom_pos[geom] + rot.rotate(model.geom_quat[geom][None], corners))
    if not soles:
      return body, np.zeros((1, 3))
    points = np.concatenate(soles)
    height = rot.rotate(self.rest[body][None], points)[:, 2]
    return body, points[height < height.min() + _SOLE]

  def with_joints(self, count: int | None) -> "Robot":
    """The same robot with fewer moving joints, as its description names them; None: all."""
    return self if count is None or count == len(self.moving) else dataclasses.replace(
        self, fixed=self._fixed_for(count))

  def _fixed_for(self, count):
    known = self.orders.get("fixed", {})
    if str(count) not in known:
      choices = named(sorted({str(len(self.joints)), *known}))
      raise InputError(f"got {count} joints for robot {self.name}, expected {choices}")
    return tuple(known[str(count)])


def load(name: str | pathlib.Path, mapping: str | pathlib.Path | Mapping[str, str] | None = None) -> Robot:
  """A shipped robot by name ("g1"), or one of an MJCF (.xml) or URDF (.urdf) file with a mapping.

  mapping: {human part: body, or [body, [x, y, z]] for a point in the body's frame}, parts as in PARTS, or a JSON file
  of it; the file may also be a whole description like that of a shipped robot (keys bodies, stand, apart). Raises
  InputError for a file that is no humanoid on a free base.
  """
  path = pathlib.Path(name)
  if path.suffix.lower() not in (".xml", ".urdf", ".mjcf"):
    if str(name) not in SHIPPED:
      raise InputError(f"got robot {str(name)!r}, expected {named(SHIPPED)}, or an MJCF or URDF file with "
                       "--robot-mapping")
    path, mapping = ASSETS / str(name) / "robot.json", None
    about = json.loads(path.read_text())
    path = path.with_name(about["model"])
  elif not path.is_file():
    raise FileNotFoundError(f"there is no robot file {path}")
  else:
    about = description.read(path, mapping)
  parts = {part: description.body_and_point(path, part, value) for part, value in about["bodies"].items()}
  model = _model(path, parts)
  with reading(f"{path}: a joint's or body's name", "save the file as UTF-8"):
    joints, bodies = ([at(i).name for i in range(1, count)] for at, count in (
        (model.joint, model.njnt), (model.body, model.nbody)))
  description.check_names(path, about, joints, bodies)
  robot = Robot(about.get("name", path.stem), about.get("title", path.stem), model, parts,
                dict(about.get("stand", {})), (), tuple(about.get("apart", ())),
                about.get("orders", {}) | {"fixed": about.get("fixed", {})}, about.get("licence", ""),
                about.get("posture", {}))
  for part in parts:  # the sites of all parts have the axes of the world in the upright pose
    site = model.site(SITE + part).id
    model.site_quat[site] = rot.conjugate(robot.rest[robot.index(part)])
    model.site_sameframe[site] = 0  # MuJoCo would take the body's own axes
  return robot


def _model(path, parts):
  """The compiled model on a free base, with hinges alone, and a site for each part."""
  try:
    import mujoco
  except ImportError:
    raise InputError(f"robots need MuJoCo and mink: {pip_install('robot')}") from None
  try:
    spec = mujoco.MjSpec.from_file(str(path))
    roots = spec.worldbody.bodies
    if len(roots) == 1 and not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in roots[0].joints):
      roots[0].add_freejoint()
    description.check_bodies(path, parts, {body.name for body in spec.bodies})
    for part, (body, point) in parts.items():
      spec.body(body).add_site(name=SITE + part, pos=point)
    model = spec.compile()
  except InputError:
    raise
  except (ValueError, RuntimeError) as error:
    raise InputError(f"{path}: MuJoCo cannot read this robot: {' '.join(str(error).split())[:200]}") from None
  kinds = set(model.jnt_type[1:].tolist())
  if model.njnt < 2 or model.jnt_type[0] != mujoco.mjtJoint.mjJNT_FREE:
    raise InputError(f"{path}: got {model.njnt} joints below {len(roots)} root bodies, expected one humanoid, whose "
                     "only free joint is its root's")
  if kinds - {int(mujoco.mjtJoint.mjJNT_HINGE)}:
    raise InputError(f"{path}: the robot has sliding or ball joints; expected hinges below the root")
  if set(model.eq_type.tolist()) & {int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)}:
    raise InputError(f"{path}: the robot has closed loops (connect or weld constraints), expected a tree of hinges; "
                     "remove the constraints from a copy of the file")
  free = [model.joint(j).name for j in range(1, model.njnt) if not model.jnt_limited[j]]
  if free:
    warnings.warn(f"{path}: {named(free)} {'has no limits and turns' if len(free) == 1 else 'have no limits and turn'} "
                  "any way; add a range to the file", stacklevel=3)
  return model
