"""From a human motion to a robot's: inverse kinematics frame by frame, each frame from the one before it.

mink (PyPI) solves each step as a quadratic program over the joint speeds: targets by weight, joint limits, a largest
joint speed, and bodies that stay apart as constraints.
"""
import sys
import time
from typing import Any

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.motion import rotations as rot
from motion_jax.robots.motion import RobotMotion
from motion_jax.robots.robot import SIDES, SITE, Robot
from motion_jax.robots.targets import Target, TargetStream, sizes_of, targets_of
from motion_jax.shapes import Float, Num
from motion_jax.utils.errors import InputError

RATE = 50.0          # frames a second, the tick of most controllers
MAX_SPEED = 20.0     # radians a second of any joint
_ITERATIONS = 4      # of inverse kinematics in a frame
_FIRST = 60          # before the first frame, from the upright pose at its place
_APART = 0.01        # metres that bodies which must not touch are kept apart
_LEVEL = np.array([1.0, 0, 0, 0])
# (position, rotation) weights of the parts.
_WEIGHTS = {"pelvis": (20, 10), "torso": (0, 8), "knee": (2, 0), "ankle": (80, 8), "elbow": (6, 0), "wrist": (10, 0)}

_POSTURE = 0.05     # the weight with which a joint stays at its upright angle
# A limb that is far from its target is solved again from the upright pose (`_look_for_another_way`).
_LOST = {"left_arm": 0.08, "right_arm": 0.08, "legs": 0.15}  # metres off target from which on that is tried
_FOUND = 0.5        # share of the error that may remain for the other solution to be taken
_LEAVING = 4.0      # weight of a limb's joints while they move to the other solution
_LIFTED = 1.0       # weight of both ankles while the legs move to it
_SEARCH = 25        # iterations of that search
_STANDING = 400.0   # the position weight of an ankle that stands
_BENT = 0.01        # metres by which a bent elbow brings a hand nearer to its shoulder


def retarget(clip: Clip, robot: Robot, fps: float = RATE) -> RobotMotion:
  """The motion of a clip of HumanML3D's 22 joints by a robot, fps frames a second.

  The root goes where the person goes, scaled by the length of the legs; a foot that stands stays in its place, flat on
  the floor z = 0; joints keep within their limits and below MAX_SPEED. `report.of` says how well it follows.
  """
  if clip.skeleton.name != "humanml3d":
    raise InputError(f"got a motion on skeleton {clip.skeleton.name!r}, expected HumanML3D's 22 joints")
  began = time.perf_counter()
  targets = targets_of(clip, robot, fps)
  solver = Solver(robot, fps)
  qpos = np.stack([solver.step(target) for target in targets])
  meta = {"robot": robot.name, "seconds_per_second": (time.perf_counter() - began) / max(clip.seconds, 1e-9)}
  return RobotMotion(robot, qpos, fps, np.stack([target.planted for target in targets]), clip.captions, clip.source,
                     clip.license, clip.meta | meta, clip, targets)


class Stream:
  """A robot's configurations of joints that come block by block, at most `targets.DELAY` seconds behind them.

  Any blocks give the same configurations, which are those of `retarget` for a motion on HumanML3D's own body with the
  floor at 0, as all models give it.
  """

  def __init__(self, robot: Robot, source_fps: float, fps: float = RATE) -> None:
    self.robot, self.fps = robot, fps
    self._targets, self._solver = TargetStream(robot, fps, source_fps), Solver(robot, fps)

  def push(self, joints: Num[np.ndarray, "t 22 3"]) -> Float[np.ndarray, "n q"]:
    """Configurations (N, 7 + joints) that joints (T, 22, 3), metres, y up, have made final."""
    return self._solved(self._targets.push(joints))

  def finish(self) -> Float[np.ndarray, "n q"]:
    """The configurations of the last frames, which end the stream."""
    return self._solved(self._targets.finish())

  def _solved(self, targets):
    return np.array([self._solver.step(target) for target in targets]).reshape(-1, self.robot.model.nq)


class Solver:
  """Inverse kinematics of a robot, with the configuration of the last frame: frame after frame, or a whole motion."""

  def __init__(self, robot: Robot, fps: float) -> None:
    mink = _import_mink()
    self.robot, self.fps, model = robot, fps, robot.model
    self.sizes = sizes_of(robot)
    self.configuration = mink.Configuration(model, robot.standing())
    self.tasks = {part: mink.FrameTask(SITE + part, "site", *_WEIGHTS[part.rpartition("_")[2]], lm_damping=0.01)
                  for part in robot.parts if part.rpartition("_")[2] in _WEIGHTS}
    weights = np.full(model.nv, _POSTURE)
    for name, weight in robot.posture.items():
      weights[int(model.joint(name).dofadr[0])] = weight
    self._weights, self._posture = weights, mink.PostureTask(model, cost=weights)
    self._posture.set_target(robot.standing())
    self._other = mink.Configuration(model, robot.standing())
    self._all = [*self.tasks.values(), self._posture, mink.DampingTask(model, cost=0.05)]
    self._limits = [mink.ConfigurationLimit(model)]
    self._keep_elbows_from_bending_back(self._limits[0])
    self._speed = mink.VelocityLimit(model, {name: MAX_SPEED for name in robot.joints})
    pairs = [tuple(self._shapes(bodies) for bodies in pair) for pair in robot.apart]
    if pairs:
      self._limits.append(mink.CollisionAvoidanceLimit(
          model, pairs, minimum_distance_from_collisions=_APART, collision_detection_distance=0.05))
    fixed = [int(model.joint(name).dofadr[0]) for name in robot.fixed]
    self._constraints = [mink.DofFreezingTask(model, fixed)] if fixed else None
    self._begun = False
    self._limbs = {f"{side}_arm": self._dofs_between("torso", f"{side}_wrist") for side in SIDES} | {
        "legs": self._dofs_between("pelvis", "left_ankle") | self._dofs_between("pelvis", "right_ankle")}
    self._leaving: list[str] = []  # limbs that go over to another solution
    self._soles = robot.soles()
    self._shoulders = {side: self._in_torso(f"{side}_shoulder") for side in SIDES}

  def _shapes(self, bodies):
    model = self.robot.model
    ids = [model.body(name).id for name in bodies]
    return [int(geom) for geom in np.flatnonzero(np.isin(model.geom_bodyid, ids)) if model.geom_contype[geom]]

  def _dofs_between(self, first, last):
    """Which of the joint speeds (NV,) turn a part against another one that carries it."""
    model = self.robot.model
    end, dofs = model.body(self.robot.parts[first][0]).id, np.zeros(model.nv, bool)
    body = model.body(self.robot.parts[last][0]).id
    while body not in (end, 0):
      dofs |= model.dof_bodyid == body
      body = model.body_parentid[body]
    return dofs

  def _keep_elbows_from_bending_back(self, limit):
    """Limits elbows that can bend both ways to the range of a person's: straight at one end.

    A robot's elbow that has gone past straight is stuck there, as it can follow the targets only a few degrees further.
    """
    model, robot = self.robot.model, self.robot
    for side in SIDES:
      elbow = model.body(robot.parts[f"{side}_elbow"][0])
      for joint in range(elbow.jntadr[0], elbow.jntadr[0] + elbow.jntnum[0]):
        column = int(model.jnt_qposadr[joint])
        qpos = np.tile(robot.standing(), (64, 1))
        qpos[:, column] = np.linspace(limit.lower[column], limit.upper[column], len(qpos))
        places, turned = robot.kinematics(qpos)
        reach = np.linalg.norm(robot.place(f"{side}_wrist", places, turned)
                               - robot.place(f"{side}_shoulder", places, turned), axis=-1)
        if model.jnt_limited[joint] and reach.max() > max(reach[0], reach[-1]) + _BENT:
          straight = qpos[reach.argmax(), column]
          (limit.upper if robot.standing()[column] < straight else limit.lower)[column] = straight

  def _in_torso(self, part):
    places, turned = self.robot.kinematics(self.robot.standing()[None])
    torso = self.robot.index("torso")
    return rot.rotate(rot.conjugate(turned[:, torso]), self.robot.place(part, places, turned) - places[:, torso])[0]

  def step(self, target: Target) -> Float[np.ndarray, " q"]:
    """The configuration (7 + N,) of the next frame."""
    self.tasks["pelvis"].set_target(_pose(target.turned["pelvis"], target.pelvis))
    self.tasks["torso"].set_target(_pose(target.turned["torso"], np.zeros(3)))
    self._weigh_ankles(target, lifted="legs" in self._leaving)
    first = not self._begun
    if first:  # half a turn away, the joints would wind up to their limits on the way, and stay there
      self.configuration.update(self._standing_at(target))
    self._iterate(self.configuration, target, _FIRST if first else _ITERATIONS,
                  self._limits if first else [*self._limits, self._speed])
    self._begun = True
    self._look_for_another_way(target)
    return self.configuration.q.copy()

  def _standing_at(self, target):
    """The upright pose where the target's pelvis is, facing as it does."""
    w, _, _, z = target.turned["pelvis"]
    yaw = np.array([w, 0, 0, z]) if np.hypot(w, z) > 1e-6 else _LEVEL
    start = self.robot.standing()
    start[:2] = target.pelvis[:2]
    start[3:7] = rot.multiply(rot.unit(yaw), start[3:7])
    return start

  def _iterate(self, configuration, target, rounds, limits):
    import mink
    step = 1 / self.fps / _ITERATIONS
    for _ in range(rounds):
      self._aim_arms(configuration, target)
      self._aim_feet(configuration, target)
      for side in SIDES:
        self._place(configuration, f"{side}_knee", target.limbs[f"{side}_knee"])
      velocity = mink.solve_ik(configuration, self._all, step, "daqp", damping=1e-3, limits=limits,
                               constraints=self._constraints)
      configuration.integrate_inplace(velocity, step)

  def _weigh_ankles(self, target, lifted=False):
    """A leg that swings past gives way to one that stands; both give way while they go over to another solution."""
    for side, stands in zip(SIDES, target.planted):
      place, turn = (_STANDING if stands else _WEIGHTS["ankle"][0]), _WEIGHTS["ankle"][1]
      self.tasks[f"{side}_ankle"].set_position_cost(_LIFTED if lifted else place)
      self.tasks[f"{side}_ankle"].set_orientation_cost(_LIFTED / place * turn if lifted else turn)

  def _look_for_another_way(self, target):
    """A limb that is far from its target may be caught: turned round to the wrong side, against a limit.

    Then the frame is solved once more from the upright pose, without a largest speed. Limbs that end much nearer go
    over to that solution in the next frames; the others stay as they are.
    """
    goal, weights, self._leaving = self.robot.standing(), self._weights.copy(), []
    self._posture.set_target(goal)
    self._posture.set_cost(weights)
    off = self.off(self.configuration)
    if all(off[limb] < _LOST[limb] for limb in off):
      return
    self._weigh_ankles(target)
    self._other.update(self._standing_at(target))
    self._iterate(self._other, target, _SEARCH, self._limits)
    other = self.off(self._other)
    self._leaving = [limb for limb in off if off[limb] >= _LOST[limb] and other[limb] < _FOUND * off[limb]]
    for limb in self._leaving:
      dofs = self._limbs[limb]
      weights[dofs] = _LEAVING
      goal[7:][dofs[6:]] = self._other.q[7:][dofs[6:]]
    self._posture.set_target(goal)
    self._posture.set_cost(weights)

  def off(self, configuration: Any) -> dict[str, float]:
    """Metres by which each limb is off: a hand, or the worst of the pelvis and the ankles."""
    error = {part: float(np.linalg.norm(self.tasks[part].compute_error(configuration)[:3])) for part in self.tasks}
    return {f"{side}_arm": error[f"{side}_wrist"] for side in SIDES} | {
        "legs": max(error["pelvis"], error["left_ankle"], error["right_ankle"])}

  def _place(self, configuration, part, place):
    """Aims a part at a place, turned as it is now: a turn in the world would make the error depend on the heading."""
    import mink
    now = configuration.get_transform_frame_to_world(SITE + part, "site")
    self.tasks[part].set_target(mink.SE3.from_rotation_and_translation(now.rotation(), place))

  def _aim_arms(self, configuration, target):
    """Elbows and wrists by the directions of the arms, from where the robot's own shoulders are by now."""
    data, model = configuration.data, self.robot.model
    torso = model.body(self.robot.parts["torso"][0]).id
    for side in SIDES:
      upper, fore = target.arms[side]
      shoulder = data.xpos[torso] + data.xmat[torso].reshape(3, 3) @ self._shoulders[side]
      elbow = shoulder + self.sizes.upper_arm * upper
      self._place(configuration, f"{side}_elbow", elbow)
      self._place(configuration, f"{side}_wrist", elbow + self.sizes.forearm * fore)

  def _aim_feet(self, configuration, target):
    """Ankles by their targets, higher where the sole, turned as the robot's ankle can be, would be in the floor."""
    data = configuration.data
    for side, (body, sole) in zip(SIDES, self._soles):
      ankle = target.limbs[f"{side}_ankle"].copy()
      point = self.robot.parts[f"{side}_ankle"][1]
      below = ((sole - point) @ data.xmat[body + 1].reshape(3, 3).T)[:, 2].min()
      ankle[2] = max(ankle[2], -below)
      self.tasks[f"{side}_ankle"].set_target(_pose(target.turned[f"{side}_ankle"], ankle))


def _import_mink():
  """mink, without JAX (0.7 processor seconds), which qpsolvers would import along with a solver that is not used."""
  unused = "qpsolvers.solvers.jaxopt_osqp_"
  sys.modules.setdefault(unused, None)  # type: ignore[arg-type]  # its import fails, as where jaxopt is not installed
  try:
    import mink
    return mink
  finally:
    if sys.modules[unused] is None:
      del sys.modules[unused]


def _pose(turned, place):
  import mink
  return mink.SE3.from_rotation_and_translation(mink.SO3(rot.unit(turned)), place)
