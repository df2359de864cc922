"""A motion clip with captions and metadata."""
import dataclasses
from typing import Any, Self

import numpy as np

from motion_jax.motion.plausibility import check_rate
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.transfer import from_22
from motion_jax.utils.errors import InputError


@dataclasses.dataclass(frozen=True)
class Caption:
  """A sentence about the seconds start:end of a clip; 0:0 means all of it."""
  text: str
  start: float = 0.0
  end: float = 0.0

  def frames(self, fps, num_frames):
    """(first, end) frame of the span, inside the clip."""
    if not self.start and not self.end:
      return 0, num_frames
    return max(0, int(self.start * fps)), min(num_frames, int(self.end * fps))


@dataclasses.dataclass(frozen=True, eq=False)
class Clip:
  """A motion: joints (T, J, 3) in the skeleton's unit, y up, with captions and metadata.

  `features` (T - 1, F) are present if the file held them. Raises ValueError for a wrong shape or a frame that is not
  finite.
  """
  joints: np.ndarray
  fps: float = 20.0
  captions: tuple[Caption, ...] = ()
  id: str = "clip"
  split: str = ""
  source: str = ""
  license: str = ""
  skeleton: Skeleton = HUMANML3D
  features: np.ndarray | None = None
  meta: dict[str, Any] = dataclasses.field(default_factory=dict)

  def __post_init__(self):
    shape = np.shape(self.joints)
    if len(shape) != 3 or shape[1:] != (self.skeleton.num_joints, 3) or shape[0] < 1:
      raise ValueError(f"clip {self.id!r}: got joints of shape {shape}, expected (frames, "
                       f"{self.skeleton.num_joints}, 3) for skeleton {self.skeleton.name!r}; "
                       "motion_jax.motion.retarget brings other skeletons to this one")
    bad = np.flatnonzero(~np.isfinite(self.joints).all((1, 2)))
    if len(bad):
      raise ValueError(f"clip {self.id!r}: {len(bad)} of {shape[0]} frames hold NaN or infinity, the first is frame "
                       f"{bad[0]}; cut them away or repair the file")
    check_rate(self.fps, f"clip {self.id!r}")

  @property
  def num_frames(self) -> int:
    return len(self.joints)

  @property
  def seconds(self) -> float:
    return self.num_frames / self.fps

  def replace(self, **changes: Any) -> Self:
    return dataclasses.replace(self, **changes)

  def on_skeleton(self, skeleton: Skeleton) -> "Clip":
    """This motion of HumanML3D's 22 joints on another skeleton, at that skeleton's frame rate."""
    if self.skeleton is not HUMANML3D:
      raise ValueError(f"clip {self.id!r} is on skeleton {self.skeleton.name!r}; only clips of HumanML3D's 22 joints "
                       f"go to {skeleton.name!r}")
    joints = resample(self.joints.astype(np.float64), self.fps, skeleton.fps)
    return self.replace(joints=from_22(joints, skeleton, skeleton.fps).astype(np.float32), fps=skeleton.fps,
                        skeleton=skeleton)

  def cut(self, first, past) -> "Clip":
    """The frames first:past, with the captions of those seconds. Raises InputError where there are none."""
    if not 0 <= first < past <= self.num_frames:
      raise InputError(f"clip {self.id!r}: got the frames {first} to {past}, expected at least one of the "
                       f"{self.num_frames} that there are")
    start, end = first / self.fps, past / self.fps
    captions = tuple(c if not c.start and not c.end else Caption(c.text, max(c.start, start) - start,
                                                                 min(c.end, end) - start)
                     for c in self.captions if (not c.start and not c.end) or (c.start < end and c.end > start))
    features = None if self.features is None else self.features[first:past]
    return self.replace(joints=self.joints[first:past], features=features, captions=captions)

  def __repr__(self):
    said = " | ".join(caption.text for caption in self.captions)
    said = f", {said if len(said) <= 60 else said[:59] + '…'!r}" if said else ""
    return (f"{type(self).__name__}({self.id!r}: {self.num_frames} frames, {self.seconds:.1f} s at {self.fps:g} a "
            f"second, {self.skeleton.num_joints} joints{said})")
