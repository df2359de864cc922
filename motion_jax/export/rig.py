"""The rig of exported files: poses of one skeleton, the same for every motion of a model, on any table of names."""
import functools
from typing import NamedTuple

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.motion import looping
from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import Pose, pose_to_joints, to_pose, turn_ends
from motion_jax.motion.retarget import floor_height
from motion_jax.motion.rigid import fit_pose, rest_offsets
from motion_jax.motion.skeleton import Skeleton
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.rigs.rig import Rig, get_rig, of_skeleton, tip
from motion_jax.shapes import Float
from motion_jax.utils.errors import InputError

_ROOT_SECONDS = 0.25  # standard deviation of the Gaussian that makes a root bone's path of the pelvis' one


def rigged(clip: Clip, exact: bool = False) -> Pose:
  """The Pose of a clip's rig, metres: the nearest that rotations and a moving root can be, `shifts` zero.

  exact: `shifts` hold the remaining offsets, so that every joint is where the clip has it. Of a loop the last frame's
  rotations are those of the first, apart from the root's turn over the ground.
  """
  joints = np.ascontiguousarray(clip.joints, np.float64)
  return _rigged(joints.tobytes(), clip.skeleton, clip.fps, exact)


@functools.lru_cache(maxsize=8)  # a .bvh and a .glb of one clip, and the distance that is reported
def _rigged(joints: bytes, skeleton: Skeleton, fps: float, exact: bool) -> Pose:
  places, unit = np.frombuffer(joints).reshape(-1, skeleton.num_joints, 3), skeleton.unit
  rest = rest_offsets(places, skeleton, fps)
  solve = lambda x: turn_ends((to_pose if exact else fit_pose)(x, skeleton, fps, rest), x * unit, skeleton)
  pose = _loop_pose(places, skeleton, fps, solve) if looping.is_loop(places, skeleton) else solve(places)
  return pose._replace(offsets=pose.offsets * unit, shifts=pose.shifts * unit, root=pose.root * unit)


def _loop_pose(places, skeleton, fps, solve):
  """The Pose of a loop, solved with the rounds around it."""
  turn, pad = looping.turn_of_round(places, skeleton), looping.around(len(places), fps)
  pose = solve(looping.rounds(places, pad, turn))
  shifts, root, local, world = (x[pad:-pad].copy() for x in pose[1:])
  at, world = looping.close(root[:, None], world, turn)
  shifts[-1], local[-1, 1:], local[-1, 0] = shifts[0], local[0, 1:], world[-1, 0]
  return Pose(pose.offsets, shifts, at[:, 0], rot.continuous(local), rot.continuous(world))


class RigMotion(NamedTuple):
  """A motion on the N joints of a rig, metres, y up. Rotations turn from the rig's rest pose, where none is turned."""
  rig: Rig
  offsets: Float[np.ndarray, "n 3"]      # from the parent at rest; a root's is zero
  tips: Float[np.ndarray, "n 3"]         # from each joint to the end of its limb at rest, for joints without children
  shifts: Float[np.ndarray, "t n 3"]     # further than the offset: what rotations cannot reach
  root: Float[np.ndarray, "t 3"]         # position of the pelvis
  rotations: Float[np.ndarray, "t n 4"]  # quaternions (w, x, y, z) relative to the parent; signs continuous in time
  turned: Float[np.ndarray, "t n 4"]     # the same in the world
  ground: Float[np.ndarray, "t 3"] | None = None  # position of the root bone, on the floor, of a rig that has one

  @property
  def pelvis(self) -> int:
    """The joint that `root` is the place of."""
    return next(iter(self.rig.joints.values()))

  @property
  def places(self) -> Float[np.ndarray, "t n 3"]:
    """Position of each joint relative to its parent."""
    places = self.offsets + self.shifts
    places[:, self.pelvis] = self.root
    if self.ground is not None:
      places[:, 0] = self.ground
      places[:, self.pelvis] = rot.rotate(rot.conjugate(self.turned[:, 0]), self.root - self.ground)
    return places

  @property
  def moving(self) -> list[int]:
    """The joints whose positions relative to their parents change by half a millimetre or more, roots included."""
    far = np.linalg.norm(self.shifts, axis=-1).max(0) > 5e-4
    far[[self.pelvis] if self.ground is None else [0, self.pelvis]] = True
    return np.flatnonzero(far).tolist()


def on_rig(clip: Clip, rig: str | Rig | None = None, exact: bool = False, t_pose: bool = False) -> RigMotion:
  """A clip on the joints of a rig, which keeps the body's own proportions; None: the clip's skeleton as it is.

  Every joint turns with the one of the clip whose place it has; joints in between keep still. A root bone, where the
  rig has one, carries the body over the ground: it moves and turns about the vertical, below the pelvis, smoothly.
  t_pose: one more frame before the motion, a T-pose on the floor, facing +z. Raises InputError for a rig of 22 joints
  and a clip of another skeleton.
  """
  skeleton = clip.skeleton
  rig = of_skeleton(skeleton) if rig is None else get_rig(rig) if isinstance(rig, str) else rig
  if not set(rig.joints) <= set(skeleton.joints):
    raise InputError(f"got rig {rig.name!r} for a motion of {skeleton.num_joints} joints ({skeleton.name}), expected "
                     f"HumanML3D's 22; skeleton {skeleton.name!r} is written without a rig, as .bvh or .glb")
  pose = rigged(clip, exact)
  moved = pose_on_rig(_after_t_pose(pose, skeleton) if t_pose else pose, rig, skeleton)
  return moved if moved.pelvis == 0 else _with_root(moved, *root_path(clip, moved.root, moved.turned[:, moved.pelvis]))


def root_path(clip: Clip, pelvis: Float[np.ndarray, "t 3"], turned: Float[np.ndarray, "t 4"]
              ) -> tuple[Float[np.ndarray, "t 3"], Float[np.ndarray, "t 4"]]:
  """Positions (T, 3) on the floor and rotations (T, 4) about the vertical of a root bone that carries a clip's body.

  pelvis, turned: the pelvis' own in the world, with or without a T-pose before the clip's frames.
  """
  early, count = len(pelvis) - clip.num_frames, clip.num_frames
  flat = np.array([1, 0, 1])
  points = np.stack([pelvis, pelvis + rot.rotate(turned, np.array([[1.0, 0, 0]]))], axis=1)[early:] * flat
  pad = min(count - 2, round(4 * _ROOT_SECONDS * clip.fps))
  if pad > 0:
    if looping.is_loop(clip.joints, clip.skeleton):
      long = looping.rounds(points, pad, looping.turn_of_round(clip.joints, clip.skeleton))
    else:  # as if the ends were passed at a constant speed
      long = np.concatenate([2 * points[:1] - points[pad:0:-1], points, 2 * points[-1:] - points[-2:-pad - 2:-1]])
    points = gaussian_filter1d(long, _ROOT_SECONDS * clip.fps, axis=0, mode="nearest")[pad:-pad]
  points = np.concatenate([pelvis[:early, None] * flat + [[0, 0, 0], [1.0, 0, 0]], points])
  across = points[:, 1] - points[:, 0]
  return points[:, 0], rot.continuous(rot.about_axis(np.arctan2(-across[:, 2], across[:, 0]), "y"))


def _with_root(moved, ground, facing):
  """A RigMotion whose root bone goes where `root_path` says."""
  local, turned = moved.rotations.copy(), moved.turned.copy()
  local[:, 0] = turned[:, 0] = facing
  for joint, parent in enumerate(moved.rig.parents):
    if parent == 0:
      local[:, joint] = rot.multiply(rot.conjugate(facing), turned[:, joint])
  return moved._replace(rotations=rot.continuous(local), turned=turned, ground=ground)


def pose_on_rig(pose: Pose, rig: Rig, skeleton: Skeleton) -> RigMotion:
  """A pose of a skeleton that has the rig's joints, metres, on the rig."""
  rest, followed, parents = rig.arm_rest(skeleton), np.array(rig.followed(skeleton)), np.array(rig.parents)
  turned = rot.multiply(pose.turned, rot.conjugate(rest)[None])[:, followed]
  turned[:, followed < 0] = [1, 0, 0, 0]
  above = np.maximum(parents, 0)
  local = rot.multiply(rot.conjugate(turned[:, above]), turned)
  local[:, parents < 0] = turned[:, parents < 0]
  leaning = rest[followed[above]]  # how the parent's bone is turned at rest
  places = rig.places(pose.offsets, skeleton)
  offsets = rot.rotate(leaning, places - places[above])
  offsets[parents < 0] = 0
  shifts = np.zeros((*turned.shape[:2], 3))
  for name, number in rig.joints.items():
    shifts[:, number] = rot.rotate(leaning[number][None], pose.shifts[:, skeleton.joints.index(name)])
  ends = np.array([tip(skeleton.joints[joint]) * (1 if number in rig.joints.values() else 0.1)
                   for number, joint in enumerate(followed)])
  return RigMotion(rig, offsets, rot.rotate(rest[followed], ends), shifts, pose.root, rot.continuous(local),
                   rot.continuous(turned))


def _after_t_pose(pose: Pose, skeleton: Skeleton) -> Pose:
  """A Pose, metres, after one more frame: the T-pose, its feet as high as those that stand in the motion."""
  still = lambda q: rot.continuous(np.concatenate([np.broadcast_to([1.0, 0, 0, 0], (1, *q.shape[1:])), q]))
  floor = floor_height(pose_to_joints(pose, skeleton), skeleton)
  low = of_skeleton(skeleton).places(pose.offsets, skeleton)[:, 1].min()
  root = np.concatenate([[[pose.root[0, 0], floor - low, pose.root[0, 2]]], pose.root])
  return pose._replace(root=root, rotations=still(pose.rotations), turned=still(pose.turned),
                       shifts=np.concatenate([np.zeros_like(pose.shifts[:1]), pose.shifts]))


def rig_error(clip: Clip) -> tuple[float, float, str]:
  """(mean, worst, joint of the worst) of the distances, millimetres, from the joints of `rigged` to the clip's own."""
  off = pose_to_joints(rigged(clip), clip.skeleton) - np.asarray(clip.joints, np.float64) * clip.skeleton.unit
  distance = 1000 * np.linalg.norm(off, axis=-1)
  joint = clip.skeleton.joints[int(distance.max(0).argmax())]
  return float(distance.mean()), float(distance.max()), joint.replace("_", " ")
