"""BVH: a T-pose skeleton and joint angles, which Blender and every animation program open.

All files of a model have one skeleton (`export.rig`) and one order of axes for each joint, so that the motion of one
file plays on the armature of another. Angles follow a body round and round without a jump: of the two triples of angles
that mean one rotation, and of all whole turns, the one nearest to the frame before is written. That choice is the work
here; the format itself is a page of text, for which no library is needed.
"""
import pathlib

import numpy as np

from motion_jax.export.rig import on_rig
from motion_jax.motion import rotations as rot
from motion_jax.utils.atomic import atomic_path

_UNITS = {"centimetres": 100.0, "metres": 1.0}
# The middle angle of three is ambiguous at 90 degrees. Of arms that is the one about x, along the arm; of all others
# the one about z, sideways: in generated motion no joint but the shoulder comes within 20 degrees of that, and it in
# 0.2 % of the frames. An order that is best for arms is at its worst for thighs that sit.
_ORDER, _ARM_ORDER = "YZX", "ZXY"
_ARM = ("collar", "shoulder", "elbow", "wrist")


def bvh(clip, path, unit="centimetres", exact=False, rig=None, t_pose=False) -> pathlib.Path:
  """Writes a clip as BVH, y up, facing +z, one line per frame at the clip's rate.

  unit: "centimetres" (most programs expect them) or "metres". rig: names, tree and rest pose of another program
  (`motion_jax.rigs`), such as "mixamo"; the rest pose is a T-pose, of Unreal's rigs an A-pose. t_pose: the
  first frame is a T-pose.

  Only the root has position channels: the joints are those of the rigid skeleton that is nearest to the motion,
  millimetres away (`export.rig_error`). exact=True adds position channels wherever that is more than half a
  millimetre; programs differ in what these mean (instead of the OFFSET in Blender, besides it in three.js), and some
  refuse them.
  """
  path = pathlib.Path(path)
  if unit not in _UNITS:
    raise ValueError(f"got unit {unit!r}, expected one of {', '.join(_UNITS)}")
  scale = _UNITS[unit]
  pose = on_rig(clip, rig, exact, t_pose)
  names, parents = pose.rig.names, pose.rig.parents
  moving = [joint in {0, *pose.moving} for joint in range(len(names))]
  arms = {number for name, number in pose.rig.joints.items() if name.endswith(_ARM)}
  orders = [_ARM_ORDER if j in arms else _ORDER for j in range(len(names))]
  angles = [euler(pose.rotations[:, j], order) for j, order in enumerate(orders)]
  lines, order = ["HIERARCHY"], []

  def write(joint, depth):
    pad, name = "  " * depth, names[joint]
    children = [k for k, parent in enumerate(parents) if parent == joint]
    channels = [f"{axis}position" for axis in "XYZ"] * moving[joint]
    channels += [f"{axis}rotation" for axis in orders[joint]]
    order.append(joint)
    lines.extend([f"{pad}{'JOINT' if depth else 'ROOT'} {name}", f"{pad}{{",
                  f"{pad}  OFFSET {_numbers(pose.offsets[joint] * scale)}",
                  f"{pad}  CHANNELS {len(channels)} {' '.join(channels)}"])
    for child in children:
      write(child, depth + 1)
    if not children:
      lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {_numbers(pose.tips[joint] * scale)}",
                    f"{pad}  }}"])
    lines.append(f"{pad}}}")

  write(0, 0)
  places = pose.places
  columns = [np.concatenate(([places[:, j] * scale] if moving[j] else []) + [np.degrees(angles[j])], axis=1)
             for j in order]
  lines += ["MOTION", f"Frames: {len(pose.root)}", f"Frame Time: {1 / clip.fps:.8f}"]
  lines += [_numbers(row) for row in np.concatenate(columns, axis=1)]
  with atomic_path(path) as temporary:
    temporary.write_text("\n".join(lines) + "\n", encoding="ascii")
  return path


def _numbers(values):
  return " ".join(f"{value + 0.0:.6f}" for value in values)  # + 0.0: no "-0.000000" from a true zero


def euler(rotations, order):
  """Angles (T, 3), radians and continuous in time, of quaternions (T, 4): R = R_order[0] R_order[1] R_order[2]."""
  return _nearest(_angles(rot.to_matrix(rotations), order))


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
