"""Where DiP's targets are in a motion, how far a prediction is from them, and which ones constraints ask of a block
(docs/papers/mdm.md#goals)."""
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.motion.representations import Representation
from motion_jax.motion.rotations import rotate_about_y
from motion_jax.motion.skeleton import facing
from motion_jax.shapes import Array, Bool, Float, Int

# In the order of the released weights. "path" is the pelvis on the ground, "heading" an angle in its first number.
GOALS = ("pelvis", "left_foot", "right_foot", "left_wrist", "right_wrist", "head", "path", "heading")
_PATH, _HEADING = GOALS.index("path"), GOALS.index("heading")
# What training draws from: one place with the heading, or nothing.
TRAINED = (("pelvis", "heading"), ("path", "heading"), ("right_wrist", "heading"), ("left_wrist", "heading"),
           ("right_foot", "heading"), ("left_foot", "heading"), ())
_FAR = 0.5  # metres on the ground over which a body without a heading target faces where it goes


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


def drawn_goals(keys: jax.Array) -> Bool[jax.Array, "b 8"]:
  """Which goals count in training, drawn uniformly from `TRAINED` by a key for each motion."""
  return goal_mask(TRAINED)[jax.vmap(lambda key: jax.random.randint(key, (), 0, len(TRAINED)))(keys)]


def conditions(goals: Float[Array, "b 8 3"], counts: Bool[Array, "b 8"]) -> Float[Array, "b 8 4"]:
  """Goals as the network takes them: coordinates, 0 in training where they do not count, and whether they count."""
  return jnp.concatenate([goals, counts[..., None].astype(goals.dtype)], axis=-1)


def goal_error(predicted: Float[Array, "b 8 3"], target: Float[Array, "b 8 3"], counts: Bool[Array, "b 8"]
               ) -> Float[Array, " b"]:
  """Squared errors (B,) of the coordinates that count, averaged over these, and of the heading."""
  every: jax.Array = jnp.asarray(counts)[..., None] & jnp.ones(3, bool)
  every = every.at[:, _PATH, 1].set(False).at[:, _HEADING].set(False)
  square = jnp.where(every, (predicted - target) ** 2, 0.0).sum((1, 2)) / (every.sum((1, 2)) + 1e-8)
  # Parity: the reference wraps the angle modulo pi, so a body that faces the other way is right.
  turn = (predicted[:, _HEADING, 0] - target[:, _HEADING, 0] + jnp.pi / 2) % jnp.pi - jnp.pi / 2
  return square + jnp.where(counts[:, _HEADING], turn ** 2 / (1 + 1e-8), 0.0)


class Stand(NamedTuple):
  """Root transform at the start of a block, relative to the motion's start: x and z (B, 2), heading (B,) in radians."""
  place: Float[np.ndarray, "b 2"]
  heading: Float[np.ndarray, " b"]

  @classmethod
  def beginning(cls, batch: int) -> "Stand":
    return cls(np.zeros((batch, 2)), np.zeros(batch))

  def after(self, features: Float[np.ndarray, "b t f"], layout: Representation) -> "Stand":
    """The root transform after a block of features, not normalized."""
    turned, path = layout.root_path(np.concatenate([features, features[:, -1:]], axis=1))
    angle = -2 * np.arctan2(turned[..., 2], turned[..., 0])
    step = np.stack([rotate_about_y(moved, turn - first) for moved, turn, first in
                     zip(path[:, -1] - path[:, 0], self.heading, angle[:, 0])])[:, ::2]
    return Stand(self.place + step, self.heading + angle[:, -1] - angle[:, 0])


def goals_of_block(signal: ControlSignal, first: int, count: int, stand: Stand, layout: Representation
                   ) -> Float[np.ndarray, "b 8 4"]:
  """Goals by which constraints are met in the block of `count` frames from frame `first` on, relative to its start.

  A goal is where the last target of a joint within the block is; training has goals at the block's end. A pelvis or
  another joint whose next target lies in a later block is approached: the path on the ground counts, in proportion to
  the time. Without a heading target, which training has beside every goal, a body faces where it goes.
  """
  goals = np.zeros((signal.batch, len(GOALS), 4), np.float32)
  for row, targets in enumerate(goals):
    for goal, place in _targets(signal, row, first, count, stand, layout).items():
      targets[GOALS.index(goal)] = [*rotate_about_y(place, -stand.heading[row]), 1.0]
    turns = _given(np.asarray(signal.heading_given)[row], first, first + count)
    at = next((target[:3] for target in targets if target[3]), None)
    if len(turns):
      turn = float(np.asarray(signal.heading)[row, turns[-1]]) - stand.heading[row]
    elif at is not None:
      turn = np.arctan2(at[0], at[2]) if np.hypot(at[0], at[2]) > _FAR else 0.0
    else:
      continue
    targets[_HEADING] = [np.arctan2(np.sin(turn), np.cos(turn)), 0, 0, 1.0]
  return goals


def _given(flags: Bool[np.ndarray, " t"], first: int, stop: int | None = None) -> Int[np.ndarray, " n"]:
  """The frames from first on that have a target."""
  return np.flatnonzero(flags[first:stop]) + first


def _targets(signal, row, first, count, stand, layout):
  """{goal: (x, y, z) from where the block begins, in the directions of the motion} of one motion."""
  given, positions = np.asarray(signal.given)[row], np.asarray(signal.positions, np.float64)[row]
  targets, approached = {}, None
  for goal in dict.fromkeys(goal for goals in TRAINED for goal in goals if goal != "heading"):
    joint = 0 if goal == "path" else layout.skeleton.joints.index(goal)
    whole = given[:, joint].all(-1)
    flags = given[:, 0, 0] & given[:, 0, 2] & ~whole if goal == "path" else whole
    frames = _given(flags, first)
    if not len(frames):
      continue
    inside = frames[frames < first + count]
    frame = inside[-1] if len(inside) else frames[0]
    place = positions[frame, joint] - [stand.place[row][0], 0, stand.place[row][1]]
    if len(inside):
      targets[goal] = place * [1, goal != "path", 1]
    elif approached is None:
      approached = place * [1, 0, 1] * count / (frame - first + 1)
  if approached is not None and not targets:
    targets["path"] = approached
  return targets
