"""What a body can do of what is asked: too fast a path is slowed down, too high a hand comes down, and it is told."""
import warnings

import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.motion.skeleton import HUMANML3D

FASTEST = 7.0   # metres a second: a sprint
_MISSED = 0.01  # metres off a target that are told
_JUMP = 0.4     # metres that a body may leave the ground
_CLIMB = 3.0    # metres over the ground that a whole pose may be: on stairs, a table, a ladder
_SUNK = 0.02    # metres below the floor at which a joint is still taken for on it


def possible(signal: ControlSignal, fps: float = 20.0, tell: bool = True) -> ControlSignal:
  """The nearest signal (1, T) that a body can follow: no faster than 7 m/s, no higher than it reaches, not under the
  floor. A whole pose is moved up or down as it is. tell: a warning names the worst frame of each."""
  positions, given = np.array(signal.positions, np.float32), np.asarray(signal.given)
  said: list[str] = []
  whole = given[0].all((-1, -2))
  highest = _highest() + _CLIMB * whole[:, None]
  for bounds, over, words in ((highest, 1, "higher than a body reaches"), (np.full_like(highest, -_SUNK), -1,
                                                                          "under the floor")):
    beyond = np.where(given[0, ..., 1], over * (positions[0, ..., 1] - bounds), 0)
    if beyond.max() > 0:
      frame, joint = np.unravel_index(beyond.argmax(), beyond.shape)
      said.append(f"{HUMANML3D.joints[joint]} is asked to be at a height of {positions[0, frame, joint, 1]:.2f} m at "
                  f"{frame / fps:.2f} s (frame {frame}), {words}: {bounds[frame, joint]:.2f} m is as near as it comes")
      positions[0, whole, :, 1] -= over * np.maximum(beyond[whole].max(-1, keepdims=True), 0)
      clipped = np.minimum(positions[0, ..., 1], bounds) if over > 0 else np.maximum(positions[0, ..., 1], bounds)
      positions[0, ..., 1] = np.where(given[0, ..., 1], clipped, positions[0, ..., 1])
  for joint in range(22):
    frames = np.flatnonzero(given[0, :, joint][:, [0, 2]].all(-1))
    said += _slowed(positions[0, :, joint], frames, fps, joint) if len(frames) > 1 else []
  if tell:
    for words in said:
      warnings.warn(words + "; the nearest possible motion is made", stacklevel=3)
  return signal.replace(positions=positions)


def _highest() -> np.ndarray:
  """How high (22,) each joint comes of a body that jumps, stretched out."""
  chains = HUMANML3D.chains
  leg = HUMANML3D.bone_lengths[list(chains[0])].sum()
  above = np.zeros(22)
  for chain in chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      above[joint] = above[parent] + HUMANML3D.bone_lengths[joint]
  return leg + above + _JUMP


def _slowed(places: np.ndarray, frames: np.ndarray, fps: float, joint: int) -> list[str]:
  """Brings places (T, 3) in the given frames within reach of one another over the ground, in place -> what to say."""
  fastest = FASTEST * (1.0 if joint == 0 else 2.5)  # a hand or a foot is flung
  ground = [0, 2]
  steps = np.linalg.norm(np.diff(places[frames][:, ground].astype(np.float64), axis=0), axis=-1)
  speed = steps * fps / np.diff(frames)
  if not (speed > fastest).any():
    return []
  worst = int(speed.argmax())
  for before, now in zip(frames[:-1], frames[1:]):
    away = places[now, ground] - places[before, ground]
    most = fastest * (now - before) / fps
    places[now, ground] = places[before, ground] + away * min(1.0, most / max(float(np.linalg.norm(away)), 1e-9))
  return [f"{HUMANML3D.joints[joint]} is asked to go at {speed[worst]:.1f} m/s to where it is at "
          f"{frames[worst + 1] / fps:.2f} s (frame {frames[worst + 1]}), more than {fastest:g} m/s"]


def tell_missed(signal: ControlSignal, off: np.ndarray, fps: float = 20.0) -> None:
  """Warns of the worst frame where a motion's joints are off (T, 22) metres from what a signal (1, T) asks for."""
  if off.size and off.max() > _MISSED:
    frame, joint = np.unravel_index(off.argmax(), off.shape)
    count = int((off.max(1) > _MISSED).sum())
    warnings.warn(f"{HUMANML3D.joints[joint]} misses where it is asked to be at {frame / fps:.2f} s (frame {frame}) by "
                  f"{off[frame, joint]:.2f} m, the worst of {count} frame(s): what is asked for cannot be met "
                  "together, or by the bones of a body; the nearest possible motion is made", stacklevel=3)
