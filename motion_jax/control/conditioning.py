"""Network inputs from a `ControlSignal`, per latent: the targets in the latent's frames, and the next goals ahead.

Everything is relative to a *reference path*, which depends on the targets only: straight lines between the targets of
the pelvis (or, if it has none, of other joints), beginning at the origin, with the likely heading of the body: heading
targets, target hips and shoulders, else the direction of the path. Goals ahead are needed because a causal latent
cannot attend to the later latents that hold them. No feature grows with the length of a motion: a stream gets the same
numbers as a short clip. In training the targets are sampled from the motion: `draw_constraints`.
"""
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.control.signal import NUM_JOINTS, ControlSignal
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.shapes import Array, Bool, Float, Int

FPS = HUMANML3D.fps
HORIZON = 160          # frames; targets farther ahead are omitted
AHEAD = (10, 20, 40)   # frames ahead at which the reference path is a feature
# Mean positions of joints relative to the floor below the pelvis, metres to the left, ahead and up, and their standard
# deviations: of the training clips of CMU and Bandai, rounded and symmetric.
_USUAL = np.array([
    [0.00, 0.00, 0.95], [0.06, 0.00, 0.87], [-0.06, 0.00, 0.87], [0.00, -0.01, 1.08], [0.08, 0.08, 0.50],
    [-0.08, 0.08, 0.50], [0.00, 0.00, 1.23], [0.08, -0.08, 0.12], [-0.08, -0.08, 0.12], [0.00, 0.00, 1.28],
    [0.09, 0.02, 0.03], [-0.09, 0.02, 0.03], [0.00, 0.02, 1.49], [0.07, 0.01, 1.40], [-0.07, 0.01, 1.40],
    [0.00, 0.04, 1.59], [0.19, -0.02, 1.41], [-0.19, -0.02, 1.41], [0.29, -0.01, 1.25], [-0.29, -0.01, 1.25],
    [0.30, 0.10, 1.18], [-0.30, 0.10, 1.18]], np.float32)
_STRAYS = np.array([0.05, 0.05, 0.05, 0.05, 0.08, 0.08, 0.05, 0.10, 0.10, 0.05, 0.12, 0.12, 0.06, 0.05, 0.05, 0.07,
                    0.06, 0.06, 0.11, 0.11, 0.20, 0.20], np.float32)
_REACH, _MOVES = 5, 0.15  # frames on both sides, and least distance between them, metres, that define a direction


class Reference(NamedTuple):
  """The reference path: positions (B, T, 2) on the floor, headings (B, T); known (B, T): up to the last target."""
  place: Float[Array, "b t 2"]
  heading: Float[Array, "b t"]
  known: Bool[Array, "b t"]


def size(frames_per_latent: int = 4) -> int:
  """The number of features of a latent."""
  return 1 + frames_per_latent * (NUM_JOINTS * 5 + 5) + 2 + (3 + 4) + NUM_JOINTS * 5 + 5 * len(AHEAD) + (3 + 4)


def _around(defined: Bool[Array, "b t"]) -> tuple[Int[Array, "b t"], Int[Array, "b t"]]:
  """(last defined frame at or before each frame, -1 if none; next defined frame at or after it, T if none)."""
  index = jnp.arange(defined.shape[1])
  return (jax.lax.cummax(jnp.where(defined, index, -1), axis=1),
          jax.lax.cummin(jnp.where(defined, index, defined.shape[1]), axis=1, reverse=True))


def _at(values, index):
  """Values (B, T, ...) at frames index (B, N), clipped to the ends."""
  index = jnp.clip(index, 0, values.shape[1] - 1).reshape(index.shape + (1,) * (values.ndim - 2))
  return jnp.take_along_axis(values, index, axis=1)


def _wrapped(angle):
  return jnp.arctan2(jnp.sin(angle), jnp.cos(angle))


def _between(values, defined, angles=False):
  """Linear interpolation of values (B, T, ...) between defined frames, frame 0 among them; constant after the last."""
  before, after = _around(defined)
  first, last = _at(values, before), _at(values, jnp.where(after < defined.shape[1], after, before))
  share = (jnp.arange(defined.shape[1]) - before) / jnp.maximum(after - before, 1)
  way = _wrapped(last - first) if angles else last - first
  return first + share.reshape(share.shape + (1,) * (values.ndim - 2)) * way


def _turned(vectors, heading):
  """Vectors (..., 2), x and z in the world, in the frame of a body with this heading (...)."""
  x, z = vectors[..., 0], vectors[..., 1]
  cos, sin = jnp.cos(heading), jnp.sin(heading)
  return jnp.stack([x * cos - z * sin, x * sin + z * cos], axis=-1)


def _floor(signal):
  """(B, T, J): whether both x and z of a joint are given; only guidance and projection use one alone."""
  return signal.given[..., 0] & signal.given[..., 2]


def reference(signal: ControlSignal, start: Float[Array, "b 3"] | None = None) -> Reference:
  """The reference path of a signal. start: x, z and heading of its first frame, by default 0."""
  flat, floor = signal.positions[..., ::2], _floor(signal)
  frames = floor.shape[1]
  start = jnp.zeros((floor.shape[0], 3)) if start is None else start
  first = jnp.arange(frames) == 0
  count = floor.sum(-1)
  others = jnp.where(floor[..., None], flat, 0.0).sum(2) / jnp.maximum(count, 1)[..., None]
  given = count > 0
  values = jnp.where(floor[..., :1], flat[:, :, 0], others)
  place = _between(jnp.where((first & ~given)[..., None], start[:, None, :2], values), given | first)

  (right_hip, left_hip), (right_shoulder, left_shoulder) = HUMANML3D.hips, HUMANML3D.shoulders
  trunk = jnp.array([right_hip, left_hip, right_shoulder, left_shoulder])
  shows = floor[..., trunk].all(-1)
  across = (flat[:, :, trunk] * jnp.array([1, -1, 1, -1])[:, None]).sum(2)
  index = jnp.broadcast_to(jnp.arange(frames), given.shape)
  way = _at(place, index + _REACH) - _at(place, index - _REACH)
  moves = (way ** 2).sum(-1) > _MOVES ** 2
  angle = lambda x, z: jnp.arctan2(x, jnp.where((x == 0) & (z == 0), 1.0, z))
  heading = jnp.where(moves, angle(way[..., 0], way[..., 1]), start[:, 2:])
  heading = jnp.where(shows, angle(across[..., 1], -across[..., 0]), heading)
  heading = jnp.where(signal.heading_given, signal.heading, heading)
  heading = _between(heading, moves | shows | signal.heading_given | first, angles=True)
  goal = _around(given | signal.heading_given)[1]
  return Reference(place, heading, (goal < frames) & (goal - index <= HORIZON))


def _joints(signal, path):
  """Targets of joints (B, T, 5 J): standardized positions relative to the reference path, and flags of floor position
  and height; 0 for absent targets."""
  floor, height = _floor(signal), signal.given[..., 1]
  around = _turned(signal.positions[..., ::2] - path.place[:, :, None], path.heading[..., None])
  around, above = (around - _USUAL[:, :2]) / _STRAYS[:, None], (signal.positions[..., 1] - _USUAL[:, 2]) / _STRAYS
  parts = jnp.concatenate([jnp.where(floor[..., None], around, 0.0), jnp.where(height, above, 0.0)[..., None],
                           floor[..., None], height[..., None]], axis=-1)
  return parts.reshape(parts.shape[:2] + (-1,))


def _seen(path, here, there, visible):
  """(B, L, 4): position and heading of the reference at frames there (B, L), relative to frames here; 0 if not visible.
  """
  heading = _at(path.heading, here)
  turn = _at(path.heading, there) - heading
  parts = jnp.concatenate([_turned(_at(path.place, there) - _at(path.place, here), heading),
                           jnp.stack([jnp.sin(turn), jnp.cos(turn)], -1)], -1)
  return jnp.where(visible[..., None], parts, 0.0)


def features(signal: ControlSignal, frames_per_latent: int = 4, start: Float[Array, "b 3"] | None = None
             ) -> Float[Array, "b l n"]:
  """Features (B, T / frames_per_latent, `size`) of each latent; 0 without targets in its frames or ahead.

  start: see `reference`.
  """
  ref, frames = reference(signal, start), signal.given.shape[1]
  rows = lambda x: x.reshape((x.shape[0], frames // frames_per_latent, -1))
  last = jnp.broadcast_to(jnp.arange(frames // frames_per_latent) * frames_per_latent + frames_per_latent - 1,
                          (signal.given.shape[0], frames // frames_per_latent))

  def goal(given):
    """(next given frame (B, L) after a latent's frames, whether within the horizon, features of its time (B, L, 3))."""
    at = _at(_around(jnp.pad(given, ((0, 0), (0, 1))))[1], last + 1)
    visible = (at < frames) & (at - last <= HORIZON)
    seconds = (at - last) / FPS
    return at, visible, jnp.where(visible[..., None], jnp.stack(
        [jnp.ones_like(seconds), seconds / 4, jnp.exp(-seconds)], -1), 0.0)

  joints = _joints(signal, ref)
  step = _turned(jnp.diff(ref.place, axis=1, append=ref.place[:, -1:]), ref.heading) * FPS
  turn = _wrapped(jnp.diff(ref.heading, axis=1, append=ref.heading[:, -1:])) * FPS
  both = ref.known & jnp.roll(ref.known, -1, axis=1).at[:, -1].set(False)
  path = jnp.where(both[..., None], jnp.concatenate([step, turn[..., None]], -1), 0.0)
  frames_own = jnp.concatenate([joints, path, both[..., None], signal.heading_given[..., None]], -1)
  place, visible_place, time_of_place = goal(_floor(signal).any(-1) | signal.heading_given)
  body, visible_body, time_of_body = goal(signal.given[:, :, 1:].any((-1, -2)))
  facing = _at(ref.heading, last)
  parts = [rows(frames_own), jnp.stack([jnp.sin(facing), jnp.cos(facing)], -1),
          time_of_place, _seen(ref, last, place, visible_place), time_of_body,
          _seen(ref, last, body, visible_body), jnp.where(visible_body[..., None], _at(joints, body), 0.0)]
  for count in AHEAD:
    visible = (last + count < frames) & _at(ref.known, last + count)
    parts += [_seen(ref, last, last + count, visible), visible[..., None]]
  something = rows(ref.known | signal.given.any((-1, -2))).any(-1, keepdims=True) | (
      visible_place | visible_body)[..., None]
  return jnp.where(something, jnp.concatenate([something, *parts], -1).astype(jnp.float32), 0.0)


# --- training: random constraints of real motions ---------------------------------------------------------------------
#
# A pattern is some joints at some frames: the pelvis' path (most frequent), the whole body, one hand, foot or the head,
# or a random few joints; at 1, 2 or 5 frames, at a quarter of them, at all, or at a contiguous span. Two of three
# motions have one pattern, the third has two.

PELVIS = 0
ENDS = np.array([HUMANML3D.joints.index(name) for name in
                 ("pelvis", "left_foot", "right_foot", "head", "left_wrist", "right_wrist")])
# Probabilities of the kinds of joints: the path, the whole body, one of ENDS, a random few; and of the kinds of frames.
_JOINTS = np.array([0.45, 0.2, 0.2, 0.15], np.float32)
_FRAMES = np.array([0.05, 0.05, 0.1, 0.2, 0.5, 0.1], np.float32)  # 1, 2, 5, a quarter, all, a stretch


def draw_frames(key: jax.Array, count: Int[Array, ""], num_frames: Int[Array, ""], length: int
                ) -> Bool[Array, " {length}"]:
  """Mask (length,) of `count` of the first num_frames frames, drawn uniformly without replacement."""
  order = jnp.where(jnp.arange(length) < num_frames, jax.random.uniform(key, (length,)), 2.0)
  return (jnp.argsort(jnp.argsort(order)) < count) & (jnp.arange(length) < num_frames)


def _pattern(key, num_frames, length):
  """A random pattern: flags of (positions (length, J, 3), headings (length,))."""
  joint_key, end_key, few_key, frame_key, time_key, high_key, heading_key, stretch_key = jax.random.split(key, 8)
  joint = jnp.arange(NUM_JOINTS)
  kind = jax.random.categorical(joint_key, jnp.log(_JOINTS))
  joints = jnp.stack([joint == PELVIS, joint >= 0, joint == jax.random.choice(end_key, ENDS),
                      jax.random.bernoulli(few_key, 0.25, (NUM_JOINTS,))])[kind]
  how = jax.random.categorical(frame_key, jnp.log(_FRAMES))
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
  """Draws a signal for a share `rate` of motions, joints (B, T, 22, 3) with num_frames (B,) real frames; empty for the
  others. keys (B,): one each."""
  length = joints.shape[1]

  def one(key, count):
    chosen, twice, first, second = jax.random.split(key, 4)
    given, faces = _pattern(first, count, length)
    more, faces_more = _pattern(second, count, length)
    both, any_at_all = jax.random.bernoulli(twice, 1 / 3), jax.random.bernoulli(chosen, rate)
    return (given | (more & both)) & any_at_all, (faces | (faces_more & both)) & any_at_all

  given, heading_given = jax.vmap(one)(keys, num_frames)
  return ControlSignal(jnp.where(given, joints, 0.0), given, jnp.where(heading_given, heading, 0.0), heading_given)
