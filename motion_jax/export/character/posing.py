"""Put a motion on a character: every bone turns as its counterpart does, seen from a T-pose that both share.

Rotations are those of the world, corrected by the rest poses: world = motion * correction * rest, where the correction
brings the character's limbs at rest onto those of the motion's T-pose (its feet only about the vertical). So neither
the roll of bones nor an A-pose matters. The legs then reach the feet's places by `retarget.bend_leg`: a foot that
stands keeps standing, whatever the character's proportions.
"""
import dataclasses
from typing import NamedTuple

import numpy as np

from motion_jax.export.character.figure import Figure
from motion_jax.export.character.neutral import eased, is_own
from motion_jax.export.rig import rigged
from motion_jax.motion import looping
from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import pose_to_joints
from motion_jax.motion.retarget import bend_leg, firmness, floor_height, foot_move
from motion_jax.motion.skeleton import HUMANML3D, SIDES
from motion_jax.shapes import Float

_LINES = {"shoulder": "elbow", "elbow": "wrist", "hip": "knee", "knee": "ankle"}  # the next joint of a limb
_TURNS_WITH = {"wrist": "elbow", "foot": "ankle"}
_FLOOR_PERCENTILE = 5  # of the lower sole's height over the clip, as in `retarget`


class Posed(NamedTuple):
  """The M bones of a character in its own frame and size (`Figure`), over T frames."""
  turned: Float[np.ndarray, "t m 4"]   # world rotations
  places: Float[np.ndarray, "t m 3"]


def pose_figure(figure: Figure, clip, t_pose: bool = False) -> Posed:
  """A clip of HumanML3D's 22 joints on a character. t_pose: one more frame before it, of the T-pose."""
  if looping.is_loop(clip.joints, clip.skeleton):
    turn, pad = looping.turn_of_round(clip.joints, clip.skeleton), looping.around(clip.num_frames, clip.fps)
    wide = _pose(figure, clip.replace(joints=looping.rounds(clip.joints, pad, turn), features=None))
    places, turns = looping.close(wide.places[pad:-pad], wide.turned[pad:-pad], turn)
  else:
    turns, places = _pose(figure, clip)
  if t_pose:
    still = _follow(figure, np.tile([1.0, 0, 0, 0], (1, HUMANML3D.num_joints, 1)),
                    corrections(figure, rigged(clip).offsets))
    at = _forward(figure, still)
    at += np.array([1, 0, 1]) * (places[:1, :1] - at[:, :1])
    at[..., 1] -= _sole_height(figure, still, at)[0]
    turns, places = np.concatenate([still, turns]), np.concatenate([at, places])
  return Posed(turns, places)


def _pose(figure, clip):
  pose, skeleton = rigged(clip), HUMANML3D
  joints = pose_to_joints(pose, skeleton)
  turned, size = pose.turned, skeleton.bone_lengths[[4, 7, 5, 8]].sum() / np.linalg.norm(
      pose.offsets[[4, 7, 5, 8]], axis=-1).sum()
  joints = joints * size  # a clip of a child, or of a giant, on legs of the usual length
  fixed = corrections(figure, pose.offsets)
  is_own = _is_own(figure, pose.offsets * size, fixed)
  if not is_own:
    turned = eased(turned, joints, pose.offsets, clip.fps)
  turns = _follow(figure, turned, fixed)
  joints[..., 1] -= floor_height(joints, skeleton)
  places = _forward(figure, turns)
  hips = lambda at: at[:, [figure.parts["left_hip"], figure.parts["right_hip"]]].mean(1)
  places += (joints[:, list(skeleton.hips)].mean(1) - hips(places))[:, None]
  if not is_own:  # else its feet are where the motion has them
    turns, places = _stand(figure, joints, turns, places, pose.offsets * size)
  places[..., 1] -= np.percentile(_sole_height(figure, turns, places), _FLOOR_PERCENTILE)
  return Posed(turns, places)


def corrections(figure: Figure, offsets: Float[np.ndarray, "j 3"]) -> Float[np.ndarray, "j 4"]:
  """Rotations of each joint's bone from the character's reference pose to the T-pose of offsets (22, 3)."""
  skeleton, parts = HUMANML3D, figure.parts
  turns = np.tile([1.0, 0, 0, 0], (skeleton.num_joints, 1))
  of = {name: number for number, name in enumerate(skeleton.joints)}
  for side in SIDES:
    for limb in (("hip", "knee"), ("shoulder", "elbow")):
      turn = np.array([1.0, 0, 0, 0])
      for joint in limb:
        here, after = f"{side}_{joint}", f"{side}_{_LINES[joint]}"
        bone, goal = figure.places[parts[after]] - figure.places[parts[here]], offsets[of[after]]
        if np.linalg.norm(bone) > 1e-6:
          turn = rot.multiply(rot.between(rot.unit(rot.rotate(turn, bone)), rot.unit(goal)), turn)
        turns[of[here]] = turn
    if f"{side}_foot" in parts:
      foot = figure.places[parts[f"{side}_foot"]] - figure.places[parts[f"{side}_ankle"]]
      goal = offsets[of[f"{side}_foot"]]
      angle = lambda v: np.arctan2(v[0], v[2])
      if np.hypot(foot[0], foot[2]) > 0.3 * np.linalg.norm(foot):
        turns[of[f"{side}_ankle"]] = rot.about_axis(np.array(angle(goal) - angle(foot)), "y")
    for joint, other in _TURNS_WITH.items():
      turns[of[f"{side}_{joint}"]] = turns[of[f"{side}_{other}"]]
  return turns


def _is_own(figure, offsets, fixed):
  """Whether the character is of the motion's own skeleton: in the T-pose its joints are where that has them."""
  at = _forward(figure, _follow(figure, np.tile([1.0, 0, 0, 0], (1, HUMANML3D.num_joints, 1)), fixed))[0]
  bones = figure.parts | dict(zip(("spine1", "spine2", "spine3"), figure.bones.spine)) | dict(
      zip(("neck",), figure.bones.neck))
  places = np.zeros((HUMANML3D.num_joints, 3))
  known = {joint: HUMANML3D.joints.index(joint) for joint in bones}
  for joint, number in known.items():
    places[number] = at[bones[joint]]
  return len(figure.bones.spine) == 3 and len(figure.bones.neck) == 1 and is_own(places, offsets, list(known.values()))


def _follow(figure, turned, fixed):
  """World rotations (T, M, 4) of the bones, from those of the motion (T, 22, 4) and the corrections (22, 4)."""
  of = {name: number for number, name in enumerate(HUMANML3D.joints)}
  motion = rot.multiply(turned, fixed[None])
  result = np.empty((len(turned), len(figure.nodes), 4))
  for joint, bone in figure.parts.items():
    result[:, bone] = motion[:, of[joint]]
  for bones, keys, last in ((figure.bones.spine, ("spine1", "spine2", "spine3"), True),
                            (figure.bones.neck, ("neck", "head"), False)):
    count = len(bones)
    at = np.linspace(0, len(keys) - 1, count + (not last))[:count] if count > 1 or not last else [len(keys) - 1]
    for bone, place in zip(bones, at):
      first = min(int(place), len(keys) - 2)
      result[:, bone] = rot.slerp(motion[:, of[keys[first]]], motion[:, of[keys[first + 1]]], place - first)
  return rot.multiply(result, figure.turned[None])


def _forward(figure, turns):
  """Places (T, M, 3) of the bones, the pelvis at the origin."""
  places = np.zeros((*turns.shape[:2], 3))
  for bone, parent in enumerate(figure.parents):
    if parent >= 0:
      places[:, bone] = places[:, parent] + rot.rotate(turns[:, parent], figure.offsets[bone][None])
  return places


def _stand(figure, joints, turns, places, offsets):
  """Rotations and places after the feet have gone where the motion's stand."""
  skeleton, parts = HUMANML3D, figure.parts
  lengths = skeleton.bone_lengths.copy()
  result, legs = joints.copy(), [chain[1:] for chain in skeleton.chains[:2]]
  for leg in legs:
    names = [skeleton.joints[joint] for joint in leg]
    for joint, name in zip(leg, names):
      if name in parts:
        result[:, joint] = places[:, parts[name]]
    for joint, name in zip(leg[1:3], names[1:3]):
      lengths[joint] = np.linalg.norm(figure.offsets[parts[name]])
    if names[3] not in parts:  # toes where the motion's T-pose has them
      turn = rot.multiply(turns[:, parts[names[2]]], rot.conjugate(figure.turned[parts[names[2]]])[None])
      result[:, leg[3]] = result[:, leg[2]] + rot.rotate(turn, offsets[leg[3]][None])
  body = dataclasses.replace(skeleton, bone_lengths=lengths)
  moves = [foot_move(joints, result, leg, 1.0) for leg in legs]
  for leg, side, move in zip(legs, ("right", "left"), moves):
    ankle, toes = leg[2], leg[3]
    # The sole's lowest point is as far above the floor as the motion's foot is, whichever part of it is the lowest.
    clearance = np.minimum(joints[:, toes, 1], joints[:, ankle, 1] + offsets[toes, 1]).clip(0)
    depth = places[:, parts[f"{side}_ankle"], 1] - _sole_height(figure, turns, places, side)
    move[:, 1] = depth + clearance - joints[:, ankle, 1]
    move[:, [0, 2]] += _stance(figure, joints, side, leg)
  lift = np.median([move[:, 1] for move in moves])
  result[..., 1] += lift
  turns, places = turns.copy(), places + [0, lift, 0]
  for leg, move in zip(legs, moves):
    bend_leg(joints, result, leg, move, body)
    for joint, after in zip(leg[:2], leg[1:3]):
      bone, below = parts[skeleton.joints[joint]], parts[skeleton.joints[after]]
      now = rot.unit(rot.rotate(turns[:, bone], figure.offsets[below][None]))
      goal = rot.unit(result[:, after] - result[:, joint])
      turns[:, bone] = rot.unit(rot.multiply(rot.between(now, goal), turns[:, bone]))
  root = places[:, :1] + 0
  places = _forward(figure, turns)
  places += root - places[:, :1]
  return turns, places


def _stance(figure, joints, side, leg):
  """How much farther out (T, 2), along x and z, a foot stands than in the motion: as much as the hip is farther from
  the pelvis. It is constant while the foot stands."""
  skeleton, parts = HUMANML3D, figure.parts
  across = joints[:, skeleton.hips[1]] - joints[:, skeleton.hips[0]]
  wide = np.linalg.norm(figure.places[parts["left_hip"]] - figure.places[parts["right_hip"]])
  more = (wide - np.median(np.linalg.norm(across, axis=-1))) / 2 * (1 if side == "left" else -1)
  level = across[:, [0, 2]] / np.maximum(np.linalg.norm(across[:, [0, 2]], axis=-1, keepdims=True), 1e-9)
  return more * _held(level, firmness(joints[:, leg[2]], 1.0))


def _held(path, firm, pull=1e-3):
  """The path (T, N) nearest to this one that stays in firm steps (T - 1,).

  It solves min sum firm |step|^2 + pull |off the path|^2.
  """
  from scipy.linalg import solveh_banded
  if len(path) < 3:
    return path
  diagonal = pull + np.append(firm, 0) + np.append(0, firm)
  return solveh_banded(np.stack([np.append(0, -firm), diagonal]), pull * path)


def _sole_height(figure, turns, places, side=None):
  """The height (T,) of the lowest point of the soles, of one side or of both."""
  sides = SIDES if side is None else (side,)
  bones = {figure.parts.get(f"{name}_{joint}") for name in sides for joint in ("ankle", "foot")}
  soles = {bone: points for bone, points in figure.soles.items() if bone in bones} or figure.soles
  return np.min([(places[:, bone, None] + rot.rotate(turns[:, bone, None], points[None]))[..., 1].min(1)
                 for bone, points in soles.items()], axis=0)
