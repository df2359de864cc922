"""Which part of a motion MDM's edits keep: frames around a gap, or body parts (docs/papers/mdm.md#editing)."""
import numpy as np

from motion_jax.motion.representations import Representation
from motion_jax.shapes import Bool
from motion_jax.utils.errors import InputError

GENERATED = ("upper_body", "lower_body")  # parts of the body that an edit can generate


def gap(num_frames: int, first: float = 0.25, past: float = 0.75) -> tuple[int, int]:
  """The frames first:past of a motion that the paper's in-betweening generates."""
  return int(first * num_frames), int(past * num_frames)


def kept_columns(layout: Representation, generated: str) -> Bool[np.ndarray, " f"]:
  """(F,): the columns that are kept where a part of `GENERATED` is generated: the root's path, the other part's joints,
  and of an upper body also the contacts of the feet."""
  if generated not in GENERATED:
    raise InputError(f"got the part {generated!r}, expected {' or '.join(GENERATED)}")
  legs = sorted({0, *layout.skeleton.chains[0], *layout.skeleton.chains[1]})
  lower = joint_columns(layout, tuple(legs))
  return path_columns(layout) | (lower if generated == "upper_body" else ~lower)


def joint_columns(layout: Representation, joints: tuple[int, ...], contacts: bool = True) -> Bool[np.ndarray, " f"]:
  """(F,): the columns that tell of these joints: positions, rotations, velocities and, if wanted, the contacts."""
  columns = np.zeros(layout.dim, bool)
  for name, block in layout.parts.items():
    for joint in joints if block.joints and (contacts or name != "contacts") else ():
      columns[list(layout.columns(name, joint))] = True
  return columns


def path_columns(layout: Representation) -> Bool[np.ndarray, " f"]:
  """(F,): the columns that tell of the root's path, none of a joint's."""
  columns = np.zeros(layout.dim, bool)
  for name, block in layout.parts.items():
    if not block.joints:
      columns[layout[name]] = True
  return columns
