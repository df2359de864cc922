"""Where DiP's targets are in a motion, and how far a prediction is from them (docs/papers/mdm.md#goals)."""
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from motion_jax.motion.representations import Representation
from motion_jax.motion.skeleton import facing
from motion_jax.shapes import Array

# In the order of the released weights. "path" is the pelvis on the ground, "heading" an angle in its first number.
GOALS = ("pelvis", "left_foot", "right_foot", "left_wrist", "right_wrist", "head", "path", "heading")
_PATH, _HEADING = GOALS.index("path"), GOALS.index("heading")
# What training draws from: one place with the heading, or nothing.
TRAINED = (("pelvis", "heading"), ("path", "heading"), ("right_wrist", "heading"), ("left_wrist", "heading"),
           ("right_foot", "heading"), ("left_foot", "heading"), ())


def places(joints: Float[jax.Array, "b t j 3"], layout: Representation) -> Float[jax.Array, "b 8 3"]:
  """The goals (B, 8, 3) that joints (B, T, J, 3) reach in their last frame, relative to where the motion begins."""
  names, last = layout.skeleton.joints, joints[:, -1]
  root, ahead = last[:, 0], facing(joints, layout.skeleton)[:, -1]
  rows = {"pelvis": root, "path": root * jnp.array([1, 0, 1], root.dtype),
          "heading": jnp.arctan2(ahead[:, 0], ahead[:, 2])[:, None] * jnp.array([1, 0, 0], root.dtype)}
  return jnp.stack([rows[goal] if goal in rows else last[:, names.index(goal)] for goal in GOALS], axis=1)


def goal_mask(goals: Sequence[Sequence[str]]) -> Bool[Array, "b 8"]:
  """Which goals count, from the names of each motion's."""
  return jnp.array([[goal in wanted for goal in GOALS] for wanted in goals])


def conditions(goals: Float[Array, "b 8 3"], counts: Bool[Array, "b 8"]) -> Float[Array, "b 8 4"]:
  """Goals as the network takes them: coordinates, 0 in training where they do not count, and whether they count."""
  return jnp.concatenate([goals, counts[..., None].astype(goals.dtype)], axis=-1)


def goal_error(found: Float[Array, "b 8 3"], wanted: Float[Array, "b 8 3"], counts: Bool[Array, "b 8"]
               ) -> Float[Array, " b"]:
  """Squared errors (B,) of the coordinates that count, averaged over these, and of the heading."""
  every: jax.Array = jnp.asarray(counts)[..., None] & jnp.ones(3, bool)
  every = every.at[:, _PATH, 1].set(False).at[:, _HEADING].set(False)
  square = jnp.where(every, (found - wanted) ** 2, 0.0).sum((1, 2)) / (every.sum((1, 2)) + 1e-8)
  # Parity: the reference wraps the angle modulo pi, so a body that faces the other way is right.
  turn = (found[:, _HEADING, 0] - wanted[:, _HEADING, 0] + jnp.pi / 2) % jnp.pi - jnp.pi / 2
  return square + jnp.where(counts[:, _HEADING], turn ** 2 / (1 + 1e-8), 0.0)
