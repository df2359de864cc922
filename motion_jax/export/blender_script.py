"""Runs in Blender's Python, which has nothing of ours: blender_script.py MOTION.glb MOTION.fbx FPS."""
import sys


def show_rest(armature, scene):
  """Goes to a frame before the motion in which the armature rests: the exporter takes the current pose for the rest."""
  frame = scene.frame_start - 1
  for bone in armature.pose.bones:
    bone.matrix_basis.identity()
    for path in ("location", "rotation_quaternion", "scale"):
      bone.keyframe_insert(path, frame=frame)
  scene.frame_set(frame)


def convert(source, target, fps):
  """A .glb as .fbx. Bones keep the axes of the nodes, so that the rest pose of the rig stays without rotations."""
  import bpy
  bpy.ops.wm.read_factory_settings(use_empty=True)
  scene = bpy.context.scene
  scene.render.fps, scene.render.fps_base = round(fps), round(fps) / fps
  bpy.ops.import_scene.gltf(filepath=source, bone_heuristic="BLENDER")
  for thing in [thing for thing in bpy.data.objects if thing.type not in ("ARMATURE", "MESH", "EMPTY") or
                thing.name.startswith("Icosphere")]:  # the shape in which the importer draws bones
    bpy.data.objects.remove(thing)
  action = bpy.data.actions[0]
  scene.frame_start, scene.frame_end = (round(frame) for frame in action.frame_range)
  scene.name = action.name  # what the exported take is called
  show_rest(next(thing for thing in bpy.data.objects if thing.type == "ARMATURE"), scene)
  bpy.ops.export_scene.fbx(filepath=target, object_types={"ARMATURE", "MESH"}, add_leaf_bones=False,
                           bake_anim_use_nla_strips=False, bake_anim_use_all_actions=False,
                           bake_anim_simplify_factor=0.0, apply_scale_options="FBX_SCALE_ALL")


if __name__ == "__main__":
  convert(sys.argv[-3], sys.argv[-2], float(sys.argv[-1]))
