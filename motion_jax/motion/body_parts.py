"""A body in six parts: which columns of a feature vector belong to which (docs/papers/cmdm.md#part-tmr)."""
from motion_jax.motion.representations import LAYOUTS, Representation, get_layout

PARTS = ("root", "right_leg", "left_leg", "backbone", "right_arm", "left_arm")


def part_columns(layout: Representation | str = "full") -> tuple[tuple[str, tuple[int, ...]], ...]:
  """((part, columns), ...) in the order of PARTS, columns as tuples of ints.

  Each joint gives what the layout has of it, by the names of the blocks: position, rotation, velocity. The root's
  stream is what tells of its path, and joint 0; feet have their contacts; an arm begins at the spine, whose joint then
  is in three parts. Of 263 columns these are 7 + 50 + 50 + 60 + 60 + 60; of 67 and of coordinates only positions.
  """
  layout = get_layout(layout)
  feet = ["contacts"] if "contacts" in layout.parts else []
  by_joint = sorted(name for name, block in layout.parts.items() if block.joints and name not in feet)
  of_joint = lambda joint, names=by_joint: [i for name in names for i in layout.columns(name, joint)]
  others = [i for name, block in layout.parts.items() if not block.joints for i in layout.columns(name)]
  parts = [("root", others + of_joint(0))]
  for name, chain in zip(PARTS[1:], layout.skeleton.chains):
    parts.append((name, [i for joint in chain if joint for i in of_joint(joint)]
                  + [i for joint in chain for i in of_joint(joint, feet)]))
  return tuple((name, tuple(columns)) for name, columns in parts)


def whole_body(layout: Representation | str = "full") -> tuple[tuple[str, tuple[int, ...]], ...]:
  """The same form with one part that holds every column: what a teacher without parts sees."""
  return (("body", tuple(range(get_layout(layout).dim))),)


def chain_columns(layout: Representation | str = "full") -> tuple[tuple[tuple[int, ...], ...], ...]:
  """The kinematic chains as columns of positions: ((x, y, z) of each joint, ...) of each chain; -1 is a coordinate that
  is 0 by definition, as the root's across the ground, whose height is a column of its own."""
  layout = get_layout(layout)
  places = next((name for name in ("positions", "coordinates") if name in layout.parts), None)
  if places is None:
    raise ValueError(f"layout {layout.name!r} has no positions of joints, which this teacher reads; choose one of "
                     f"{', '.join(name for name, other in LAYOUTS.items() if 'positions' in other.parts)}")
  of_joint = lambda joint: layout.columns(places, joint) or (-1, layout["root_height"].start, -1)
  return tuple(tuple(of_joint(joint) for joint in chain) for chain in layout.skeleton.chains)
