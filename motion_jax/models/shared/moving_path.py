"""The root path of a motion that comes in pieces: each piece begins where the previous one ends."""
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.shapes import Float

if TYPE_CHECKING:
  from motion_jax.motion.representations import Representation


class Path(NamedTuple):
  """End of a stream so far: the last row of features (1, F), its heading (4,) and its place (3,)."""
  row: np.ndarray
  heading: np.ndarray
  place: np.ndarray


def heading_of(path: Path) -> float:
  """The angle, in radians, that the body has turned about the vertical."""
  return float(-2 * np.arctan2(path.heading[2], path.heading[0]))


def continue_path(features: Float[np.ndarray, "n f"], past: Path | None, layout: "Representation"
                  ) -> tuple[Float[np.ndarray, "n j 3"], Path]:
  """Joints (n, J, 3) of the next rows of a stream (n, F), continued from the end of the last ones: (joints, end).

  Heading and place are summed in float64: after an hour's walk they are as exact as at the start. jax arrays keep
  their type.
  """
  xp = rot.namespace(features)
  rows = features if past is None else xp.concatenate([past.row, features])
  joints = layout.to_joints(rows)
  joints = joints.astype(np.float64) if xp is np else joints
  heading, path = layout.root_path(rows)
  ground = xp.asarray([1, 0, 1], path.dtype)
  if past is not None:
    # Seen from the row that old and new rows share: in some layouts a row holds the step to it.
    place, turn = path[0] * ground, rot.multiply(rot.conjugate(past.heading), heading[0])
    joints = rot.rotate(turn, joints - place)[1:] + past.place
    path = rot.rotate(turn, path - place) + past.place
    heading = rot.multiply(rot.multiply(heading, rot.conjugate(heading[0])), past.heading)
  return joints.astype(np.float32), Path(rows[-1:], heading[-1], path[-1] * ground)
