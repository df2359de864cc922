"""A body in six parts: which columns of a feature vector belong to which (docs/papers/cmdm.md#part-tmr)."""
import numpy as np

from motion_jax.motion.representations import get_layout

PARTS = ("root", "right_leg", "left_leg", "backbone", "right_arm", "left_arm")


def part_columns(layout="full"):
  """((part, columns), ...) in the order of PARTS, columns as tuples of ints.

  Each joint gives what the layout has of it, in the order position, rotation, velocity. The root's stream is what
  tells of its path, and joint 0; feet have their contacts; an arm begins at the spine, whose joint then is in three
  parts. Of 263 columns these are 7 + 50 + 50 + 60 + 60 + 60; of 67 and of coordinates only positions.
  """
  layout = get_layout(layout)
  joints, blocks = layout.skeleton.num_joints, layout.blocks
  per_joint = []  # (first column, first joint, numbers a joint) of each block that has rows of joints
  for name, size in (("coordinates", 3), ("positions", 3), ("rotations", 6), ("velocities", 3)):
    if name in blocks:
      start, stop = blocks[name].start, blocks[name].stop
      per_joint.append((start, joints - (stop - start) // size, size))
  others = [i for name, block in blocks.items() if name not in ("coordinates", "positions", "rotations", "velocities",
                                                                "contacts") for i in range(block.start, block.stop)]
  of_joint = lambda j: [start + (j - first) * size + i for start, first, size in per_joint if j >= first
                        for i in range(size)]
  contacts = np.arange(blocks["contacts"].start, blocks["contacts"].stop).tolist() if "contacts" in blocks else []
  left, right = contacts[:len(contacts) // 2], contacts[len(contacts) // 2:]
  parts = [("root", others + of_joint(0))]
  for name, chain, extra in zip(PARTS[1:], layout.skeleton.chains, (right, left, [], [], [])):
    parts.append((name, [i for j in chain if j for i in of_joint(j)] + extra))
  return tuple((name, tuple(columns)) for name, columns in parts)


def whole_body(layout="full"):
  """The same form with one part that holds every column: what a teacher without parts sees."""
  return (("body", tuple(range(get_layout(layout).dim))),)


def chain_columns(layout="full"):
  """The kinematic chains as columns of positions: ((x, y, z) of each joint, ...) of each chain; -1 is a coordinate that
  is 0 by definition, as the root's across the ground, whose height is a column of its own."""
  layout = get_layout(layout)
  block = layout.blocks.get("positions", layout.blocks.get("coordinates"))
  first = layout.skeleton.num_joints - (block.stop - block.start) // 3
  root = (-1, layout.blocks["root_height"].start, -1) if first else None
  columns = lambda j: root if j < first else tuple(int(i) for i in block.start + 3 * (j - first) + np.arange(3))
  return tuple(tuple(columns(j) for j in chain) for chain in layout.skeleton.chains)
