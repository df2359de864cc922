"""Human motion onto robots, and robots' files in and out. Needs the extra `robot`.

  robot = robots.load("g1")                      Unitree G1, or an MJCF or URDF file with a mapping
  motion = robots.retarget(clip, robot)          inverse kinematics, 50 frames a second
  robots.Stream(robot, fps).push(joints)         the same of a live stream, block by block
  robots.write(motion, "walk", "unitree_xyzw")   walk.unitree_xyzw.csv and a .json that says what it holds
  robots.report(motion, clip).lines()            errors, limits, slide
  robots.read_csv("walk.csv", robot).to_clip()   back to 22 joints, to draw, extend or edit; read_npz reads .npz
"""
from motion_jax.robots.description import PARTS
from motion_jax.robots.formats import FORMATS, read_csv, write
from motion_jax.robots.motion import RobotMotion
from motion_jax.robots.npz import is_robots, read_npz
from motion_jax.robots.report import Report
from motion_jax.robots.report import of as report
from motion_jax.robots.retargeting import RATE, Stream, retarget
from motion_jax.robots.robot import SHIPPED, Robot, load

__all__ = ["FORMATS", "PARTS", "RATE", "SHIPPED", "Report", "Robot", "RobotMotion", "Stream", "is_robots", "load",
           "read_csv", "read_npz", "report", "retarget", "write"]
