"""Animate a user's own rigged character: write motions into its .glb, .gltf or .vrm file as further animations.

Mesh, materials, textures, morph targets and existing animations keep their bytes: an animation is added to the file's
JSON, and its keys are appended to the buffer.
"""
import pathlib

import numpy as np

from motion_jax.data.mocap.files import read_mapping
from motion_jax.data.mocap.gltf import ENDINGS, take_apart
from motion_jax.export.character.figure import Figure, read_figure
from motion_jax.export.character.posing import Posed, pose_figure
from motion_jax.export.glb import clip_name, facts
from motion_jax.export.rig import root_path
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError

OUTPUTS = (".glb", ".vrm")
_MOVED = 1e-3  # leg lengths: a bone that moves further than this relative to its parent gets position keys


def check_character(file, mapping=None) -> Figure:
  """The character of a file, or an InputError that states what is wrong with it."""
  file = pathlib.Path(file)
  if file.suffix.lower() not in ENDINGS:
    advice = "; Blender converts it: File, Import, then File, Export, glTF 2.0" * (file.suffix.lower() == ".fbx")
    raise InputError(f"got the character {file.name!r}, expected a file that ends in {', '.join(ENDINGS)}{advice}")
  return read_figure(file, read_mapping(mapping))


def character(clips, path, file=None, mapping=None, t_pose=False, name=None, replace=False) -> pathlib.Path:
  """Writes the character of `file` with one more animation for each clip (or one clip), named by its caption.

  They come before the animations that the file has, for most players play the first. path: .glb or .vrm. mapping:
  {joint of HumanML3D: bone's name}, a dict or a JSON file, for bones whose names are not known (`rigs.bones`).
  t_pose: the first frame is a T-pose. name: of the animation, instead of its caption. replace: without the animations
  that the file has. Raises InputError for a file that is no rigged character.
  """
  path = pathlib.Path(path)
  if file is None:
    raise InputError(f"got {path.name!r} without a character to write into it; give a rigged .vrm or .glb by "
                     "--character (file=)")
  if path.suffix.lower() not in OUTPUTS:
    raise InputError(f"got {path.name!r} for a character, expected a file that ends in {' or '.join(OUTPUTS)}")
  clips = list(clips) if isinstance(clips, list | tuple) else [clips]
  for clip in clips:
    if clip.skeleton is not HUMANML3D:
      raise InputError(f"got a motion of skeleton {clip.skeleton.name!r} for a character, expected HumanML3D's 22 "
                       "joints")
  with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # `Document.add` refuses what comes of it
    figure = check_character(file, mapping)
    there = [] if replace else figure.document.json.get("animations", [])
    added: list[dict] = []
    for clip in clips:
      label = _unused(name or clip_name(clip), [*there, *added])
      added.append(_animation(figure, pose_figure(figure, clip, t_pose), clip, label))
  figure.document.json["animations"] = [*added, *there]
  return figure.document.write(path)


def _animation(figure, posed: Posed, clip, name):
  """An animation of the character's document, whose keys are added to its buffer."""
  document, frames = figure.document, len(posed.turned)
  times = document.add((np.arange(frames) / clip.fps)[:, None], "SCALAR", bounds=True)
  samplers, channels = [], []

  def add(node, kind, values, shape):
    samplers.append({"input": times, "output": document.add(values, shape), "interpolation": "LINEAR"})
    channels.append({"sampler": len(samplers) - 1, "target": {"node": node, "path": kind}})

  for node, moved, turned in _local(figure, posed, clip):
    _without_matrix(document.nodes[node])
    if moved is not None:
      add(node, "translation", moved, "VEC3")
    add(node, "rotation", rot.continuous(turned)[:, [1, 2, 3, 0]], "VEC4")
  caption = {"caption": clip.captions[0].text} if clip.captions else {}
  return {"name": name, "samplers": samplers, "channels": channels,
          "extras": {"fps": float(clip.fps)} | caption | facts(clip)}


def _without_matrix(node):
  """Gives a node translation, rotation and scale for its matrix, which a node that is animated may not have."""
  if "matrix" in node:
    moved, turned, scale = take_apart(np.array(node.pop("matrix"), np.float64).reshape(4, 4).T)
    node.update(translation=moved.tolist(), rotation=turned[[1, 2, 3, 0]].tolist(), scale=scale.tolist())


def _unused(name, animations):
  """The name, with a number after it if an animation has it already."""
  there = {animation.get("name") for animation in animations if isinstance(animation, dict)}
  return name if name not in there else next(f"{name}_{number}" for number in range(2, len(there) + 3)
                                             if f"{name}_{number}" not in there)


def _local(figure, posed, clip):
  """(node, positions (T, 3) or None, rotations (T, 4)) of each bone, relative to its parent node in the file."""
  document = figure.document
  rest = document.world(*document.rest())
  turned = rot.multiply(figure.out[None, None], posed.turned)
  places = rot.rotate(figure.out[None, None], posed.places) * figure.scale + figure.origin
  nodes = list(figure.nodes)
  for bone, twin in figure.copies:  # turned against the bone as it is at rest
    _, rest_turn, _ = take_apart(rest[figure.nodes[bone]])
    _, still, _ = take_apart(rest[twin])
    nodes.append(twin)
    against = rot.multiply(rot.conjugate(rest_turn), still)[None]
    turned = np.concatenate([turned, rot.multiply(turned[:, bone], against)[:, None]], axis=1)
    places = np.concatenate([places, places[:, bone, None]], axis=1)
  if figure.root is not None:  # it moves over the ground from where it rests, as the body does
    pelvis = figure.parts["pelvis"]
    ground, facing = root_path(clip, posed.places[:, pelvis], rot.multiply(
        posed.turned[:, pelvis], rot.conjugate(figure.turned[pelvis])[None]))
    turn = rot.multiply(rot.multiply(figure.out[None], facing), rot.conjugate(figure.out)[None])
    anchor, still, _ = take_apart(rest[figure.root])
    nodes.append(figure.root)
    turned = np.concatenate([turned, rot.multiply(turn, still[None])[:, None]], axis=1)
    at = rot.rotate(figure.out[None], ground) * figure.scale + figure.origin
    places = np.concatenate([places, (at + rot.rotate(turn, (anchor - figure.origin)[None]))[:, None]], axis=1)
  bone_of = {node: bone for bone, node in enumerate(nodes)}
  for bone, node in enumerate(nodes):
    above = document.parents[node]
    base = above
    while base >= 0 and base not in bone_of:
      base = document.parents[base]
    # The node above, which stands still or is carried by the bone `base`: world = lead @ relative.
    relative = rest[above] if above >= 0 else np.eye(4)
    lead_turned, lead_place = np.array([[1.0, 0, 0, 0]]), np.zeros((1, 3))
    if base >= 0:
      anchor, held, _ = take_apart(rest[base])
      lead_turned = rot.multiply(turned[:, bone_of[base]], rot.conjugate(held)[None])
      lead_place = places[:, bone_of[base]] - rot.rotate(lead_turned, anchor[None])
    _, still, _ = take_apart(relative)
    local = rot.multiply(rot.conjugate(rot.multiply(lead_turned, still[None])), turned[:, bone])
    inner = rot.rotate(rot.conjugate(lead_turned), places[:, bone] - lead_place)
    moved = np.einsum("ij,tj->ti", np.linalg.inv(relative), np.concatenate([inner, np.ones((len(inner), 1))], 1))[:, :3]
    rest_place = np.linalg.inv(relative) @ rest[node, :, 3]
    size = np.linalg.norm(np.linalg.inv(relative)[:3, 0]) * figure.scale
    stays = base >= 0 and np.abs(moved - rest_place[:3]).max() < _MOVED * size
    yield node, None if stays else moved, rot.unit(local)


__all__ = ["character", "check_character"]
