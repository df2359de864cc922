"""Joints that come block by block, as rotations of a rig at a fixed rate and with a bounded delay, for game engines.

The motion is turned into rotations in windows of fixed frames, whatever the blocks: each window looks back and ahead,
and is blended into the next one where they overlap. The rows do not depend on the size of the blocks.
"""
import numpy as np

from motion_jax.export.rig import pose_on_rig
from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import turn_ends
from motion_jax.motion.rigid import fit_pose
from motion_jax.motion.skeleton import HUMANML3D, t_pose
from motion_jax.rigs.rig import get_rig
from motion_jax.shapes import Float, Num

_BACK = 1.5    # seconds of a window before the frames that it adds
_HOP = 0.2     # seconds that a window adds
_AHEAD = 0.25  # seconds after those, over which it is blended into the next window


class RigStream:
  """Rows of a rig's pose: the root's position (3), metres, then a quaternion (w, x, y, z) for each of its N joints.

  Quaternions are local, from a T-pose (or the rig's A-pose) in which no joint is turned: y up, z ahead, x to the left.
  Rows come at most `delay` seconds behind the joints. The body is HumanML3D's, the floor at 0.
  """

  def __init__(self, rig: str, source_fps: float, fps: float = 50.0) -> None:
    self.rig, self.source_fps, self.fps = get_rig(rig), source_fps, fps
    frames = lambda seconds: max(round(seconds * source_fps), 1)
    self._back, self._hop, self._ahead = frames(_BACK), frames(_HOP), frames(_AHEAD)
    self.delay = (self._hop + self._ahead + 1) / source_fps
    self._rest = t_pose(HUMANML3D)
    self.offsets = self._on_rig(_standing()).offsets
    self._source = np.zeros((0, HUMANML3D.num_joints, 3))
    self._begins, self._solved, self._sent = 0, 0, 0  # frames: the first of _source, solved ones, rows that went out
    self._late: tuple | None = None  # (root, rotations) of the frames ahead of the last window
    self._rows: list = []            # (root, rotations) of solved frames from the one before the next row on
    self._first_row = 0

  def push(self, joints: Num[np.ndarray, "t 22 3"]) -> Float[np.ndarray, "n w"]:
    """The rows (N, 3 + 4 * joints of the rig) that joints (T, 22, 3), metres, y up, have made final."""
    self._source = np.concatenate([self._source, np.asarray(joints, np.float64)])
    while self._begins + len(self._source) >= self._solved + self._hop + self._ahead:
      self._solve(self._solved + self._hop + self._ahead)
    return self._between(last=False)

  def finish(self) -> Float[np.ndarray, "n w"]:
    """The last rows; nothing comes after them."""
    end = self._begins + len(self._source)
    while self._solved < end:
      self._solve(min(self._solved + self._hop + self._ahead, end))
    return self._between(last=True)

  def _on_rig(self, joints):
    pose = turn_ends(fit_pose(joints, HUMANML3D, self.source_fps, self._rest), joints, level=0.0)
    return pose_on_rig(pose, self.rig, HUMANML3D)

  def _solve(self, end):
    """Solves the window that ends at frame `end`, and adds its own frames."""
    first = max(self._solved - self._back, 0)
    moved = self._on_rig(self._source[first - self._begins:end - self._begins])
    unsolved = slice(self._solved - first, None)
    root, turned = moved.root[unsolved], moved.rotations[unsolved]
    if self._late is not None:
      both = min(len(self._late[0]), len(root))
      share = (np.arange(both) + 1) / (both + 1)
      root, turned = root.copy(), turned.copy()
      root[:both] = self._late[0][:both] + share[:, None] * (root[:both] - self._late[0][:both])
      turned[:both] = rot.slerp(self._late[1][:both], turned[:both], share[:, None])
    count = min(self._hop, len(root))
    self._rows += list(zip(root[:count], turned[:count]))
    self._late = root[count:], turned[count:]
    self._solved += count
    drop = max(self._solved - self._back, 0) - self._begins
    if drop > 0:
      self._source, self._begins = self._source[drop:], self._begins + drop

  def _between(self, last):
    """Rows at the new rate between solved frames."""
    rows, end = [], self._first_row + len(self._rows)
    while end:
      at = self._sent * self.source_fps / self.fps
      first = int(np.floor(at + 1e-9))
      if at > end - 1 + 1e-9 if last else first + 1 >= end:
        break
      (root, turned), (next_root, next_turned) = (self._rows[min(k, end - 1) - self._first_row]
                                                  for k in (first, first + 1))
      part = max(at - first, 0.0)
      turn = rot.slerp(turned, next_turned, np.full(len(turned), part))
      rows.append(np.concatenate([root + part * (next_root - root), turn.ravel()]))
      self._sent += 1
    keep = min(int(self._sent * self.source_fps / self.fps), end - 1)
    if keep > self._first_row:
      del self._rows[:keep - self._first_row]
      self._first_row = keep
    return np.array(rows).reshape(-1, 3 + 4 * len(self.rig.names))


def _standing():
  """Joints (1, 22, 3) of the T-pose, the pelvis at the origin."""
  places = t_pose(HUMANML3D).copy()
  for chain in HUMANML3D.chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      places[joint] = places[parent] + places[joint]
  return places[None]
