"""Motion capture as read from a BVH or ASF/AMC file, and its conversion to a Clip."""
import dataclasses
import pathlib
import warnings

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.data.mocap import conventions, rest_pose
from motion_jax.motion import plausibility
from motion_jax.motion import rotations as rot
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.rigs.joint_maps import map_joints, own_joints
from motion_jax.utils.errors import InputError

MOST = 8_000_000  # frames times joints: a gigabyte


@dataclasses.dataclass(frozen=True, eq=False)
class Capture:
  """A motion-capture file as read, in its own units and names; N counts its joints and the ends of its limbs."""
  names: tuple[str, ...]
  parents: tuple[int, ...]             # -1 for a root; parents come before children
  offsets: np.ndarray                  # (N, 3) from the parent, at rest
  channels: tuple[tuple[str, ...], ...]
  fps: float
  positions: np.ndarray                # (T, N, 3) in the world
  rotations: np.ndarray                # (T, N, 4) quaternions (w, x, y, z) relative to the parent
  turned: np.ndarray                   # (T, N, 4) the same in the world
  unit: float | None = None            # metres per unit of a file that states it; positions are in metres then
  usual: str = ""                      # the unit that positions should have: no note where the bones agree

  @property
  def num_frames(self) -> int:
    return len(self.positions)


def check_size(path, num_frames, num_joints):
  """Raises ValueError for a capture that memory might not hold."""
  if num_frames * num_joints > MOST:
    raise InputError(f"{path}: got {num_frames:,} frames of {num_joints:,} joints, expected at most "
                     f"{MOST // num_joints:,} frames; cut it in parts")


def with_rate(capture, fps) -> Capture:
  """The same frames at another rate than the file states, with a warning where that differs; None changes nothing."""
  if fps is None:
    return capture
  if abs(capture.fps - fps) > 0.01 * fps:
    warnings.warn(f"a file states {capture.fps:g} frames a second, taken as {fps:g}: the motion runs at another speed "
                  "(--resample of data build changes the rate alone)", stacklevel=2)
  return dataclasses.replace(capture, fps=fps)


def to_clip(capture, path, mapping=None, fps=20.0, unit="auto", up="auto", skip_pose=None, skeleton=HUMANML3D, **about
            ) -> Clip:
  """A Capture as a Clip of 22 joints: metres, y up, frame k at k / fps seconds, with the file's own proportions.

  mapping: see `rigs.map_joints`; None reads the names. skeleton: of the clip; a file whose joints are those of
  another skeleton than HumanML3D's, name by name, can stay on it. unit: of the file, "m", "cm", "mm", "in", "ft" or
  metres per unit; "auto" finds it by the legs. up: "x", "y", "z", "-y", ...; "auto" finds it by the rest pose, then by
  the motion (`conventions`). skip_pose: leave out a pose set before the motion; None does so when there is one. What
  was found is a warning. about (captions, id, split, ...) goes to the Clip. Raises ValueError for joints that are no
  person's (`motion.plausibility`), or rates that no camera has.
  """
  path = pathlib.Path(path)
  for rate in (capture.fps, fps):
    plausibility.check_rate(rate, str(path))
  try:
    rest = rest_pose.rest_positions(capture)
    if skeleton is HUMANML3D:
      still = np.tile([1.0, 0, 0, 0], (*rest.shape[:2], 1))
      pick = lambda file: map_joints(file.names, file.positions, mapping, file.turned, file.parents)
      rest, _ = map_joints(capture.names, rest, mapping, still, capture.parents)
    else:
      pick = lambda file: (own_joints(file.names, file.positions, skeleton), skeleton.name)
      rest = own_joints(capture.names, rest, skeleton)
    joints, table = pick(capture)
    if skip_pose or (skip_pose is None and rest_pose.starts_with_a_pose(capture, joints, skeleton)):
      rest, capture = joints[:1], rest_pose.without_pose(capture)
      joints, table = pick(capture)
      rest_pose.warn_of_pose(path)
    joints = conventions.with_y_up(joints, up, rest[0], path, skeleton)
    joints, metres = conventions.to_metres(joints, unit, path, capture.unit, skeleton, capture.usual)
  except ValueError as error:
    raise InputError(f"{path}: {error}") from None
  joints = joints / skeleton.unit
  plausibility.check(joints, skeleton, capture.fps, str(path))
  joints = resample(joints, capture.fps, fps)
  meta = {"file": path.name, "mapping": table, "unit": metres, "source_fps": round(capture.fps, 4)}
  about = {"id": path.stem, "source": path.name} | about
  return Clip(joints=joints.astype(np.float32), fps=fps, skeleton=skeleton, meta=meta | about.pop("meta", {}), **about)


def forward_kinematics(parents, local, rotations):
  """World positions (T, N, 3) and rotations (T, N, 4) from those relative to the parent."""
  positions, turned = local.copy(), rotations.copy()
  for joint, parent in enumerate(parents):
    if parent >= 0:
      positions[:, joint] = positions[:, parent] + rot.rotate(turned[:, parent], local[:, joint])
      turned[:, joint] = rot.multiply(turned[:, parent], rotations[:, joint])
  return positions, turned
