"""The path of a motion that comes in pieces: each begins where the one before ended."""
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from motion_jax.motion import rotations as rot
from motion_jax.motion.representations import Representation, root_path, to_joints


class Path(NamedTuple):
  """Where a stream has got to: the last row of features, its heading (4,) and its place (3,)."""
  row: np.ndarray
  heading: np.ndarray
  place: np.ndarray


def heading_of(path: Path) -> float:
  """The angle, in radians, that the body has turned about the vertical."""
  return float(-2 * np.arctan2(path.heading[2], path.heading[0]))


def continue_path(features: Float[np.ndarray, "n f"], past: Path | None, layout: Representation
                  ) -> tuple[Float[np.ndarray, "n j 3"], Path]:
  """Joints (n, J, 3) of the next rows of a stream (n, F), going on from where the last ones ended -> (joints, past).

  Heading and place are summed in float64: after an hour's walk they are as exact as at the start. jax arrays keep
  their type.
  """
  xp = rot.namespace(features)
  rows = features if past is None else xp.concatenate([past.row, features])
  joints = to_joints(rows, layout)
  joints = joints.astype(np.float64) if xp is np else joints
  heading, path = root_path(rows, layout)
  ground = xp.asarray([1, 0, 1], path.dtype)
  if past is not None:
    # Seen from the row that old and new rows share: in some layouts a row holds the step to it.
    place, turn = path[0] * ground, rot.multiply(rot.conjugate(past.heading), heading[0])
    joints = rot.rotate(turn, joints - place)[1:] + past.place
    path = rot.rotate(turn, path - place) + past.place
    heading = rot.multiply(rot.multiply(heading, rot.conjugate(heading[0])), past.heading)
  return joints.astype(np.float32), Path(rows[-1:], heading[-1], path[-1] * ground)
