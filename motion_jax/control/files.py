"""Constraints as JSON: {"version": 1, "constraints": [{"type": "root_path", "points": [[0, 0], [2, 0]]}, ...]}.

The format of the command line, the studio and other programs. Kimodo's files are read, too (nv-tlabs/kimodo@7330e7e,
docs/source/user_guide/constraints.md): a list of {"type", "frame_indices", ...} in metres, Y up, +Z forward, frames
from 0, poses as rotations of SMPL-X's 22 body joints. Numbers are bounded, and references to other files need a reader.
"""
import dataclasses
import json
import os
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from motion_jax.control.constraints import (
  KIMODO_JOINTS,
  KINDS,
  Constraint,
  EffectorTarget,
  Keyframe,
  RootPath,
  joint_number,
)
from motion_jax.control.signal import ControlSignal
from motion_jax.motion import inverse
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, SMPL
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError, reading
from motion_jax.utils.format_versions import check_version
from motion_jax.utils.nearest import did_you_mean

VERSION = 1
MOST, MOST_BYTES = 256, 32 << 20  # constraints of a file, and its size

Reader = Callable[[str, int], Any]  # (path, frame or -1 for all) -> joints (22, 3) or (T, 22, 3)
KIMODO_FPS = 30.0
_LIMBS = {f"{side}-{part}": f"{side}_{part}" for side in ("left", "right") for part in ("hand", "foot")}


def to_json(constraints: Sequence[Constraint]) -> dict[str, Any]:
  """Constraints as JSON values; `from_json` is the inverse."""
  return {"version": VERSION,
          "constraints": [{"type": constraint.kind} | _fields(constraint) for constraint in constraints]}


def _fields(constraint: Constraint) -> dict[str, Any]:
  fields = {}
  for field in dataclasses.fields(constraint):
    value = getattr(constraint, field.name)
    if value is not None and not (field.default is not dataclasses.MISSING and np.ndim(value) == 0
                                  and value == field.default):
      fields[field.name] = value.tolist() if isinstance(value, np.ndarray) else (
          list(value) if isinstance(value, tuple) else value)
  return fields


def from_json(data: Any, read: Reader | None = None) -> list[Constraint]:
  """Constraints of parsed JSON. Raises InputError for invalid data.

  read(path, frame): reads the joints of a motion file, for constraints with "file" instead of "joints"; None rejects
  these, as a server must.
  """
  if not isinstance(data, dict) or set(data) != {"version", "constraints"}:
    raise InputError('got no constraints, expected {"version": 1, "constraints": [...]}')
  check_version(data["version"], "the list of constraints", VERSION)
  rows = data["constraints"]
  if not isinstance(rows, list) or len(rows) > MOST:
    raise InputError(f"got {len(rows) if isinstance(rows, list) else 'no list of'} constraints, expected a list of at "
                     f"most {MOST}")
  return [_constraint(row, number, read) for number, row in enumerate(rows)]


def _constraint(row: Any, number: int, read: Reader | None) -> Constraint:
  kind = row.get("type") if isinstance(row, dict) else None
  if not isinstance(kind, str) or kind not in KINDS:
    raise InputError(f"constraint {number}: got the type {str(kind)[:40]!r}{did_you_mean(str(kind)[:40], KINDS)}, "
                     f"expected one of {', '.join(KINDS)}")
  known = {field.name: field for field in dataclasses.fields(KINDS[kind])}
  given = {name: value for name, value in row.items() if name != "type"}
  if "file" in given and "joints" in known and "joints" not in given:
    frame = given.pop("frame", 0)
    if read is None:
      raise InputError(f"constraint {number} ({kind}) names a file; give its joints here")
    if not isinstance(given["file"], str) or type(frame) is not int:
      raise InputError(f"constraint {number} ({kind}): got the file {str(given['file'])[:40]!r}, frame "
                       f"{str(frame)[:20]}, expected a path and a number")
    given["joints"] = read(given.pop("file"), -1 if kind == "keep_parts" else frame)
  strange = sorted(set(given) - set(known))
  if strange:
    raise InputError(f"constraint {number} ({kind}): got {strange[0][:40]!r}{did_you_mean(strange[0][:40], known)}, "
                     f"expected {', '.join(known) or 'no more'}")
  missing = [name for name, field in known.items() if field.default is dataclasses.MISSING and given.get(name) is None]
  if missing:
    raise InputError(f"constraint {number} ({kind}): {', '.join(missing)} is missing")
  for name in ("joint", "place", "relative_to"):
    if name in given and not isinstance(given[name], str):
      raise InputError(f"constraint {number} ({kind}): got {str(given[name])[:40]} as {name}, expected a word")
  if not isinstance(given.get("between", False), bool):
    raise InputError(f"constraint {number} ({kind}): got {str(given['between'])[:40]} as between, expected true or "
                     "false")
  try:
    return KINDS[kind](**given)
  except InputError as error:
    raise InputError(f"constraint {number}: {error}") from None
  except (TypeError, ValueError, AttributeError, OverflowError):
    raise InputError(f"constraint {number} ({kind}): got a value of the wrong kind; docs/control.md says what each is"
                     ) from None


def load(path: str | os.PathLike, read: Reader | None = None) -> list[Constraint]:
  """Reads constraints from a .json file, ours or Kimodo's (a list; 30 frames per second)."""
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no file of constraints {path}")
  if path.stat().st_size > MOST_BYTES:
    raise InputError(f"{path} holds {path.stat().st_size >> 20} MiB, expected constraints of at most "
                     f"{MOST_BYTES >> 20} MiB")
  with reading(str(path), "expected JSON, see docs/control.md"):
    data = json.loads(path.read_bytes())
  try:
    return from_kimodo(data) if isinstance(data, list) else from_json(data, read)
  except InputError as error:
    raise InputError(f"{path}: {error}") from None


def save(constraints: Sequence[Constraint], path: str | os.PathLike) -> pathlib.Path:
  """Writes constraints to a .json file."""
  with atomic_path(path) as temporary:
    temporary.write_text(json.dumps(to_json(constraints), indent=1) + "\n")
  return pathlib.Path(path)


# --- Kimodo's file -----------------------------------------------------------------------------------------------


def from_kimodo(data: Any, fps: float = KIMODO_FPS) -> list[Constraint]:
  """Constraints of a parsed Kimodo file. Raises InputError for invalid data and for other skeletons."""
  if not isinstance(data, list) or len(data) > MOST:
    raise InputError(f"got no list of at most {MOST} constraints of Kimodo")
  constraints: list[Constraint] = []
  for number, row in enumerate(data):
    kind = row.get("type") if isinstance(row, dict) else None
    if kind not in ("root2d", "fullbody", "end-effector", *_LIMBS):
      raise InputError(f"constraint {number}: got Kimodo's type {str(kind)[:40]!r}, expected root2d, fullbody, "
                       f"end-effector, {', '.join(_LIMBS)}")
    try:
      constraints += _kimodo_constraints(kind, row, fps)
    except (KeyError, TypeError, ValueError, IndexError) as error:
      raise InputError(f"constraint {number} ({kind}): {error if isinstance(error, InputError) else repr(error)}"
                       ) from None
  return constraints


def _kimodo_constraints(kind: str, row: dict[str, Any], fps: float) -> list[Constraint]:
  times = np.asarray(row["frame_indices"], np.float64) / fps
  if kind == "root2d":
    points = np.asarray(row["smooth_root_2d"], np.float64)[:, :2]  # of three numbers its code takes the first two
    turns = row.get("global_root_heading")
    heading = None if turns is None else np.arctan2(np.asarray(turns)[:, 1], np.asarray(turns)[:, 0])
    return [RootPath(points, times, heading=heading, between=bool(len(times) > 1 and np.ptp(np.diff(times)) < 1e-9
                                                                  and np.diff(times)[0] < 1.5 / fps))]
  poses = _kimodo_joints(row)
  if kind == "fullbody":
    return [Keyframe(joints, time, "world") for joints, time in zip(poses, times)]
  names = row["joint_names"] if kind == "end-effector" else [_LIMBS[kind]]
  return [EffectorTarget(KIMODO_JOINTS.get(name, name), times, poses[:, joint_number(name)]) for name in names]


def _kimodo_joints(row: dict[str, Any]) -> np.ndarray:
  """Joints (T, 22, 3) with our bone lengths, from rotations (T, 22, 3) and a root path (T, 3)."""
  turns, root = (np.asarray(row[name], np.float64) for name in ("local_joints_rot", "root_positions"))
  if turns.ndim != 3 or turns.shape[1:] != (22, 3) or root.shape != (len(turns), 3):
    raise InputError(f"got rotations of shape {turns.shape}, expected (frames, 22, 3) of SMPL-X's body and a root "
                     "position for each; other skeletons are not known here")
  local, world = rot.from_vector(turns), [None] * 22
  for joint in SMPL.order:
    parent = SMPL.parents[joint]
    world[joint] = local[:, joint] if parent < 0 else rot.multiply(world[parent], local[:, joint])
  return with_lengths(inverse.forward(root, np.stack(world, 1), SMPL), HUMANML3D)


def constraints_of(control: Any, count: int) -> list[list[Constraint] | ControlSignal]:
  """The constraints of each of count motions, from a file, a list of constraints for all of them, a list with an entry
  for each motion (None: no constraint), or a signal (count, T)."""
  if control is None:
    return [[] for _ in range(count)]
  if isinstance(control, ControlSignal):
    if control.batch != count:
      raise InputError(f"got a control signal of {control.batch} motions for {count} prompts; give one row for each")
    return [jax.tree.map(lambda x, i=i: np.asarray(x)[i:i + 1], control) for i in range(count)]
  if isinstance(control, str | os.PathLike):
    control = load(control)
  if isinstance(control, Constraint):
    control = [control]
  if all(isinstance(entry, Constraint) for entry in control):
    return [list(control) for _ in range(count)]
  if len(control) != count:
    raise InputError(f"got control for {len(control)} motions and {count} prompts; give constraints for all of them, "
                     "or a list of them for each")
  return [constraints_of(entry, 1)[0] for entry in control]
