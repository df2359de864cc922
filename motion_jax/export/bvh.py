"""BVH: a T-pose skeleton and joint angles, which Blender and every animation program open.

Angles follow a body round and round without a jump: of the two triples of angles that mean one rotation, and of all
whole turns, the one nearest to the frame before is written. Each joint has the order of axes whose middle angle stays
farthest from 90 degrees, where triples degenerate.
"""
import itertools
import pathlib

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import to_pose
from motion_jax.runtime.atomic import atomic_path

_UNITS = {"centimetres": 100.0, "metres": 1.0}
_ORDERS = ("YXZ", *("".join(order) for order in itertools.permutations("XYZ") if order != ("Y", "X", "Z")))
_ENDS = {"head": (0, 0.18, 0.02), "wrist": (0.17, 0, 0), "foot": (0, 0, 0.07)}  # End Sites, metres; x for the left


def bvh(clip, path, unit="centimetres", rigid=False) -> pathlib.Path:
  """Writes a clip as BVH, y up, facing +z, one line per frame at the clip's rate.

  unit: "centimetres" (most programs expect them) or "metres". Where pelvis or chest bend in themselves by more than
  half a millimetre, as they may in generated motion, the joints next to them get position channels too, so that the
  file says exactly where every joint is; rigid=True leaves these out, for programs that move no joint but the root.
  """
  path = pathlib.Path(path)
  if unit not in _UNITS:
    raise ValueError(f"got unit {unit!r}, expected one of {', '.join(_UNITS)}")
  scale = _UNITS[unit]
  skeleton = clip.skeleton
  pose = to_pose(np.asarray(clip.joints, np.float64) * skeleton.unit, skeleton, clip.fps)
  moving = np.zeros(skeleton.num_joints, bool) if rigid else np.linalg.norm(pose.shifts, axis=-1).max(0) > 5e-4
  moving[0] = True
  angles = [euler(pose.rotations[:, j]) for j in range(skeleton.num_joints)]
  lines, order = ["HIERARCHY"], []

  def write(joint, depth):
    pad, name = "  " * depth, skeleton.joints[joint]
    children = [k for k, parent in enumerate(skeleton.parents) if parent == joint]
    axes = angles[joint][0]
    channels = [f"{axis}position" for axis in "XYZ"] * int(moving[joint]) + [f"{axis}rotation" for axis in axes]
    order.append(joint)
    lines.extend([f"{pad}{'JOINT' if depth else 'ROOT'} {name}", f"{pad}{{",
                  f"{pad}  OFFSET {_numbers(pose.offsets[joint] * scale)}",
                  f"{pad}  CHANNELS {len(channels)} {' '.join(channels)}"])
    for child in children:
      write(child, depth + 1)
    if not children:
      side, _, kind = name.rpartition("_")
      end = np.array(_ENDS.get(kind, (0, 0.05, 0))) * [-1 if side == "right" else 1, 1, 1] * scale
      lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {_numbers(end)}", f"{pad}  }}"])
    lines.append(f"{pad}}}")

  write(0, 0)
  places = pose.offsets + pose.shifts
  places[:, 0] = pose.root
  columns = [np.concatenate(([places[:, j] * scale] if moving[j] else []) + [np.degrees(angles[j][1])], axis=1)
             for j in order]
  lines += ["MOTION", f"Frames: {clip.num_frames}", f"Frame Time: {1 / clip.fps:.8f}"]
  lines += [_numbers(row) for row in np.concatenate(columns, axis=1)]
  with atomic_path(path) as temporary:
    temporary.write_text("\n".join(lines) + "\n", encoding="ascii")
  return path


def _numbers(values):
  return " ".join(f"{value + 0.0:.6f}" for value in values)  # + 0.0: no "-0.000000" from a true zero


def euler(rotations):
  """Quaternions (T, 4) to (order, angles (T, 3) radians): R = R_order[0] R_order[1] R_order[2], continuous in time."""
  matrices = rot.to_matrix(rotations)
  sines = {order: np.abs(_middle_sine(matrices, order)).max() for order in _ORDERS}
  # The heading turns freely about y, so y comes first as long as that order is safe.
  order = "YXZ" if sines["YXZ"] < 0.94 else min(sines, key=sines.get)
  return order, _nearest(_angles(matrices, order))


def _axes(order):
  i, j, k = ("XYZ".index(axis) for axis in order)
  return i, j, k, 1.0 if (j - i) % 3 == 1 else -1.0  # +1 where the order is a cyclic one


def _middle_sine(matrices, order):
  i, _, k, sign = _axes(order)
  return np.clip(sign * matrices[:, i, k], -1, 1)


def _angles(m, order):
  """One triple of angles per matrix, the middle one within 90 degrees."""
  i, j, k, sign = _axes(order)
  middle = np.arcsin(_middle_sine(m, order))
  first = np.arctan2(-sign * m[:, j, k], m[:, k, k])
  last = np.arctan2(-sign * m[:, i, j], m[:, i, i])
  return np.stack([first, middle, last], axis=-1)


def _nearest(angles):
  """Replaces triples by their equals nearest to the frame before: (a, b, c) or (a + pi, pi - b, c + pi), plus turns."""
  result = angles.copy()
  for t in range(1, len(angles)):
    a, b, c = angles[t]
    pair = np.array([[a, b, c], [a + np.pi, np.pi - b, c + np.pi]])
    pair += 2 * np.pi * np.round((result[t - 1] - pair) / (2 * np.pi))
    result[t] = pair[np.abs(pair - result[t - 1]).sum(1).argmin()]
  return result
