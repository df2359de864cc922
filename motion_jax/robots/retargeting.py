"""From a human motion to a robot's: inverse kinematics frame by frame, each frame from the one before it.

mink (PyPI) solves each step as a quadratic program over the joint speeds: targets by weight, joint limits, a largest
joint speed, and bodies that stay apart as constraints.
"""
import time

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.motion import rotations as rot
from motion_jax.robots.motion import RobotMotion
from motion_jax.robots.robot import SIDES, SITE, Robot
from motion_jax.robots.targets import Targets, sizes_of, targets_of
from motion_jax.utils.errors import InputError

RATE = 50.0          # frames a second, the tick of most controllers
MAX_SPEED = 20.0     # radians a second of any joint
_ITERATIONS = 4      # of inverse kinematics in a frame
_FIRST = 60          # before the first frame, from the upright pose
_APART = 0.01        # metres that bodies which must not touch are kept apart
# (position, rotation) weights of the parts.
_WEIGHTS = {"pelvis": (20, 10), "torso": (0, 8), "knee": (2, 0), "ankle": (80, 8), "elbow": (6, 0), "wrist": (10, 0)}


def retarget(clip: Clip, robot: Robot, fps: float = RATE) -> RobotMotion:
  """The motion of a clip of HumanML3D's 22 joints by a robot, fps frames a second.

  The root goes where the person goes, scaled by the length of the legs; a foot that stands stays in its place, flat on
  the floor z = 0; joints keep within their limits and below MAX_SPEED. `report.of` says how well it follows.
  """
  if clip.skeleton.name != "humanml3d":
    raise InputError(f"got a motion on skeleton {clip.skeleton.name!r}, expected HumanML3D's 22 joints")
  began = time.perf_counter()
  targets = targets_of(clip, robot, fps)
  qpos = Solver(robot, fps).run(targets)
  meta = {"robot": robot.name, "seconds_per_second": (time.perf_counter() - began) / max(clip.seconds, 1e-9)}
  return RobotMotion(robot, qpos, fps, targets.planted, clip.captions, clip.source, clip.license, clip.meta | meta,
                     human=clip)


class Solver:
  """Inverse kinematics of a robot, with the configuration of the last frame: frame after frame, or a whole motion."""

  def __init__(self, robot: Robot, fps: float) -> None:
    import mink
    self.robot, self.fps, model = robot, fps, robot.model
    self.sizes = sizes_of(robot)
    self.configuration = mink.Configuration(model, robot.standing())
    self.tasks = {part: mink.FrameTask(SITE + part, "site", *_WEIGHTS[part.rpartition("_")[2]], lm_damping=0.01)
                  for part in robot.parts if part.rpartition("_")[2] in _WEIGHTS}
    posture = mink.PostureTask(model, cost=0.05)
    posture.set_target(robot.standing())
    self._all = [*self.tasks.values(), posture, mink.DampingTask(model, cost=0.05)]
    self._limits = [mink.ConfigurationLimit(model)]
    self._speed = mink.VelocityLimit(model, {name: MAX_SPEED for name in robot.joints})
    pairs = [tuple(self._shapes(bodies) for bodies in pair) for pair in robot.apart]
    if pairs:
      self._limits.append(mink.CollisionAvoidanceLimit(
          model, pairs, minimum_distance_from_collisions=_APART, collision_detection_distance=0.05))
    fixed = [int(model.joint(name).dofadr[0]) for name in robot.fixed]
    self._constraints = [mink.DofFreezingTask(model, fixed)] if fixed else None
    self._begun = False
    self._shoulders = {side: self._in_torso(f"{side}_shoulder") for side in SIDES}

  def _shapes(self, bodies):
    model = self.robot.model
    ids = [model.body(name).id for name in bodies]
    return [int(geom) for geom in np.flatnonzero(np.isin(model.geom_bodyid, ids)) if model.geom_contype[geom]]

  def _in_torso(self, part):
    places, turned = self.robot.kinematics(self.robot.standing()[None])
    torso = self.robot.index("torso")
    return rot.rotate(rot.conjugate(turned[:, torso]), self.robot.place(part, places, turned) - places[:, torso])[0]

  def run(self, targets: Targets) -> np.ndarray:
    """Configurations (T, 7 + N) of all frames of targets."""
    return np.stack([self.step(targets, t) for t in range(len(targets.pelvis))])

  def step(self, targets: Targets, t: int) -> np.ndarray:
    """The configuration (7 + N,) of frame t."""
    import mink
    pose = lambda q, place: mink.SE3.from_rotation_and_translation(mink.SO3(rot.unit(q)), place)
    level = np.array([1.0, 0, 0, 0])
    self.tasks["pelvis"].set_target(pose(targets.turned["pelvis"][t], targets.pelvis[t]))
    self.tasks["torso"].set_target(pose(targets.turned["torso"][t], np.zeros(3)))
    for side in SIDES:
      self.tasks[f"{side}_knee"].set_target(pose(level, targets.limbs[f"{side}_knee"][t]))
      self.tasks[f"{side}_ankle"].set_target(pose(targets.turned[f"{side}_ankle"][t],
                                                  targets.limbs[f"{side}_ankle"][t]))
    rounds = _ITERATIONS if self._begun else _FIRST
    limits = [*self._limits, self._speed] if self._begun else self._limits
    for _ in range(rounds):
      self._aim_arms(targets, t, pose, level)
      step = 1 / self.fps / _ITERATIONS
      velocity = mink.solve_ik(self.configuration, self._all, step, "daqp", damping=1e-3, limits=limits,
                               constraints=self._constraints)
      self.configuration.integrate_inplace(velocity, step)
    self._begun = True
    return self.configuration.q.copy()

  def _aim_arms(self, targets, t, pose, level):
    """Elbows and wrists by the directions of the arms, from where the robot's own shoulders are by now."""
    data, model = self.configuration.data, self.robot.model
    torso = model.body(self.robot.parts["torso"][0]).id
    for side in SIDES:
      upper, fore = targets.arms[side]
      shoulder = data.xpos[torso] + data.xmat[torso].reshape(3, 3) @ self._shoulders[side]
      elbow = shoulder + self.sizes.upper_arm * upper[t]
      self.tasks[f"{side}_elbow"].set_target(pose(level, elbow))
      self.tasks[f"{side}_wrist"].set_target(pose(level, elbow + self.sizes.forearm * fore[t]))
