"""BVH files of bodies: positions alone, a figure in centimetres with turned joints, any skeleton."""
import numpy as np
from scipy.spatial.transform import Rotation

from motion_jax.motion.skeleton import HUMANML3D

# A figure of Mixamo's names, centimetres: joint, parent, OFFSET; End Sites of no length.
_SIDE = [("Shoulder", "Spine2", (6, 14, 0)), ("Arm", "Shoulder", (11, 2, 0)), ("ForeArm", "Arm", (28, 0, 0)),
         ("Hand", "ForeArm", (25, 0, 0)), ("UpLeg", "Hips", (9, -5, 0)), ("Leg", "UpLeg", (0, -42, 0)),
         ("Foot", "Leg", (0, -41, 0)), ("ToeBase", "Foot", (0, -7, 14))]
FIGURE = {"Hips": ("", (0, 0, 0)), "Spine": ("Hips", (0, 10, 0)), "Spine1": ("Spine", (0, 12, 0)),
          "Spine2": ("Spine1", (0, 12, 0)), "Neck": ("Spine2", (0, 18, 0)), "Head": ("Neck", (0, 10, 0))}
for _side, _sign in (("Left", 1), ("Right", -1)):
  FIGURE |= {_side + name: (parent if parent in ("Spine2", "Hips") else _side + parent, (_sign * x, y, z))
             for name, parent, (x, y, z) in _SIDE}
_PLACE, _ZYX = "Xposition Yposition Zposition", "Zrotation Yrotation Xrotation"


def bvh_text(names, parents, offsets, channels, values, seconds, end=(0, 1, 0)):
  """channels: of each joint, parted by blanks; values: of each joint (T, as many); end: OFFSET of End Sites."""
  lines, order = ["HIERARCHY"], []
  numbers = lambda row: " ".join(f"{value:.6f}" for value in row)

  def write(joint, depth):
    order.append(joint)
    lines.extend([f"{'JOINT' if depth else 'ROOT'} {names[joint]}", "{", f"OFFSET {numbers(offsets[joint])}",
                  f"CHANNELS {len(channels[joint].split())} {channels[joint]}"])
    below = [child for child, parent in enumerate(parents) if parent == joint]
    for child in below:
      write(child, depth + 1)
    lines.extend([*([] if below else ["End Site", "{", f"OFFSET {numbers(end)}", "}"]), "}"])

  write(0, 0)
  rows = np.concatenate([values[joint] for joint in order], axis=1)
  return "\n".join([*lines, "MOTION", f"Frames: {len(rows)}", f"Frame Time: {seconds:.8f}", *map(numbers, rows)]) + "\n"


def write_bvh(path, joints, fps=30.0, names=HUMANML3D.joints, scale=100.0):
  """Joints (T, 22, 3) as a BVH whose every joint has position channels and no rotation: positions are all it needs."""
  parents = np.array(HUMANML3D.parents)
  local = (joints - np.where(parents[:, None] < 0, 0, joints[:, np.maximum(parents, 0)])) * scale
  path.write_text(bvh_text(names, parents, np.zeros((22, 3)), [_PLACE] * 22, local.swapaxes(0, 1), 1 / fps))
  return path


def write_figure(path, offsets=(), turns=(), frames=40, root=(0, 95, 0), axes=(0, 1, 2), signs=(1, 1, 1), scale=1.0,
                 fps=20, swings=True):
  """A BVH file of FIGURE. offsets: {joint: OFFSET} of another one; turns: {joint: degrees (3,) or (T, 3) about z, y,
  x}; swings: limbs swing and arms hang, to which turns (T, 3) are added; axes and signs: which axis of ours each of
  the file's is; scale: units per cm."""
  names = list(FIGURE)
  place = lambda points: np.asarray(points, float)[..., list(axes)] * signs * scale
  own = {name: np.zeros((frames, 3)) for name in names}
  if swings:
    swing = 25 * np.sin(np.arange(frames) * 10 / fps)
    for side, sign in (("Left", 1), ("Right", -1)):
      own[f"{side}UpLeg"][:, 2] = sign * swing
      own[f"{side}Arm"] = np.stack([np.full(frames, -70.0 * sign), 0 * swing, -sign * swing], -1)
  for name, angle in dict(turns).items():
    own[name] = own[name] + angle if np.shape(angle) == (frames, 3) else np.tile(np.array(angle, float), (frames, 1))
  change = np.zeros((3, 3))
  change[range(3), list(axes)] = signs
  values = []
  for name in names:  # angles are ours: in a file with other axes each turns about its own one
    matrix = change @ Rotation.from_euler("ZYX", own[name], degrees=True).as_matrix() @ change.T
    values.append(Rotation.from_matrix(matrix).as_euler("ZYX", degrees=True))
  values[0] = np.concatenate([np.broadcast_to(place(root), (frames, 3)), values[0]], axis=1)
  path.write_text(bvh_text(names, [names.index(parent) if parent else -1 for parent, _ in FIGURE.values()],
                           [place(dict(offsets).get(name, FIGURE[name][1])) for name in names],
                           [f"{_PLACE} {_ZYX}", *[_ZYX] * (len(names) - 1)], values, 1 / fps, (0, 0, 0)))
  return path
