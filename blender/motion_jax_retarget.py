"""Blender add-on: puts a generated motion on your own character, by names of Mixamo, Rigify, Unreal, VRM and others.

Install this file beside motion_jax_addon.py. Select the armature that moves, then your character's with Ctrl, so that
it is the active one, and press "Put on active armature" (3D view, sidebar, tab Motion). Bones turn in the world as
those of the motion do, from the rest pose of each; arms and legs that rest in other directions (A-pose) are turned
first. The pelvis moves by the ratio of the heights. Needs only the standard library; all but the operator works without
Blender.
"""
import math
import re

bl_info = {"name": "motion_jax retarget", "author": "motion_jax", "version": (0, 1, 0), "blender": (4, 0, 0),
           "location": "3D View > Sidebar > Motion", "description": "Motions on your own character",
           "category": "Animation"}

# Trunk from pelvis to head; arm and leg of a side, whose word stands in place of "+".
RIGS = {
    "Mixamo, HumanIK, LAFAN": ("Hips Spine Spine1 Spine2 Neck Head", "+Shoulder +Arm +ForeArm +Hand",
                               "+UpLeg +Leg +Foot +ToeBase|+Toe", "Left Right"),
    "Rigify": ("DEF-spine DEF-spine.001 DEF-spine.002 DEF-spine.003 DEF-spine.004 DEF-spine.006",
               "DEF-shoulder.+ DEF-upper_arm.+ DEF-forearm.+ DEF-hand.+",
               "DEF-thigh.+ DEF-shin.+ DEF-foot.+ DEF-toe.+", "L R"),
    "Rigify metarig": ("spine spine.001 spine.002 spine.003 spine.004 spine.006",
                       "shoulder.+ upper_arm.+ forearm.+ hand.+", "thigh.+ shin.+ foot.+ toe.+", "L R"),
    "Unreal 5": ("pelvis spine_01 spine_03 spine_05 neck_01 head", "clavicle_+ upperarm_+ lowerarm_+ hand_+",
                 "thigh_+ calf_+ foot_+ ball_+", "l r"),
    "Unreal 4": ("pelvis spine_01 spine_02 spine_03 neck_01 head", "clavicle_+ upperarm_+ lowerarm_+ hand_+",
                 "thigh_+ calf_+ foot_+ ball_+", "l r"),
    "VRM, Unity": ("hips spine chest upperChest neck head", "+Shoulder +UpperArm +LowerArm +Hand",
                   "+UpperLeg +LowerLeg +Foot +Toes", "left right"),
    "VRoid": ("J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_Chest J_Bip_C_UpperChest J_Bip_C_Neck J_Bip_C_Head",
              "J_Bip_+_Shoulder J_Bip_+_UpperArm J_Bip_+_LowerArm J_Bip_+_Hand",
              "J_Bip_+_UpperLeg J_Bip_+_LowerLeg J_Bip_+_Foot J_Bip_+_ToeBase", "L R"),
    "motion_jax": ("pelvis spine1 spine2 spine3 neck head", "+_collar +_shoulder +_elbow +_wrist",
                   "+_hip +_knee +_ankle +_foot", "left right"),
}
TRUNK = "pelvis", "spine1", "spine2", "spine3", "neck", "head"
ARM, LEG = ("collar", "shoulder", "elbow", "wrist"), ("hip", "knee", "ankle", "foot")
SIDES = "left", "right"
NEEDED = {"pelvis", *(f"{side}_{joint}" for side in SIDES for joint in (*ARM[1:], *LEG[:3]))}
# The joint to which a limb's bone points; what is not here keeps the direction that it rests in.
NEXT = {f"{side}_{a}": f"{side}_{b}" for side in SIDES for a, b in (
    ("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"))}


# --- without Blender -------------------------------------------------------------------------------------------------


def plain(name):
  """A bone's name without marks and prefix, in lower case."""
  return re.sub(r"[-_ .]", "", re.sub(r"^character\d+_", "", name.split(":")[-1].lower()))


def find_bones(names):
  """({our joint: bone}, rig) for the rig most of whose names are there. Raises ValueError that says what is missing."""
  own = {}
  for name in names:
    own.setdefault(plain(name), name)
  best, label = {}, ""
  for rig, (trunk, arm, leg, words) in RIGS.items():
    wanted = dict(zip(TRUNK, trunk.split()))
    for side, word in zip(SIDES, words.split()):
      for joints, row in ((ARM, arm), (LEG, leg)):
        wanted |= {f"{side}_{joint}": name.replace("+", word) for joint, name in zip(joints, row.split())}
    found = {joint: own[plain(name)] for joint, entry in wanted.items() for name in entry.split("|")
             if plain(name) in own}
    if len(found) > len(best):
      best, label = found, rig
  missing = sorted(NEEDED - set(best))
  if missing:
    raise ValueError(f"its bones are nearest to those of {label or 'no known rig'}, without {', '.join(missing)}; "
                     f"expected names of {', '.join(RIGS)}")
  return best, label


def multiply(p, q):
  a, b, c, d = p
  e, f, g, h = q
  return (a * e - b * f - c * g - d * h, a * f + b * e + c * h - d * g,
          a * g - b * h + c * e + d * f, a * h + b * g - c * f + d * e)


def conjugate(q):
  return q[0], -q[1], -q[2], -q[3]


def rotate(q, v):
  return multiply(multiply(q, (0.0, *v)), conjugate(q))[1:]


def between(a, b):
  """The least rotation that brings the direction of a to that of b; none for a direction that is opposite or zero."""
  length = math.sqrt(sum(x * x for x in a) * sum(x * x for x in b))
  cosine = sum(x * y for x, y in zip(a, b)) / length if length else -1.0
  if cosine < -0.999999:
    return 1.0, 0.0, 0.0, 0.0
  cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
  q = (1 + cosine, *(x / length for x in cross))
  norm = math.sqrt(sum(x * x for x in q))
  return tuple(x / norm for x in q)


def subtract(a, b):
  return tuple(x - y for x, y in zip(a, b))


def corrections(source, target):
  """{joint: rotation of the target's rest pose into the source's}, for rest places {joint: (x, y, z)} of both."""
  found = {}
  for joint, after in NEXT.items():
    if all(joint in rest and after in rest for rest in (source, target)):
      found[joint] = between(subtract(target[after], target[joint]), subtract(source[after], source[joint]))
  for side in SIDES:  # a hand lies in line with its forearm
    if f"{side}_elbow" in found:
      found[f"{side}_wrist"] = found[f"{side}_elbow"]
  return found


def pelvis_height(rest):
  """Of the pelvis above the lower ankle, in a rest pose of places with z up."""
  return rest["pelvis"][2] - min(rest[f"{side}_ankle"][2] for side in SIDES)


def turn(moved, rested, correction, rest):
  """How a target's bone is turned in the world, whose rest is `rest`, as the source's has moved from rested."""
  return multiply(multiply(multiply(moved, conjugate(rested)), correction), rest)


# --- with Blender ----------------------------------------------------------------------------------------------------


def put_on(source, target, scene):
  """Copies the motion of an armature to another, a key per frame; returns (the rig's name, number of bones)."""
  if source.animation_data is None or source.animation_data.action is None:
    raise ValueError(f"{source.name} does not move; select the armature with the motion, then your character's")
  theirs, _ = find_bones([bone.name for bone in source.data.bones])
  ours, label = find_bones([bone.name for bone in target.data.bones])
  joints = [joint for joint in ours if joint in theirs]
  world = {thing: thing.matrix_world.to_quaternion() for thing in (source, target)}
  at_rest = lambda thing, bones: {joint: tuple(thing.matrix_world @ thing.data.bones[name].head_local)
                                  for joint, name in bones.items()}
  rests = at_rest(source, theirs), at_rest(target, ours)
  fix = corrections(*rests)
  ratio = pelvis_height(rests[1]) / pelvis_height(rests[0])
  floor = min(rests[1][f"{side}_ankle"][2] for side in SIDES)
  of = {ours[joint]: joint for joint in joints}
  order = _parents_first(target.data.bones)
  rest = {bone.name: world[target] @ bone.matrix_local.to_quaternion() for bone in order}
  first, last = (round(frame) for frame in source.animation_data.action.frame_range)
  lowest = math.inf  # of the motion's ankles, which is where the target's stand
  for frame in range(first, last + 1):
    scene.frame_set(frame)
    lowest = min(lowest, *((source.matrix_world @ source.pose.bones[theirs[f"{side}_ankle"]].head).z for side in SIDES))
  target.animation_data_clear()
  target.animation_data_create()
  for frame in range(first, last + 1):
    scene.frame_set(frame)
    now = {}
    for bone in order:
      pose, joint = target.pose.bones[bone.name], of.get(bone.name)
      above = now[bone.parent.name] if bone.parent else world[target]
      local = (rest[bone.parent.name] if bone.parent else world[target]).inverted() @ rest[bone.name]
      if joint is None:
        now[bone.name] = above @ local
        continue
      one = source.pose.bones[theirs[joint]]
      moved = world[source] @ one.matrix.to_quaternion()
      rested = world[source] @ one.bone.matrix_local.to_quaternion()
      q = type(moved)(turn(tuple(moved), tuple(rested), fix.get(joint, (1.0, 0, 0, 0)), tuple(rest[bone.name])))
      now[bone.name] = q
      pose.rotation_mode = "QUATERNION"
      basis = (above @ local).inverted() @ q
      if frame > first and basis.dot(pose.rotation_quaternion) < 0:
        basis.negate()
      pose.rotation_quaternion = basis
      pose.keyframe_insert("rotation_quaternion", frame=frame)
      if joint == "pelvis":
        goal = (source.matrix_world @ one.head) * ratio
        goal.z += floor - lowest * ratio
        pose.location = bone.matrix_local.to_quaternion().inverted() @ (
            target.matrix_world.inverted() @ goal - bone.head_local)
        pose.keyframe_insert("location", frame=frame)
  target.animation_data.action.name = f"{source.animation_data.action.name} on {target.name}"[:60]
  return label, len(joints)


def _parents_first(bones):
  order = [bone for bone in bones if bone.parent is None]
  for bone in order:
    order.extend(bone.children)
  return order


def _classes():
  import bpy

  class PutOn(bpy.types.Operator):
    """Put the motion of the other selected armature on the active one"""
    bl_idname, bl_label, bl_options = "motion_jax.put_on", "Put on active armature", {"REGISTER", "UNDO"}

    def execute(self, context):
      target = context.view_layer.objects.active
      others = [thing for thing in context.selected_objects if thing.type == "ARMATURE" and thing is not target]
      try:
        if target is None or target.type != "ARMATURE" or len(others) != 1:
          raise ValueError("select the armature with the motion, then your character's with Ctrl")
        label, count = put_on(others[0], target, context.scene)
      except ValueError as error:
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}
      self.report({"INFO"}, f"{count} joints on bones of {label}")
      return {"FINISHED"}

  class RetargetPanel(bpy.types.Panel):
    bl_idname, bl_label, bl_category = "VIEW3D_PT_motion_jax_retarget", "Your character", "Motion"
    bl_space_type, bl_region_type = "VIEW_3D", "UI"

    def draw(self, context):
      self.layout.operator(PutOn.bl_idname)

  return PutOn, RetargetPanel


_registered = []


def register():
  import bpy
  _registered.extend(_classes())
  for one in _registered:
    bpy.utils.register_class(one)


def unregister():
  import bpy
  while _registered:
    bpy.utils.unregister_class(_registered.pop())


if __name__ == "__main__":
  register()
