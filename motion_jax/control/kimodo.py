"""Kimodo's constraint file (nv-tlabs/kimodo@7330e7e, docs/source/user_guide/constraints.md) and ours, both ways.

A list of {"type", "frame_indices", ...}: metres, Y up, +Z forward, frames from 0. Poses are rotations of SMPL-X's 22
joints, which are our 22; other skeletons (SOMA, G1) are refused.
"""
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.control.compiling import angle_of
from motion_jax.control.constraints import (
    KIMODO_JOINTS,
    Constraint,
    EffectorTarget,
    Keyframe,
    RootPath,
    joint_number,
)
from motion_jax.inputs.errors import InputError
from motion_jax.motion import inverse
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, SMPL

FPS = 30.0
_LIMBS = {f"{side}-{part}": f"{side}_{part}" for side in ("left", "right") for part in ("hand", "foot")}
_MOST = 256


def from_kimodo(data: Any, fps: float = FPS) -> list[Constraint]:
  """Our constraints of Kimodo's parsed file. Raises InputError for what is none, or another skeleton's."""
  if not isinstance(data, list) or len(data) > _MOST:
    raise InputError(f"got no list of at most {_MOST} constraints of Kimodo")
  found: list[Constraint] = []
  for number, row in enumerate(data):
    kind = row.get("type") if isinstance(row, dict) else None
    if kind not in ("root2d", "fullbody", "end-effector", *_LIMBS):
      raise InputError(f"constraint {number}: got Kimodo's type {str(kind)[:40]!r}, expected root2d, fullbody, "
                       f"end-effector, {', '.join(_LIMBS)}")
    try:
      found += _constraints(kind, row, fps)
    except (KeyError, TypeError, ValueError, IndexError) as error:
      raise InputError(f"constraint {number} ({kind}): {error if isinstance(error, InputError) else repr(error)}"
                       ) from None
  return found


def _constraints(kind: str, row: dict[str, Any], fps: float) -> list[Constraint]:
  times = np.asarray(row["frame_indices"], np.float64) / fps
  if kind == "root2d":
    points = np.asarray(row["smooth_root_2d"], np.float64)[:, :2]  # of three numbers its code takes the first two
    turns = row.get("global_root_heading")
    heading = None if turns is None else np.arctan2(np.asarray(turns)[:, 1], np.asarray(turns)[:, 0])
    return [RootPath(points, times, heading=heading, between=bool(len(times) > 1 and np.ptp(np.diff(times)) < 1e-9
                                                                  and np.diff(times)[0] < 1.5 / fps))]
  poses = _joints(row)
  if kind == "fullbody":
    return [Keyframe(joints, time, "world") for joints, time in zip(poses, times)]
  names = row["joint_names"] if kind == "end-effector" else [_LIMBS[kind]]
  return [EffectorTarget(KIMODO_JOINTS.get(name, name), times, poses[:, joint_number(name)]) for name in names]


def _joints(row: dict[str, Any]) -> np.ndarray:
  """Joints (T, 22, 3) on our bones, of rotations (T, 22, 3) and a root path (T, 3)."""
  turns, root = (np.asarray(row[name], np.float64) for name in ("local_joints_rot", "root_positions"))
  if turns.ndim != 3 or turns.shape[1:] != (22, 3) or root.shape != (len(turns), 3):
    raise InputError(f"got rotations of shape {turns.shape}, expected (frames, 22, 3) of SMPL-X's body and a root "
                     "position for each; other skeletons are not known here")
  local, world = rot.from_vector(turns), [None] * 22
  for joint in inverse.order(SMPL):
    parent = SMPL.parents[joint]
    world[joint] = local[:, joint] if parent < 0 else rot.multiply(world[parent], local[:, joint])
  return with_lengths(inverse.forward(root, np.stack(world, 1), SMPL), HUMANML3D)


def to_kimodo(constraints: Sequence[Constraint], fps: float = FPS) -> list[dict[str, Any]]:
  """Kimodo's list of what it knows of ours: paths with times, and poses in the world. Warns of what is left out."""
  found: list[dict[str, Any]] = []
  for one in constraints:
    if isinstance(one, RootPath) and one.points is not None and one.times is not None:
      row: dict[str, Any] = {"type": "root2d", "frame_indices": np.round(one.times * fps).astype(int).tolist(),
                             "smooth_root_2d": one.points[:, [0, -1]].tolist()}
      if one.heading is not None:
        angle = np.broadcast_to(one.heading, len(one.points))
        row["global_root_heading"] = np.stack([np.cos(angle), np.sin(angle)], -1).tolist()
      found.append(row)
    elif isinstance(one, Keyframe) and one.place == "world":
      joints = with_lengths(one.joints[None], SMPL)
      turns = rot.to_vector(inverse.relative(inverse.world_rotations(joints, SMPL), SMPL))
      angle = float(angle_of(joints)[0])
      found.append({"type": "fullbody", "frame_indices": [int(round(one.time * fps))],
                    "local_joints_rot": turns.tolist(), "root_positions": joints[:, 0].tolist(),
                    "smooth_root_2d": joints[:, 0, [0, 2]].tolist(),
                    "global_root_heading": [[float(np.cos(angle)), float(np.sin(angle))]]})
    else:
      warnings.warn(f"Kimodo's file has nothing like {one.kind} as it is here; it is left out", stacklevel=2)
  return found
