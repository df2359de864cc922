"""Constraints drawn at random from real motions, for training: what a network is to keep to, taken from what happened.

A pattern is some joints at some frames: the pelvis' path (more often than all else), the whole body, one hand, foot or
the head, or any few joints; at 1, 2 or 5 frames, at a quarter of them, at all, or at a stretch of them. Two patterns in
three draws stand alone, in the third two lie one over the other.
"""
import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from motion_jax.control.signal import NUM_JOINTS, ControlSignal
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.shapes import Array

PELVIS = 0
ENDS = jnp.array([HUMANML3D.joints.index(name) for name in
                  ("pelvis", "left_foot", "right_foot", "head", "left_wrist", "right_wrist")])
# Chances of the kinds of joints: the path, the whole body, one of ENDS, any few; and of the kinds of frames.
_JOINTS = jnp.log(jnp.array([0.45, 0.2, 0.2, 0.15]))
_FRAMES = jnp.log(jnp.array([0.05, 0.05, 0.1, 0.2, 0.5, 0.1]))  # 1, 2, 5, a quarter, all, a stretch


def draw_frames(key: jax.Array, count: Int[Array, ""], num_frames: Int[Array, ""], length: int
                ) -> Bool[Array, " {length}"]:
  """(length,): `count` of the first num_frames, drawn uniformly without replacement."""
  order = jnp.where(jnp.arange(length) < num_frames, jax.random.uniform(key, (length,)), 2.0)
  return (jnp.argsort(jnp.argsort(order)) < count) & (jnp.arange(length) < num_frames)


def _pattern(key, num_frames, length):
  """(given (length, J, 3), heading (length,))."""
  joint_key, end_key, few_key, frame_key, time_key, high_key, heading_key, stretch_key = jax.random.split(key, 8)
  joint = jnp.arange(NUM_JOINTS)
  kind = jax.random.categorical(joint_key, _JOINTS)
  joints = jnp.stack([joint == PELVIS, joint >= 0, joint == jax.random.choice(end_key, ENDS),
                      jax.random.bernoulli(few_key, 0.25, (NUM_JOINTS,))])[kind]
  how = jax.random.categorical(frame_key, _FRAMES)
  counts = jnp.stack([jnp.ones_like(num_frames), jnp.full_like(num_frames, 2), jnp.full_like(num_frames, 5),
                      jnp.maximum(num_frames // 4, 1), num_frames, num_frames])
  a, b = jnp.sort(jax.random.randint(stretch_key, (2,), 0, jnp.maximum(num_frames, 1)))
  frames = draw_frames(time_key, counts[how], num_frames, length)
  frames &= (how != 5) | ((jnp.arange(length) >= a) & (jnp.arange(length) <= b))
  flat = (kind == 0) & jax.random.bernoulli(high_key, 0.6)  # a path on the floor says no height
  given = (frames[:, None] & joints)[..., None] & (jnp.array([True, False, True]) | ~flat)
  return given, frames & (kind < 2) & jax.random.bernoulli(heading_key, 0.35)


def draw_constraints(joints: Float[Array, "b t j 3"], heading: Float[Array, "b t"], num_frames: Int[Array, " b"],
                     keys: jax.Array, rate: float) -> ControlSignal:
  """A signal of a share `rate` of motions, joints (B, T, 22, 3) of which num_frames (B,) are real, nothing of the
  others; keys (B,), one each."""
  length = joints.shape[1]

  def one(key, count):
    chosen, twice, first, second = jax.random.split(key, 4)
    given, faces = _pattern(first, count, length)
    more, faces_more = _pattern(second, count, length)
    both, any_at_all = jax.random.bernoulli(twice, 1 / 3), jax.random.bernoulli(chosen, rate)
    return (given | (more & both)) & any_at_all, (faces | (faces_more & both)) & any_at_all

  given, heading_given = jax.vmap(one)(keys, num_frames)
  return ControlSignal(jnp.where(given, joints, 0.0), given, jnp.where(heading_given, heading, 0.0), heading_given)
