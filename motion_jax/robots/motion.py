"""The motion of a robot: configurations at a fixed rate, and the human joints that it shows."""
import dataclasses
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from motion_jax.data.clip import Caption, Clip
from motion_jax.motion import rotations as rot
from motion_jax.motion.figure import Figure
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.robots.robot import SIDES, Robot, from_robot_axes
from motion_jax.robots.targets import Target
from motion_jax.shapes import Bool, Float


@dataclasses.dataclass(frozen=True, eq=False)
class RobotMotion:
  """Configurations qpos (T, 7 + N) of a robot, fps a second: root position, root quaternion (w, x, y, z), angles.

  planted (T, 2): whether the left and the right foot stand, where that is known; human, targets: the motion that it
  follows, and the targets of inverse kinematics that come from it, one a frame.
  """
  robot: Robot
  qpos: Float[np.ndarray, "t q"]
  fps: float
  planted: Bool[np.ndarray, "t 2"] | None = None
  captions: tuple[Caption, ...] = ()
  source: str = ""
  license: str = ""
  meta: dict[str, Any] = dataclasses.field(default_factory=dict)
  human: Clip | None = None
  targets: Sequence[Target] = ()

  @property
  def num_frames(self) -> int:
    return len(self.qpos)

  @property
  def seconds(self) -> float:
    return self.num_frames / self.fps

  @property
  def angles(self) -> Float[np.ndarray, "t n"]:
    """The angles (T, N) of all joints, radians, in MuJoCo's order."""
    return self.qpos[:, 7:]

  def velocities(self) -> Float[np.ndarray, "t v"]:
    """MuJoCo's qvel (T, 6 + N): root velocity in the world, its angular velocity in the body, angular speeds.

    Central differences; at the ends those of the neighbour.
    """
    import mujoco
    rows = np.zeros((self.num_frames, self.robot.model.nv))
    for t in range(self.num_frames):
      first, last = max(t - 1, 0), min(t + 1, self.num_frames - 1)
      if last > first:
        mujoco.mj_differentiatePos(self.robot.model, rows[t], (last - first) / self.fps, self.qpos[first],
                                   self.qpos[last])
    return rows

  def at_rate(self, fps: float) -> Self:
    """The same motion at another rate: root and angles linear in time, turns along the shortest arc."""
    if fps == self.fps:
      return self
    time = np.arange(int(np.floor((self.num_frames - 1) / self.fps * fps + 1e-6)) + 1) * self.fps / fps
    low = np.minimum(time.astype(int), max(self.num_frames - 2, 0))
    high = np.minimum(low + 1, self.num_frames - 1)
    part = (time - low)[:, None]
    qpos = self.qpos[low] * (1 - part) + self.qpos[high] * part
    qpos[:, 3:7] = rot.slerp(self.qpos[low, 3:7], self.qpos[high, 3:7], part[:, 0])
    planted = None if self.planted is None else self.planted[np.where(part[:, 0] < 0.5, low, high)]
    return dataclasses.replace(self, qpos=qpos, fps=fps, planted=planted, targets=())

  def figure(self) -> Figure:
    """The robot's shapes over time, as `export.video` and `export.strip` draw bodies."""
    from motion_jax.robots.picture import figure_of
    return figure_of(self)

  def to_clip(self) -> Clip:
    """HumanML3D's 22 joints at the places of the robot's bodies, metres, y up: to draw, extend and edit like any
    motion.

    The spine and the head lie on the axis of the torso, as a robot's torso is rigid.
    """
    robot = self.robot
    places, turned = robot.kinematics(self.qpos)
    of = lambda part: robot.place(part, places, turned)
    torso, axis = robot.turn("torso", turned), np.array([0.0, 0, 1])
    shoulders = (of("left_shoulder") + of("right_shoulder")) / 2
    hips = (of("left_hip") + of("right_hip")) / 2
    waist = hips + 0.25 * (shoulders - hips)
    up = rot.rotate(torso, np.broadcast_to(axis, shoulders.shape))
    height = np.linalg.norm(np.median(shoulders - hips, axis=0))
    joints = {"pelvis": waist, "spine1": hips + 0.45 * (shoulders - hips), "spine2": hips + 0.62 * (shoulders - hips),
              "spine3": hips + 0.75 * (shoulders - hips), "neck": shoulders + 0.15 * height * up,
              "head": shoulders + 0.4 * height * up}
    for (body, sole), side in zip(robot.soles(), SIDES):
      for ours in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist"):
        joints[f"{side}_{ours}"] = of(f"{side}_{ours}")
      level = rot.rotate(robot.rest[body][None], sole)
      front = np.array([level[:, 0].max(), np.median(level[:, 1]), level[:, 2].min()])
      joints[f"{side}_foot"] = places[:, body] + rot.rotate(robot.turn(f"{side}_ankle", turned), front[None])
      joints[f"{side}_collar"] = 0.7 * joints["spine3"] + 0.3 * of(f"{side}_shoulder")
    stacked = np.stack([joints[name] for name in HUMANML3D.joints], axis=1)
    return Clip(from_robot_axes(stacked).astype(np.float32), self.fps, self.captions, source=self.source,
                license=self.license, meta=dict(self.meta))
