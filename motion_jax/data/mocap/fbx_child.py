"""Reads an FBX file with ufbx, in a process of its own: that library can crash, which would end the whole program.

  python -m motion_jax.data.mocap.fbx_child FILE OUT.npz [CLIP]

OUT.npz gets names, parents, and of each frame the bones' translations, rotations (w, x, y, z) and scales relative to
their parents, in metres with y up; or only the names of the file's animations where CLIP names none of several.
"""
import gc
import os
import sys

import numpy as np

_FEW = 15  # bones; files with fewer keep their joints in other nodes


def main(path, out, wanted=None):
  """Writes what the file holds and ends the process; raises what ufbx raises."""
  import ufbx
  gc.disable()  # nothing of ufbx is freed (`_finish`)
  # Joints of Maya do not inherit their parent's scale: that scale goes to a node of its own beside them.
  scene = ufbx.load_file(path, target_axes=ufbx.axes_right_handed_y_up, target_unit_meters=1.0,
                         inherit_mode_handling=ufbx.InheritModeHandling.HELPER_NODES,
                         space_conversion=ufbx.SpaceConversion.ADJUST_TRANSFORMS)
  held: list = []
  spans = [(stack, *_span(stack, held)) for stack in scene.anim_stacks]
  # Without a curve in any of them, the first shows a figure that is still.
  spans = [span for span in spans if span[3]] or [span for span in spans if span[2] > span[1]][:1]
  names = [str(stack.name) for stack, *_ in spans]
  chosen = [i for i, name in enumerate(names) if wanted in (None, name, str(i + 1))]
  if len(chosen) != 1:
    _finish(out, animations=np.array(names, dtype=str))
  stack, first, last, _ = spans[chosen[0]]
  everything = list(scene.nodes)  # all held: a node that is dropped may come back as another one
  nodes = [node for node in everything if not node.is_root]
  scaled = [node.scale_helper or node for node in nodes]  # what a node is (a bone, a mesh) is said by its helper
  own = [(node, helper) for node, helper in zip(nodes, scaled) if not node.is_scale_helper]
  bones = [node for node, helper in own if helper.bone is not None]
  kept = {node.typed_id for node in (bones if len(bones) >= _FEW else [node for node, _ in own])}
  number = {node.typed_id: i for i, node in enumerate(nodes)}
  above = [node.parent for node in nodes]
  parents = [-1 if one is None or one.is_root else number[one.typed_id] for one in above]
  rate = float(scene.settings.frames_per_second)
  rate = rate if 1 <= rate <= 240 else 30.0
  count = int((last - first) * rate + 1e-3) + 1
  numbers = lambda at: (at.translation.x, at.translation.y, at.translation.z, at.rotation.w, at.rotation.x,
                        at.rotation.y, at.rotation.z, at.scale.x, at.scale.y, at.scale.z)
  still = np.array([numbers(node.local_transform) for node in nodes])
  moving = np.array([[numbers(ufbx.evaluate_transform(stack.anim, node, first + k / rate))
                      for node in nodes] for k in range(count)])
  _finish(out, animations=np.array(names, dtype=str), names=np.array([str(node.name) for node in nodes]),
          parents=np.array(parents), kept=np.array([node.typed_id in kept for node in nodes]), rate=rate,
          still=still, moving=moving)


def _finish(out, **arrays):
  """Writes the arrays and ends the process: ufbx 0.0.5 crashes where its objects are freed in a wrong order."""
  np.savez(out, **arrays)
  os._exit(0)


def _span(stack, held):
  """(first second, last second, whether anything moves) of an animation: files have empty ones beside the motion's.

  held: gets all objects that were looked at, so that none is freed.
  """
  held += [stack, *(layers := list(stack.layers)), *(values := [v for layer in layers for v in layer.anim_values])]
  held += (curves := [curve for value in values for curve in value.curves if curve is not None])
  held += (keys := [curve.keyframes for curve in curves])
  times = [time for curve, frames in zip(curves, keys) if len(frames) for time in (curve.min_time, curve.max_time)]
  if times and stack.time_end <= stack.time_begin:  # a file may leave out where it begins and ends
    return min(times), max(times), True
  return stack.time_begin, stack.time_end, bool(times)


if __name__ == "__main__":
  try:
    main(*sys.argv[1:])
  except ImportError:
    sys.exit(3)
  except Exception as error:
    sys.exit(f"{type(error).__name__}: {error}")
