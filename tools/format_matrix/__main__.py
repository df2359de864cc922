"""Writes a motion for every rig and format, has other programs read the files, and prints how far they are off.

  python tools/format_matrix MOTION.npz --blender PYTHON_WITH_BPY --node FOLDER_WITH_NODE_MODULES [--rigs mixamo,ue5]

Errors are against what was written (`export.rig.on_rig`): the largest distance of any joint in any frame, in
millimetres / the largest difference of any joint's turn from its rest pose, in degrees. A reader that is not given
is left out. Prints rows of a Markdown table, which docs/formats.md holds.
"""
import argparse
import json
import os
import pathlib
import re
import subprocess
import tempfile
import warnings

import numpy as np

from motion_jax import export
from motion_jax.export.rig import on_rig
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.rigs.rig import all_rigs

HERE = pathlib.Path(__file__).parent
OURS = "motion_jax"


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("motion")
  parser.add_argument("--rigs", default=",".join(name for name in all_rigs() if name != "kit"))
  parser.add_argument("--blender", help="a Python that has bpy")
  parser.add_argument("--node", help="a folder whose node_modules has three, @pixiv/three-vrm and three-vrm-animation")
  args = parser.parse_args()
  warnings.simplefilter("ignore")
  if args.blender:
    os.environ["MOTION_JAX_BLENDER"] = args.blender  # which writes .fbx
  clip = export.load(args.motion)
  columns = {}
  with tempfile.TemporaryDirectory() as folder:
    for name in args.rigs.split(","):
      row = measure(clip, name, pathlib.Path(folder), args)
      columns |= dict.fromkeys(row)
      if name == args.rigs.split(",")[0]:
        print("| rig | " + " | ".join(f"{kind} in {reader}" for kind, reader in row) + " |")
        print("|---" * (len(row) + 1) + "|")
      print(f"| {name} | " + " | ".join(row.get(key, "-") for key in columns) + " |", flush=True)


def measure(clip, name, folder, args):
  """{(format, reader): error as text} of a rig."""
  found = {}
  moved = on_rig(clip, name)
  kinds = [".bvh", ".glb", ".usda"] + ([".fbx"] if args.blender else []) + ([".vrma"] if name == "vrm" else [])
  for kind in kinds:
    path = folder / f"{name}{kind}"
    export.save(clip, path, **({} if kind == ".vrma" else {"rig": name}))
    if kind in (".bvh", ".usda"):
      ours = export.load(path, unit="cm" if kind == ".bvh" else "auto").joints
      at = [HUMANML3D.joints.index(joint) for joint in moved.rig.joints]
      numbers = list(moved.rig.joints.values())
      far = np.linalg.norm(ours[:, at] - places_of(moved)[:, numbers], axis=-1).max()
      found[kind, OURS] = f"{1000 * far:.2f}"
    if kind == ".usda":
      found[kind, "usd-core"] = _text(moved, _usd(path))
    if args.blender and kind != ".vrma":
      found[kind, "Blender"] = _text(moved, _run([args.blender, HERE / "in_blender.py"], clip, path))
    if args.node and kind != ".usda":
      script = pathlib.Path(args.node) / "in_three.mjs"
      script.write_text((HERE / "in_three.mjs").read_text())
      found[kind, "three.js"] = _text(moved, _run(["node", script], clip, path))
  return found


def places_of(moved):
  """Joint positions (T, N, 3) of a RigMotion by forward kinematics."""
  places = np.zeros((*moved.turned.shape[:2], 3))
  for joint, parent in enumerate(moved.rig.parents):
    if joint == moved.pelvis:
      places[:, joint] = moved.root
    elif parent >= 0:
      places[:, joint] = places[:, parent] + rot.rotate(moved.turned[:, parent], moved.offsets[joint][None])
  return places


def _run(command, clip, path):
  out = path.with_suffix(".json")
  done = subprocess.run([*map(str, command), repr(float(clip.fps)), str(out), str(path)], capture_output=True,
                        text=True)
  if done.returncode or not out.is_file():
    return (done.stderr.strip() or done.stdout.strip()).splitlines()[-1][:60]
  return json.loads(out.read_text())


def _usd(path):
  from pxr import Usd, UsdSkel
  stage = Usd.Stage.Open(str(path))
  cache = UsdSkel.Cache()
  cache.Populate(UsdSkel.Root(stage.GetDefaultPrim()), Usd.PrimDefaultPredicate)
  skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/Motion/Skeleton"))
  query = cache.GetSkelQuery(skeleton)
  frames = [query.ComputeJointSkelTransforms(t) for t in range(int(stage.GetEndTimeCode()) + 1)]
  turn = lambda matrix: [(q := matrix.ExtractRotationQuat()).GetReal(), *q.GetImaginary()]
  return {"names": list(skeleton.GetJointNamesAttr().Get()), "turns": [[turn(m) for m in frame] for frame in frames],
          "places": [[list(matrix.ExtractTranslation()) for matrix in frame] for frame in frames]}


def _text(moved, read):
  """The largest errors of what a reader found; a text is its error."""
  if isinstance(read, str):
    return read
  plain = lambda name: re.sub(r"[^A-Za-z0-9]", "", name)
  names = [plain(name) for name in read["names"]]
  own = [(number, names.index(plain(name))) for number, name in enumerate(moved.rig.names) if plain(name) in names
         and number != 0 or number == moved.pelvis and plain(name) in names]
  if not own:
    return f"other names ({', '.join(read['names'][:3])})"
  numbers, theirs = (list(one) for one in zip(*own))
  places, turns = np.array(read["places"])[:, theirs], np.array(read["turns"])[:, theirs]
  count = len(moved.root)
  if len(places) != count:
    return f"{len(places)} of {count} frames"
  far = np.linalg.norm(places - places_of(moved)[:, numbers], axis=-1).max()
  off = rot.multiply(rot.conjugate(rot.unit(turns)), moved.turned[:, numbers])
  angle = np.degrees(2 * np.arctan2(np.linalg.norm(off[..., 1:], axis=-1), np.abs(off[..., 0])).max())
  lost = "" if len(own) >= len(moved.rig.joints) else f", {len(moved.rig.joints) - len(own)} joints lost"
  return f"{1000 * far:.3f} / {angle:.3f}{lost}"


if __name__ == "__main__":
  main()
