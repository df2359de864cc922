"""Reads an FBX file with ufbx, in a process of its own: that library can crash, which would end the whole program.

  python -m motion_jax.data.mocap.fbx_child FILE OUT.npz [CLIP]

OUT.npz gets names, parents, and of each frame the bones' translations, rotations (w, x, y, z) and scales relative to
their parents, in metres with y up; or only the names of the file's animations where CLIP names none of several.
"""
import gc
import sys

import numpy as np

_FEW = 15  # bones; files with fewer keep their joints in other nodes


def main(path, out, wanted=None):
  """Writes what the file holds; raises what ufbx raises."""
  import ufbx
  gc.disable()  # ufbx 0.0.5 crashes when its objects are collected
  scene = ufbx.load_file(path, target_axes=ufbx.axes_right_handed_y_up, target_unit_meters=1.0)
  stacks = [stack for stack in scene.anim_stacks if stack.time_end > stack.time_begin]
  names = [str(stack.name) for stack in stacks]
  chosen = [i for i, name in enumerate(names) if wanted in (None, name, str(i + 1))]
  if len(chosen) != 1:
    return np.savez(out, animations=np.array(names, dtype=str))
  stack = stacks[chosen[0]]
  everything = list(scene.nodes)  # all held: a node that is dropped may come back as another one
  nodes = [node for node in everything if not node.is_root]
  bones = [node for node in nodes if node.bone is not None]
  kept = {node.typed_id for node in (bones if len(bones) >= _FEW else nodes)}
  number = {node.typed_id: i for i, node in enumerate(nodes)}
  above = [node.parent for node in nodes]
  parents = [-1 if one is None or one.is_root else number[one.typed_id] for one in above]
  rate = float(scene.settings.frames_per_second)
  rate = rate if 1 <= rate <= 240 else 30.0
  count = int((stack.time_end - stack.time_begin) * rate + 1e-3) + 1
  numbers = lambda at: (at.translation.x, at.translation.y, at.translation.z, at.rotation.w, at.rotation.x,
                        at.rotation.y, at.rotation.z, at.scale.x, at.scale.y, at.scale.z)
  still = np.array([numbers(node.local_transform) for node in nodes])
  moving = np.array([[numbers(ufbx.evaluate_transform(stack.anim, node, stack.time_begin + k / rate))
                      for node in nodes] for k in range(count)])
  return np.savez(out, animations=np.array(names, dtype=str), names=np.array([str(node.name) for node in nodes]),
                  parents=np.array(parents), kept=np.array([node.typed_id in kept for node in nodes]), rate=rate,
                  still=still, moving=moving)


if __name__ == "__main__":
  try:
    main(*sys.argv[1:])
  except ImportError:
    sys.exit(3)
  except Exception as error:
    sys.exit(f"{type(error).__name__}: {error}")
