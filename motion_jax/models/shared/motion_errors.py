"""Errors of decoded motion, as losses of any method: jitter, slowed punches, sliding feet, wrong bones.

They are computed on joints in metres, from decoded features, not on the features themselves: there the wrist of a fast
punch is one of many columns, and whether a foot stands depends on the sum of the root's step and the foot's own.
"""
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from ml_collections import ConfigDict

from motion_jax.motion.contacts import LOW, feet_stand
from motion_jax.motion.representations import get_layout
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.stats import Stats
from motion_jax.shapes import Array, Bool, Float, Num

NAMES = ("acceleration", "extremity_velocity", "foot_contact", "brief_contact", "bone_length", "limb_direction",
         "dynamics")
STATS = "stats"  # the name of mean and std of the features among the frozen parts of a stage
_STILL = (0.02, 0.2, 4.0)  # m/s, m/s^2, m/s^3: added inside the logarithms of `_dynamics`; smaller sizes hardly count
_SPANS = (0.4, 1.6)        # seconds: the windows of its means
_TOGETHER = 10.0           # weight of ratios of neighbouring joints and of orders, which vary little in real motion
_TOUCHES = 1.0   # m/s: a foot near the ground that is slower touches it, as in running; at 20 frames a second


def motion_errors(predicted: Num[Array, "b t j 3"], real: Num[Array, "b t j 3"],
                  frame_mask: Bool[Array, "b t"] | None = None, skeleton: Skeleton = HUMANML3D,
                  fps: float | None = None) -> dict[str, Float[Array, " b"]]:
  """Mean squared errors (B,) of how a decoded motion `predicted` (B, T, J, 3) moves, per clip and by name.

  acceleration: of all joints, (m/s^2)^2.
  extremity_velocity: of wrists, ankles and toes, velocity error plus speed error, (m/s)^2. A latent stands for several
  motions; their mean is slower than each, which the speed error shows.
  foot_contact: decoded velocity of ankles and toes that stand in the real motion (`contacts.feet_stand`, floor at 0),
  (m/s)^2; 0 elsewhere.
  brief_contact: velocity error of ankles and toes that touch the ground for a moment, (m/s)^2: near it and slower than
  1 m/s in the real motion, but too briefly for `feet_stand`, as in running.
  bone_length: of all bones, m^2. The mean of possible joint positions is too near the parent, so feet and legs shrink.
  limb_direction: of the directions of all bones, unit vectors; keeps bone_length from lengthening feet downwards.
  dynamics: of the logarithms of mean speed, acceleration and jerk of each joint, in the world and relative to the
  pelvis, over windows of 0.4 and 1.6 s; plus ten times that of their ratios between a joint and its parent, and between
  orders. MSE oversmooths and upsampling adds jitter; both are below the millimetre scale of other losses.

  frame_mask (B, T): real frames, no padding; a difference counts if all of its frames are real.
  """
  fps = fps or skeleton.fps
  feet = jnp.array(skeleton.left_feet + skeleton.right_feet)
  wrists = jnp.array([j for j, name in enumerate(skeleton.joints) if name.endswith("wrist")])
  if frame_mask is None:
    frame_mask = jnp.ones(real.shape[:2], bool)
  else:  # padding may hold NaN
    predicted, real = (jnp.where(frame_mask[..., None, None], a, 0.0) for a in (predicted, real))
  stands = jax.vmap(lambda joints: feet_stand(joints, fps, skeleton, floor=0.0))(real)
  error, step = predicted - real, lambda a: jnp.diff(a, axis=1) * (fps * skeleton.unit)
  both = frame_mask[:, 1:] & frame_mask[:, :-1]
  ends = jnp.concatenate([wrists, feet])
  decoded, given = step(predicted[:, :, ends]), step(real[:, :, ends])
  both_stand = stands[:, 1:] & stands[:, :-1]
  sliding = jnp.where(both_stand[..., None], step(predicted[:, :, feet]), 0.0)
  low = real[:, :, feet, 1] * skeleton.unit < LOW
  touches = low[:, 1:] & low[:, :-1] & ~both_stand & (_length(step(real[:, :, feet]))[..., 0] < _TOUCHES)
  slipping = jnp.where(touches[..., None], step(error[:, :, feet]), 0.0)
  return {"acceleration": _mean_square(jnp.diff(step(error), axis=1) * fps, both[:, 1:] & both[:, :-1]),
          "extremity_velocity": _mean_square(
              jnp.concatenate([decoded - given, _length(decoded) - _length(given)], -1), both),
          "foot_contact": _mean_square(sliding, both), "brief_contact": _mean_square(slipping, both),
          "bone_length": _mean_square(_bones(predicted, skeleton) - _bones(real, skeleton), frame_mask),
          "limb_direction": _mean_square(_directions(predicted, skeleton) - _directions(real, skeleton), frame_mask),
          "dynamics": _dynamics(predicted, real, frame_mask, fps, skeleton)}


def _directions(joints, skeleton):
  """Directions (B, T, J - 1, 3) of the bones of joints (B, T, J, 3)."""
  bones = joints[:, :, 1:] - joints[:, :, jnp.array(skeleton.parents[1:])]
  return bones / _length(bones, 1e-3 / skeleton.unit)


def _dynamics(decoded, real, frame_mask, fps, skeleton):
  """Mean square (B,) of the differences in the logarithms of mean speeds, accelerations and jerks, and `_TOGETHER`
  times that of how they differ between a joint and its parent, and between one order and the next."""
  seen = lambda joints: jnp.concatenate([joints, joints[:, :, 1:] - joints[:, :, :1]], axis=2) * skeleton.unit
  decoded, real, orders = seen(decoded), seen(real), len(_STILL)
  count = max(decoded.shape[1] - orders, 0)  # frames of all orders alike
  counts = jnp.stack([frame_mask[:, k:k + count] for k in range(orders + 1)]).all(0)
  parents = np.array(skeleton.parents[1:])
  joint = np.arange(1, len(parents) + 1)
  below = np.concatenate([joint, len(parents) + joint[parents > 0]])  # over the ground, then seen from the pelvis
  above = np.concatenate([parents, len(parents) + parents[parents > 0]])
  sizes = []
  for still in _STILL:
    decoded, real = (jnp.diff(joints, axis=1) * fps for joints in (decoded, real))
    sizes.append([_length(joints[:, :count], 0.1 * still)[..., 0] for joints in (decoded, real)])
  total = jnp.zeros(len(frame_mask), real.dtype)
  for span in _SPANS:
    width = max(min(round(span * fps), count), 1)
    whole = _means(counts[..., None].astype(real.dtype), width)[..., 0] > 1 - 0.5 / width  # no frame of padding
    off = jnp.stack([jnp.log((_means(a, width) + still) / (_means(b, width) + still))
                     for (a, b), still in zip(sizes, _STILL)], -1)
    square = sum(weight * (differences ** 2).mean((2, 3)) for differences, weight in (
        (off, 1.0), (off[:, :, below] - off[:, :, above], _TOGETHER), (jnp.diff(off, axis=-1), _TOGETHER)))
    total += jnp.where(whole, square, 0.0).sum(1) / jnp.maximum(whole.sum(1), 1)
  return total / len(_SPANS)


def _means(values, width):
  """Means over all windows of width frames, half overlapping, of values (B, T, N) -> (B, W, N)."""
  step = max(width // 2, 1)
  sums = jax.lax.reduce_window(values, 0.0, jax.lax.add, (1, width, 1), (1, step, 1), "valid")
  return sums / width


def _bones(joints, skeleton):
  """Lengths (B, T, J - 1, 1), in metres, of the bones of joints (B, T, J, 3)."""
  return skeleton.unit * _length(joints[:, :, 1:] - joints[:, :, jnp.array(skeleton.parents[1:])], 1e-4 / skeleton.unit)


def _length(vectors, least=0.01):
  """Lengths (..., 1) of vectors (..., 3), by default velocities; smooth, with a gradient, where they are 0."""
  return jnp.sqrt((vectors ** 2).sum(-1, keepdims=True) + least ** 2)


def _mean_square(vectors, mask):
  """Mean squared length (B,) of vectors (B, T, N, K), over N and the frames of mask (B, T)."""
  square = (vectors ** 2).sum(-1).mean(-1)
  return jnp.where(mask, square, 0.0).sum(1) / jnp.maximum(mask.sum(1), 1)


def weights(loss_config: ConfigDict) -> dict[str, float]:
  """{name: weight} of the terms to which a config's section loss gives a weight other than 0."""
  return {name: loss_config[name] for name in NAMES if loss_config.get(name)}


def frozen_stats(config: ConfigDict, stats: Stats) -> dict[str, Any]:
  """Mean and std of the features as a frozen part of a stage, for these terms, for constraints and for a critic; {}
  where the config has none."""
  wanted = weights(config.loss) or config.data.get("control") or config.loss.get("critic")
  return {STATS: {"mean": stats.mean, "std": stats.std}} if wanted else {}


def of_features(config: ConfigDict, frozen: Mapping[str, Any]) -> Callable | None:
  """errors(decoded, features, frame_mask=None) of normalized features (B, T, F): those of `motion_errors` that
  config.loss gives a weight; None where it gives none."""
  wanted, layout = weights(config.loss), get_layout(config.data.layout)
  if not wanted:
    return None
  mean, std = frozen[STATS]["mean"], frozen[STATS]["std"]

  def errors(decoded, features, frame_mask=None):
    decoded_joints, real_joints = (layout.to_joints(x * std + mean) for x in (decoded, features))
    losses = motion_errors(decoded_joints, real_joints, frame_mask, layout.skeleton, layout.fps)
    return {name: losses[name] for name in wanted}

  return errors
