"""A motion that exists, made ready for a model to continue or to edit, and the way back to its own body and place."""
import dataclasses
from typing import Any

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.motion import plausibility
from motion_jax.motion.filling import fill_frames
from motion_jax.motion.representations import Representation
from motion_jax.motion.retarget import floor_height, leg_scale, retarget, with_lengths
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import Skeleton, bone_lengths, with_own_lengths
from motion_jax.shapes import Array, Float, Num
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import format_value

_OTHER_BONES = 5e-3  # metres that a body's bones may differ from the skeleton's before it is retargeted


def on_our_body(clip: Clip, fps: float, skeleton: Skeleton) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3), float64, at the model's frame rate and with the bones that it knows.

  A body whose bones are the skeleton's (to 5 mm) stays exactly as it is; others are retargeted.
  """
  joints = at_rate(clip, fps, skeleton)
  return retarget(joints, skeleton) if _has_other_bones(joints, skeleton) else joints


def at_rate(clip: Clip, fps: float, skeleton: Skeleton) -> Float[np.ndarray, "t j 3"]:
  """Joints (T, J, 3), float64, of the clip's own body at a rate. Raises ValueError for another skeleton, or an
  implausible motion (`motion.plausibility`)."""
  if clip.skeleton is not skeleton:
    raise ValueError(f"clip {clip.id!r} has the skeleton {clip.skeleton.name!r}, the model moves {skeleton.name!r}")
  plausibility.check(clip.joints, clip.skeleton, clip.fps, f"clip {clip.id!r}")
  joints = np.asarray(clip.joints, np.float64)
  return resample(joints, clip.fps, fps) if abs(clip.fps - fps) > 1e-3 else joints


def _has_other_bones(joints, skeleton):
  return np.abs(bone_lengths(joints, skeleton) - skeleton.bone_lengths).max() * skeleton.unit > _OTHER_BONES


@dataclasses.dataclass(frozen=True, eq=False)
class KnownMotion:
  """A motion on its own body, and the same motion retargeted to the body of the model.

  joints, on_model (T, J, 3): both at the model's rate. own: the model's skeleton with the bone lengths of joints.
  """
  joints: Float[np.ndarray, "t j 3"]
  on_model: Float[np.ndarray, "t j 3"]
  skeleton: Skeleton
  own: Skeleton

  @classmethod
  def of(cls, joints: Num[Array, "t j 3"], skeleton: Skeleton) -> "KnownMotion":
    """joints: at the model's rate, as `at_rate` gives them."""
    joints = np.asarray(joints, np.float64)
    on_model = retarget(joints, skeleton) if _has_other_bones(joints, skeleton) else joints
    return cls(joints, on_model, skeleton, with_own_lengths(joints, skeleton))

  @property
  def is_on_model(self) -> bool:
    """Whether the bones are those of the model's body."""
    return not _differ(self.own, self.skeleton)

  def cut(self, first: int, past: int) -> "KnownMotion":
    return dataclasses.replace(self, joints=self.joints[first:past], on_model=self.on_model[first:past])

  def own_body(self, generated: Num[np.ndarray, "n j 3"], shown: Num[np.ndarray, "t j 3"]
               ) -> Float[np.ndarray, "n j 3"]:
    """Brings generated joints (N, J, 3) from the model's body to this motion's body and floor; x and z may be off.

    shown (T, J, 3): this motion as the model saw it, on the same floor as `generated`.
    """
    generated = np.asarray(generated, np.float64)
    floor = floor_height(self.joints, self.skeleton)
    if self.is_on_model:
      result, scale = with_lengths(generated, self.own), 1.0
    else:
      result, scale = retarget(generated, self.own), leg_scale(generated, self.own)
    height = scale * (floor_height(generated, self.skeleton) - floor_height(shown, self.skeleton))
    result[..., 1] += floor + height - floor_height(result, self.skeleton)
    return result

  def continued(self, generated: Num[np.ndarray, "n j 3"], count: int, fps: float, fix_body: bool = True
                ) -> Float[np.ndarray, "m j 3"]:
    """The last `count` frames of generated joints (N, J, 3), on this motion's body, continued from its end, which the
    generated frames before them repeat. fix_body: see `fill_frames`. float32."""
    past = self.cut(len(self.joints) - (len(generated) - count), len(self.joints))
    generated = self.own_body(generated, generated[:-count]) if fix_body else np.asarray(generated, np.float64)
    given = np.concatenate([past.joints, np.repeat(past.joints[-1:], count, axis=0)])
    new = np.arange(len(generated)) >= len(past.joints)
    return fill_frames(generated, given, new, self.own, fps, fix_body)[new].astype(np.float32)


def _differ(body, skeleton):
  return np.abs(body.bone_lengths - skeleton.bone_lengths).max() * skeleton.unit > _OTHER_BONES


def clip_of(motion: Any, layout: Representation) -> Clip:
  """A motion as a Clip: a Clip itself, joints (T, J, 3), or features (T, F) of the layout, not normalized, at its rate.

  Raises InputError for anything else.
  """
  if isinstance(motion, Clip):
    return motion
  if hasattr(motion, "__array__"):  # of numpy, JAX and others
    array = np.asarray(motion)
    if array.ndim == 3 and array.shape[1:] == (layout.skeleton.num_joints, 3):
      return Clip(array, layout.fps, skeleton=layout.skeleton, id="joints")
    if array.ndim == 2 and array.shape[-1] == layout.dim:
      return Clip(np.asarray(layout.to_joints(array)), layout.fps, skeleton=layout.skeleton, features=array,
                  id="features")
  got = f"an array of shape {motion.shape}" if hasattr(motion, "__array__") else format_value(motion)
  raise InputError(f"got {got} as the motion, expected a Clip (motion_jax.export.load reads files), joints (frames, "
                   f"{layout.skeleton.num_joints}, 3), or {layout.name!r} features (frames, {layout.dim}), at "
                   f"{layout.fps:g} frames a second")
