"""Coordinates relative to the pelvis, its step in each frame, and foot contacts: 70 numbers a frame, KIT's 67.

  columns   block      row t
  0:3       root       the pelvis: x and z of its step from the frame before, y its height; row 0 has row 1's step
  3:66      positions  the other joints: x and z relative to the pelvis, y over the floor
  66:70     contacts   left ankle, left toes, right ankle, right toes stand, by `contacts.feet_stand`: 0 or 1

Axes are the world's, as in `coordinates`. There an error of centimetres between two latents shifts the whole body; here
it changes the length of a step. The features do not hold the initial position: joints are restored with the pelvis of
frame 0 over the origin.
"""
from functools import partial

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.representations.base import VECTOR, Block
from motion_jax.motion.representations.coordinates import Coordinates
from motion_jax.motion.representations.humanml3d import FULL, FULL_KIT
from motion_jax.motion.rotations import A
from motion_jax.shapes import Num
from motion_jax.utils.lazy import jax

_GROUND = np.array([1.0, 0.0, 1.0])


class Steps(Coordinates):
  are_joints = False
  root = slice(0, 3)

  def of_joints(self, joints: Num[A, "*lead t j 3"]) -> Num[A, "*lead t f"]:
    xp = rot.namespace(joints)
    wide = joints.astype(np.float64) if xp is np else joints
    place = wide[..., :1, :] * xp.asarray(_GROUND, wide.dtype)
    step = xp.diff(place, axis=-3)
    first = step[..., :1, :, :] if step.shape[-3] else xp.zeros_like(place)
    step = xp.concatenate([first, step], axis=-3)
    rows = xp.concatenate([(wide - place)[..., :1, :] + step, (wide - place)[..., 1:, :]], axis=-2)
    rows = rows.reshape(joints.shape[:-2] + (3 * self.skeleton.num_joints,))
    return xp.concatenate([rows, self._stands(wide)], axis=-1).astype(joints.dtype)

  def contacts(self, features: Num[A, "*lead f"]) -> None:
    """None: cleanup detects standing feet from the joints instead. With the generated contact columns feet slide more
    (0.20 m/s against 0.15; `cdamd-small`, 16 motions)."""
    return None

  def _stands(self, joints):
    """Foot contacts (..., T, 4) of joints (..., T, J, 3)."""
    of_clip = partial(feet_stand, fps=self.fps, skeleton=self.skeleton, floor=0.0)
    flat = joints.reshape((-1,) + joints.shape[-3:])
    flags = np.stack([of_clip(clip) for clip in flat]) if isinstance(joints, np.ndarray) else jax.vmap(of_clip)(flat)
    return flags.reshape(joints.shape[:-2] + (4,))

  def recover(self, features: Num[A, "*lead t f"]) -> Num[A, "*lead t j 3"]:
    xp = rot.namespace(features)
    rows = super().recover((features.astype(np.float64) if xp is np else features)[..., :self["contacts"].start])
    step = rows[..., :1, :] * xp.asarray(_GROUND, rows.dtype)
    path = xp.cumsum(step, axis=-3)
    path = path - path[..., :1, :, :]
    body = xp.concatenate([rows[..., :1, :] - step, rows[..., 1:, :]], axis=-2)
    return (body + path).astype(features.dtype)


STEPS, STEPS_KIT = (
    Steps(name, full.skeleton, {"root": Block(VECTOR),
                                "positions": Block(VECTOR, tuple(range(1, full.skeleton.num_joints))),
                                "contacts": Block((1,), full.skeleton.left_feet + full.skeleton.right_feet)}, full)
    for name, full in (("steps", FULL), ("steps_kit", FULL_KIT)))
