"""Physical plausibility: jerk, sliding feet, floor, bones. Pure functions of joints (..., T, J, 3), y up.

Lengths are in the joints' unit (metres for HumanML3D). None of these is 0 for real motion: compare with the value of
real data. numpy arrays are computed in float64. jax arrays keep their dtype and work inside jit, vmap and grad, also as
losses; gradients are finite for a foot at rest, too. `skating_ratio` counts frames and has no gradient; minimise
`foot_speed` or `planted_speed` instead.
"""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.rotations import A
from motion_jax.motion.skeleton import HUMANML3D, Skeleton, facing
from motion_jax.motion.smoothing import moving_average
from motion_jax.shapes import Array, Float, Num

# Mean jerk of real transitions, the reference level of AUJ (FlowMDM's; docs/papers/cmdm.md#long-horizon).
REAL_JERK = {"humanml3d": 0.033031363, "babel": 0.016383045}


def jerk(joints: Num[A, "*lead t j 3"]) -> Float[A, "*lead t-3"]:
  """Jerk per frame, (..., T - 3): third difference, L1 norm over x, y, z, the largest over joints; no division by time.
  """
  return abs(_differences(joints, 3)).sum(-1).max(-1)


def jerk_curve(transitions: Num[A, "n w j 3"]) -> Float[A, " w-3"]:
  """Mean jerk at each frame of transitions (N, W, J, 3), aligned at their borders -> (W - 3,)."""
  transitions = rot.namespace(transitions).asarray(transitions)
  if transitions.ndim != 4 or not len(transitions):
    raise ValueError(f"got transitions of shape {transitions.shape}, expected (N, frames, joints, 3)")
  return jerk(transitions).mean(0)


def peak_jerk(curve: Num[Array, " w"]) -> float:
  """PJ: the maximum of a jerk curve."""
  return float(np.max(curve))


def area_under_jerk(curve: Num[Array, " w"], real: float = REAL_JERK["humanml3d"]) -> float:
  """AUJ: deviation of a jerk curve from the level of real motion, summed over frames."""
  return float(np.abs(np.asarray(curve, np.float64) - real).sum())


def cut_transitions(motion: Num[Array, " t *frame"], borders: Sequence[int] | np.ndarray, width: int = 60
                    ) -> Num[np.ndarray, "n {width} *frame"]:
  """Cuts the width frames of motion (T, ...) around each border (first frame of the next piece) -> (N, width, ...).

  Raises ValueError for a border too close to the ends.
  """
  half = width // 2
  bad = [border for border in borders if border < half or border + width - half > len(motion)]
  if bad:
    raise ValueError(f"got a border at frame {bad[0]} of {len(motion)}, {half} frames are needed on either side")
  return np.stack([motion[border - half:border + width - half] for border in borders])


def transition_distance(joints: Num[A, "t j 3"], borders: Sequence[int] | np.ndarray, skeleton: Skeleton = HUMANML3D
                        ) -> Float[A, " n"]:
  """Mean joint step into each border of joints (T, J, 3), in the body's frame (STMC's) -> (N,)."""
  joints, borders = _differences(joints, 0), np.asarray(borders)
  if len(borders) and not (0 < borders.min() and borders.max() < len(joints)):
    raise ValueError(f"got borders {borders.tolist()} in a motion of {len(joints)} frames, expected 1 to the last")
  local = in_body_frame(joints, skeleton)
  return rot.length(local[borders] - local[borders - 1]).mean(-1)


def in_body_frame(joints: Num[A, "t j 3"], skeleton: Skeleton = HUMANML3D) -> Float[A, "t j 3"]:
  """Joints (T, J, 3) relative to the pelvis, with the facing direction on +z in every frame."""
  ahead = facing(joints, skeleton)
  local = joints - joints[:, :1]
  x, z = ahead[:, None, 0], ahead[:, None, 2]
  return rot.namespace(joints).stack(
      [local[..., 0] * z - local[..., 2] * x, local[..., 1], local[..., 0] * x + local[..., 2] * z], -1)


def foot_speed(joints: Num[A, "*lead t j 3"], fps: float = 20.0, skeleton: Skeleton = HUMANML3D, low: float = 0.05,
               window: int = 5) -> Float[A, "*lead t-1 2"]:
  """Speed of each foot's toes over the ground while they are low, else 0: (..., T - 1, 2), left and right.

  Low: under `low` metres in both frames of a step. The speed is averaged over `window` steps, zeros outside the clip.
  """
  _, contact, mean = _foot_steps(joints, fps, skeleton, low, window)
  return contact * mean


def skating_ratio(joints: Num[A, "*lead t j 3"], fps: float = 20.0, skeleton: Skeleton = HUMANML3D,
                  low: float = 0.05, fast: float = 0.5, window: int = 5) -> Float[Array | np.floating, "*lead"]:
  """Share of steps (...,) with a sliding low foot: over `fast` m/s in the step and in the mean of `window` steps."""
  speed, contact, mean = _foot_steps(joints, fps, skeleton, low, window)
  return (contact & (speed > fast) & (mean > fast)).any(-1).mean(-1)


def planted_speed(joints: Num[A, "*lead t j 3"], fps: float = 20.0, skeleton: Skeleton = HUMANML3D,
                  low: float = 0.04) -> Float[Array | np.floating, "*lead"]:
  """Mean speed (...,) over the ground of the slowest ankle or toes while a foot is down.

  A standing or walking body always has a point at rest, whose speed is sliding. A foot is down while the lower toes are
  less than `low` metres above the 5th percentile of the lowest foot joint; 0 if none ever is.
  """
  joints = _of(skeleton, joints)
  xp: Any = rot.namespace(joints)
  feet = joints[..., list(skeleton.left_feet + skeleton.right_feet), :]
  toes = joints[..., [skeleton.left_feet[-1], skeleton.right_feet[-1]], 1].min(-1)
  speed = rot.length(_differences(feet, 1)[..., [0, 2]]).min(-1) * fps
  down = toes[..., 1:] < xp.percentile(feet[..., 1].min(-1), 5, axis=-1)[..., None] + low
  return (speed * down).sum(-1) / xp.maximum(down.sum(-1), 1)


def slide(joints: Num[A, "*lead t j 3"], skeleton: Skeleton = HUMANML3D, low: float = 0.05
          ) -> Float[Array | np.floating, "*lead"]:
  """Mean distance (...,) per frame over the ground of ankles and toes that are low in both frames of a step; else 0.

  Low: less than `low` metres above the floor y = 0. In millimetres this is PhysDiff's "skate" (arXiv:2212.02500).
  """
  feet = _of(skeleton, joints)[..., list(skeleton.left_feet + skeleton.right_feet), :]
  way = rot.length(_differences(feet, 1)[..., [0, 2]])
  down = feet[..., 1] < low
  both = down[..., 1:, :] & down[..., :-1, :]
  return (way * both).sum((-2, -1)) / rot.namespace(way).maximum(both.sum((-2, -1)), 1)


def foot_height(joints: Num[A, "*lead t j 3"], skeleton: Skeleton = HUMANML3D) -> Float[A, "*lead t"]:
  """Height of the lowest foot joint above the floor y = 0 in each frame, (..., T); negative below the floor."""
  return _of(skeleton, joints)[..., list(skeleton.left_feet + skeleton.right_feet), 1].min(-1)


def floating(joints: Num[A, "*lead t j 3"], skeleton: Skeleton = HUMANML3D) -> Float[Array | np.floating, "*lead"]:
  """Mean height (...,) of the lowest foot joint above the floor; a jump counts too, so compare with real motion."""
  height = foot_height(joints, skeleton)
  return rot.namespace(height).maximum(height, 0).mean(-1)


def penetration(joints: Num[A, "*lead t j 3"]) -> Float[Array | np.floating, "*lead"]:
  """Mean depth (...,) of the lowest joint below the floor y = 0."""
  joints = _differences(joints, 0)
  return rot.namespace(joints).maximum(-joints[..., 1].min(-1), 0).mean(-1)


def bone_drift(joints: Num[A, "*lead t j 3"], skeleton: Skeleton = HUMANML3D) -> Float[Array | np.floating, "*lead"]:
  """Mean deviation (...,) of bones from their mean length in the clip, over frames and bones."""
  joints = _of(skeleton, joints)
  child = [j for j, parent in enumerate(skeleton.parents) if parent >= 0]
  lengths = rot.length(joints[..., child, :] - joints[..., [skeleton.parents[j] for j in child], :])
  return abs(lengths - lengths.mean(-2, keepdims=True)).mean((-2, -1))


def acceleration(joints: Num[A, "*lead t j 3"], fps: float = 20.0) -> Float[Array | np.floating, "*lead"]:
  """Mean acceleration (...,) of joints, in their unit per second squared."""
  return (rot.length(_differences(joints, 2)) * fps**2).mean((-2, -1))


# Metrics in the rows of an evaluation: {name there: name in `summary`}.
IN_ROWS = {"skating": "skating_ratio", "planted_speed": "planted_speed", "foot_height": "floating_mm",
           "penetration": "penetration_mm", "bone_drift": "bone_drift_mm", "acceleration": "acceleration",
           "jerk": "jerk", "slide": "slide_mm", "largest_jerk": "peak_jerk"}


def summary(joints: Num[Array, "t j 3"], fps: float = 20.0, skeleton: Skeleton = HUMANML3D) -> dict[str, float]:
  """All physical metrics of one motion (T, J, 3) -> {name: number}, in millimetres, seconds and shares."""
  metres = np.asarray(joints, np.float64) * skeleton.unit
  return {"skating_ratio": float(skating_ratio(metres, fps, skeleton)),
          "planted_speed": float(planted_speed(metres, fps, skeleton)),
          "slide_mm": float(1000 * slide(metres, skeleton)),
          "floating_mm": float(1000 * floating(metres, skeleton)),
          "penetration_mm": float(1000 * penetration(metres)),
          "bone_drift_mm": float(1000 * bone_drift(metres, skeleton)),
          "acceleration": float(acceleration(metres, fps)),
          "jerk": float(jerk(metres).mean()), "peak_jerk": float(jerk(metres).max())}


def _of(skeleton, joints):
  """Joints in float64 (jax arrays in their own dtype), after checking their number."""
  joints = _differences(joints, 0)
  if joints.shape[-2] != skeleton.num_joints:
    raise ValueError(f"got {joints.shape[-2]} joints, skeleton {skeleton.name!r} has {skeleton.num_joints}; name the "
                     "skeleton that they are of")
  return joints


def _differences(joints, order):
  xp = rot.namespace(joints)
  joints = xp.asarray(joints, np.float64 if xp is np else None)
  if joints.ndim < 3 or joints.shape[-3] <= order or joints.shape[-1] != 3:
    raise ValueError(f"got joints of shape {joints.shape}, expected (..., frames, joints, 3) with {order + 1} frames "
                     "or more")
  return xp.diff(joints, n=order, axis=-3)


def _foot_steps(joints, fps, skeleton, low, window):
  """Left and right toes: (speed of each step, whether they are low at both its ends, mean speed around it)."""
  joints = _of(skeleton, joints)
  toes = joints[..., [skeleton.left_feet[-1], skeleton.right_feet[-1]], :]
  speed = rot.length(_differences(toes, 1)[..., [0, 2]]) * fps
  down = toes[..., 1] < low
  return speed, down[..., :-1, :] & down[..., 1:, :], moving_average(speed, window)
