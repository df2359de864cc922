"""USD as text (.usda): a skeleton, its animation and the mannequin, for Omniverse, Houdini, Maya, Blender and Unreal.

Text alone, so that every install writes it; usd-core is an extra, used for reading. Rows of a matrix are vectors, as
USD has them. Joint names that are no USD names, such as "mixamorig:Hips", have "_" in place of other signs, and stand
as they are in `jointNames`.
Source: openusd.org, UsdSkel schemas.
"""
import json
import pathlib
import re

import numpy as np

from motion_jax.export.binding import bind
from motion_jax.export.glb import clip_name, facts
from motion_jax.motion.figure import COLORS
from motion_jax.utils.atomic import atomic_path


def usda(clip, path, exact=False, rig=None, t_pose=False, name=None) -> pathlib.Path:
  """Writes a clip as .usda: a SkelRoot with Skeleton, SkelAnimation and meshes, metres, y up, a time code per frame.

  rig: names, tree and rest pose of another program (`motion_jax.rigs`), such as "ue5". Joints only turn, and the root
  moves; exact=True also moves those whose place rotations miss. t_pose: the first frame is a T-pose. name: of the
  SkelAnimation (`glb.clip_name`).
  """
  path = pathlib.Path(path)
  moved, carriers, skins, rest, inverse = bind(clip, exact, rig, t_pose)
  tokens = _paths(moved.rig)
  offsets = moved.offsets.copy()
  offsets[moved.pelvis] = rest[moved.pelvis]
  still = np.tile(np.eye(4), (len(tokens), 1, 1))
  still[:, 3, :3] = offsets
  names = json.dumps(list(moved.rig.names), ensure_ascii=False)
  caption = clip.captions[0].text if clip.captions else clip.id
  name, about = re.sub(r"^(?=\d)|[^A-Za-z0-9_]", "_", name or clip_name(clip)), facts(clip)
  lines = ["#usda 1.0", "(", '  defaultPrim = "Motion"', f"  doc = {_text(caption)}", "  metersPerUnit = 1",
           '  upAxis = "Y"', f"  timeCodesPerSecond = {clip.fps:.10g}", f"  framesPerSecond = {clip.fps:.10g}",
           "  startTimeCode = 0", f"  endTimeCode = {len(moved.root) - 1}",
           "  customLayerData = {", f"    bool loop = {int(about['loop'])}",
           *([f"    double speed = {about['speed']}", f"    double3 velocity = {_row(about['velocity'])}"]
             if "speed" in about else []), "  }", ")", "",
           'def SkelRoot "Motion" (prepend apiSchemas = ["SkelBindingAPI"])', "{",
           '  def Skeleton "Skeleton" (prepend apiSchemas = ["SkelBindingAPI"])', "  {",
           f"    uniform token[] joints = {json.dumps(tokens)}", f"    uniform token[] jointNames = {names}",
           f"    uniform matrix4d[] bindTransforms = {_matrices(np.linalg.inv(inverse).transpose(0, 2, 1))}",
           f"    uniform matrix4d[] restTransforms = {_matrices(still)}",
           f"    rel skel:animationSource = </Motion/Skeleton/{name}>", "",
           f'    def SkelAnimation "{name}"', "    {", f"      uniform token[] joints = {json.dumps(tokens)}",
           f"      half3[] scales = [{', '.join(['(1, 1, 1)'] * len(tokens))}]"]
  lines += _samples("float3[] translations", moved.places) + _samples("quatf[] rotations", moved.rotations)
  lines += ["    }", "  }"]
  for skin in skins:
    lines += _mesh(skin, [tokens[number] for number in carriers])
  with atomic_path(path) as temporary:
    temporary.write_text("\n".join([*lines, "}", ""]), encoding="utf-8")
  return path


def _paths(rig):
  """The path of each joint from its root: "Hips", "Hips/Spine", ..."""
  paths: list[str] = []
  for name, parent in zip(rig.names, rig.parents):
    safe_name = re.sub(r"\W", "_", name)
    paths.append(safe_name if parent < 0 else f"{paths[parent]}/{safe_name}")
  return paths


def _samples(declaration, values):
  """A value (T, N, K) that changes with time."""
  return [f"      {declaration}.timeSamples = {{",
          *(f"        {frame}: {_tuples(rows)}," for frame, rows in enumerate(values)), "      }"]


def _mesh(skin, joints):
  """One colour of the mannequin, carried by joints."""
  numbers = lambda values: "[" + ", ".join(map(str, np.ravel(values).tolist())) + "]"
  color = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in COLORS[skin.group]]
  return ["", f'  def Mesh "mannequin_{skin.group}" (prepend apiSchemas = ["SkelBindingAPI"])', "  {",
          '    uniform token subdivisionScheme = "none"',
          f"    int[] faceVertexCounts = {numbers(np.full(len(skin.triangles), 3))}",
          f"    int[] faceVertexIndices = {numbers(skin.triangles)}",
          f"    point3f[] points = {_tuples(skin.points)}",
          f'    normal3f[] normals = {_tuples(skin.normals)} (interpolation = "vertex")',
          f'    color3f[] primvars:displayColor = {_tuples([color])} (interpolation = "constant")',
          "    rel skel:skeleton = </Motion/Skeleton>",
          f"    uniform token[] skel:joints = {json.dumps(joints)}",
          f'    int[] primvars:skel:jointIndices = {numbers(skin.joints)} (elementSize = 4; interpolation = "vertex")',
          f"    float[] primvars:skel:jointWeights = {numbers(np.round(skin.weights / 255, 6))} "
          '(elementSize = 4; interpolation = "vertex")', "  }"]


def _matrices(values):
  return "[" + ", ".join("(" + ", ".join(_row(row) for row in matrix) + ")" for matrix in values) + "]"


def _tuples(values):
  return "[" + ", ".join(map(_row, values)) + "]"


def _row(row):
  return "(" + ", ".join(f"{value + 0.0:.7g}" for value in row) + ")"


def _text(words):
  return json.dumps(words, ensure_ascii=False)
