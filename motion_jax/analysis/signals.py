"""Signals of a motion for event rules: speeds, heading, joint angles, standing feet; each computed once."""
import functools

import numpy as np

from motion_jax.motion.contacts import feet_stand, velocity
from motion_jax.motion.retarget import floor_height
from motion_jax.motion.skeleton import HUMANML3D, SIDES, facing
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.shapes import Float

JOINT = {name: number for number, name in enumerate(HUMANML3D.joints)}
PAIR = {part: [JOINT[f"{side}_{part}"] for side in SIDES] for part in
        ("hip", "knee", "ankle", "foot", "shoulder", "elbow", "wrist")}


class Body:
  """Joints (T, 22, 3) with signals as cached properties."""

  def __init__(self, joints: Float[np.ndarray, "t 22 3"], fps: float) -> None:
    self.joints, self.fps, self.num = joints, fps, len(joints)
    self.floor = float(floor_height(joints))

  @functools.cached_property
  def stands(self) -> np.ndarray:
    """Whether the left and the right foot stand, by ankle or toes, (T, 2)."""
    flags = feet_stand(self.joints, self.fps, floor=self.floor)
    return np.stack([flags[:, :2].any(1), flags[:, 2:].any(1)], 1)

  @functools.cached_property
  def path(self) -> np.ndarray:
    """Path of the pelvis over the ground without the sway of the steps, (T, 2): x, z."""
    return self.smooth(self.joints[:, 0][:, [0, 2]], 0.2)

  @functools.cached_property
  def speed(self) -> np.ndarray:
    return np.linalg.norm(np.gradient(self.path, axis=0), axis=-1) * self.fps

  @functools.cached_property
  def heading(self) -> np.ndarray:
    """Heading, radians to the left, unwrapped, (T,)."""
    ahead = self.smooth(facing(self.joints), 0.25)
    return np.unwrap(np.arctan2(ahead[:, 0], ahead[:, 2]))

  @functools.cached_property
  def toes(self) -> np.ndarray:
    """Speed (T, 2) of the toes relative to the pelvis, metres a second."""
    return np.linalg.norm(velocity(self.joints[:, PAIR["foot"]] - self.joints[:, :1], self.fps), axis=-1)

  @functools.cached_property
  def knees(self) -> np.ndarray:
    """Angle (T, 2) of each knee, 180 degrees for a straight leg."""
    return self._angle("hip", "knee", "ankle")

  @functools.cached_property
  def elbows(self) -> np.ndarray:
    return self._angle("shoulder", "elbow", "wrist")

  @functools.cached_property
  def trunk(self) -> np.ndarray:
    """Angle (T,) of the trunk from upright, degrees."""
    line = self.joints[:, JOINT["neck"]] - self.joints[:, 0]
    return np.degrees(np.arccos(np.clip(line[:, 1] / np.linalg.norm(line, axis=-1), -1, 1)))

  @functools.cached_property
  def pelvis(self) -> np.ndarray:
    """Height (T,) of the pelvis over the floor."""
    return self.joints[:, 0, 1] - self.floor

  @functools.cached_property
  def air(self) -> np.ndarray:
    """Height (T,) of the lowest joint of the feet over the floor."""
    return self.joints[:, PAIR["ankle"] + PAIR["foot"], 1].min(1) - self.floor

  def local(self, part: str, base: str) -> np.ndarray:
    """Joints of both sides relative to those of base, (T, 2, 3), in the body's axes: left, up, ahead."""
    vector = self.joints[:, PAIR[part]] - self.joints[:, PAIR[base]]
    sin, cos = np.sin(self.heading)[:, None], np.cos(self.heading)[:, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    return np.stack([x * cos - z * sin, y, x * sin + z * cos], -1)

  def smooth(self, values: np.ndarray, seconds: float) -> np.ndarray:
    return gaussian_filter1d(values, seconds * self.fps, axis=0, mode="nearest")

  def spans(self, flags: np.ndarray, least: float = 0.0, gap: float = 0.0) -> list[tuple[int, int]]:
    """(first, past) of the runs of flags (T,), joined over gaps of up to `gap` seconds, of at least `least` seconds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    runs: list[list[int]] = []
    for first, past in zip(edges[::2], edges[1::2]):
      if runs and first - runs[-1][1] <= gap * self.fps:
        runs[-1][1] = int(past)
      else:
        runs.append([int(first), int(past)])
    return [(first, past) for first, past in runs if past - first >= least * self.fps]

  def _angle(self, upper: str, middle: str, lower: str) -> np.ndarray:
    a = self.joints[:, PAIR[upper]] - self.joints[:, PAIR[middle]]
    b = self.joints[:, PAIR[lower]] - self.joints[:, PAIR[middle]]
    cosine = (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-9)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def course_of(path: Float[np.ndarray, "t 2"]) -> np.ndarray:
  """Direction (T,) of a path over the ground (x and z, T >= 2), degrees, unwrapped, positive to the left."""
  step = np.gradient(path, axis=0)
  return np.degrees(np.unwrap(np.arctan2(step[:, 0], step[:, 1])))


def turning_points(values: Float[np.ndarray, " t"], least: float) -> np.ndarray:
  """Frames of the local extrema of values that differ by more than `least`, with both ends."""
  points, extreme, rising = [0], 0, None
  for index, value in enumerate(values):
    if rising is None:
      if abs(value - values[0]) > least:
        rising, extreme = value > values[0], index
    elif (value > values[extreme]) == rising:
      extreme = index
    elif abs(value - values[extreme]) > least:
      points.append(extreme)
      extreme, rising = index, not rising
  return np.array(points + [extreme if rising is not None else len(values) - 1])
