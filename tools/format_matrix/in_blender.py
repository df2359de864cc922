"""Runs in Blender's Python: in_blender.py FPS OUT.json FILE [AGAIN ...]. Where a file's bones are in each frame.

AGAIN are files of other formats that Blender writes of what it has read. y up, metres.
"""
import json
import pathlib
import sys

import bpy
from mathutils import Matrix

Y_UP = Matrix(((1, 0, 0), (0, 0, 1), (0, -1, 0)))
READ = {".bvh": lambda path: bpy.ops.import_anim.bvh(filepath=path, global_scale=0.01, update_scene_fps=False),
        ".glb": lambda path: bpy.ops.import_scene.gltf(filepath=path), ".fbx": lambda path: bpy.ops.import_scene.fbx(
            filepath=path), ".usda": lambda path: bpy.ops.wm.usd_import(filepath=path)}
WRITE = {".bvh": lambda path: bpy.ops.export_anim.bvh(filepath=path, global_scale=100, rotate_mode="NATIVE"),
         ".glb": lambda path: bpy.ops.export_scene.gltf(filepath=path, export_force_sampling=True),
         ".fbx": lambda path: bpy.ops.export_scene.fbx(filepath=path, add_leaf_bones=False, bake_anim_simplify_factor=0,
                                                       bake_anim_use_nla_strips=False),
         ".usda": lambda path: bpy.ops.wm.usd_export(filepath=path, export_animation=True)}


def main(fps, out, path, *again):
  bpy.ops.wm.read_factory_settings(use_empty=True)
  scene = bpy.context.scene
  scene.render.fps, scene.render.fps_base = round(float(fps)), round(float(fps)) / float(fps)
  READ[pathlib.Path(path).suffix](path)
  armature = next(thing for thing in scene.objects if thing.type == "ARMATURE")
  first, last = armature.animation_data.action.frame_range
  scene.frame_start, scene.frame_end = round(first), round(last)
  bones = list(armature.pose.bones)
  places, turns = [], []
  for number in range(round(first), round(last) + 1):
    scene.frame_set(number)
    world = armature.matrix_world
    places.append([list(Y_UP @ (world @ bone.head)) for bone in bones])
    frames = [((world @ bone.matrix).to_3x3().normalized(), (world @ bone.bone.matrix_local).to_3x3().normalized())
              for bone in bones]
    turns.append([list((Y_UP @ now @ rest.inverted() @ Y_UP.transposed()).to_quaternion()) for now, rest in frames])
  bpy.context.view_layer.objects.active = armature
  armature.select_set(True)
  for other in again:
    WRITE[pathlib.Path(other).suffix](other)
  pathlib.Path(out).write_text(json.dumps({"names": [bone.name for bone in bones], "places": places, "turns": turns,
                                           "reader": f"Blender {bpy.app.version_string}"}))


main(*sys.argv[1:])
