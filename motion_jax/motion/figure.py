"""A body as capsules that renderers draw: a person (`export.body`) or a robot (`robots.picture`)."""
from typing import NamedTuple

import numpy as np

from motion_jax.motion.pose import Pose
from motion_jax.motion.skeleton import Skeleton

# Colours by limb, sRGB 0..1: right warm, left cool, the middle neutral; joints and hands a shade darker.
COLORS = {"middle": (0.60, 0.63, 0.70), "right": (0.93, 0.46, 0.30), "left": (0.20, 0.55, 0.80),
          "head": (0.80, 0.80, 0.82), "dark": (0.33, 0.36, 0.43)}


class BodyPart(NamedTuple):
  """The hull of a ball at joint a and one at joint b; the offsets turn with the joint `frame`. Metres."""
  a: int
  b: int
  a_offset: tuple
  b_offset: tuple
  frame: int
  a_radius: float
  b_radius: float
  group: str


class Figure(NamedTuple):
  """A clip ready to draw, metres, P parts: their balls a and b over time, and what the ground needs to know."""
  skeleton: Skeleton
  joints: np.ndarray  # (T, J, 3)
  pose: Pose
  parts: tuple[BodyPart, ...]
  a: np.ndarray       # (T, P, 3)
  b: np.ndarray       # (T, P, 3)
  ahead: np.ndarray   # (T, 3) unit vectors on the ground: where the pelvis faces
  floor: float        # height of the ground: 0, unless the recording plainly has its own elsewhere
  skinned: bool = True  # drawn as the mannequin's skin; False: as its parts are
