"""Animations of glTF files (.glb, .gltf, .vrm) as motion capture."""
import pathlib
import shlex

import numpy as np

from motion_jax.data.mocap.capture import Capture, check_size, to_clip, with_rate
from motion_jax.data.mocap.gltf import Document, take_apart, world_matrices
from motion_jax.motion import rotations as rot
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import FRAME_RATES

_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
_ROUNDED = 1e-4  # seconds: files hold times as float32, which may be later than the frame that they mean
_RATES = 24.0, 25.0, 30.0, 48.0, 50.0, 60.0, 120.0, 20.0, 15.0, 12.5, 100.0


def animation_names(document) -> list[str]:
  """The names of a file's animations; "animation 1" for one without."""
  with document.checked():
    return [str(one.get("name") or f"animation {number}") for number, one in enumerate(document.json.get(
        "animations", ()), 1)]


def choose(names, wanted, path) -> int:
  """The index of one of several clips by its name or number (from 1); None: the only one there is."""
  if not names:
    raise InputError(f"{path}: it holds no animation, expected one; export it with its animations")
  listed = ", ".join(f"{number} {name!r}" for number, name in enumerate(map(lambda one: one[:40], names[:12]), 1))
  listed += f" and {len(names) - 12} more" * (len(names) > 12)
  if wanted is None:
    if len(names) > 1:
      raise InputError(f"{path}: it holds {len(names)} animations ({listed}); name one behind the file: "
                       f"{shlex.quote(f'{path}#1')}, or #NAME")
    return 0
  if str(wanted) in names:
    return names.index(str(wanted))
  if str(wanted).isdecimal() and 1 <= int(wanted) <= len(names):
    return int(wanted) - 1
  raise InputError(f"{path}: got clip {str(wanted)[:60]!r}, expected one of {listed}")


def read_gltf(path, animation=None) -> Capture:
  """An animation of a glTF file as a Capture of its bones, sampled at the rate of its keys.

  animation: its name or number, from 1; not needed for a file that holds one. Bones are the joints of the skins, and
  without a skin all nodes that are animated. Raises InputError for a file without animation or bones.
  """
  path = pathlib.Path(path)
  document = Document(path)
  number = choose(animation_names(document), animation, path)
  with document.checked():
    return _capture(document, number, path)


def _capture(document, number, path):
  tracks = _tracks(document, document.json["animations"][number], path)
  if not tracks:
    raise InputError(f"{path}: its animation moves no node; choose another one")
  about = [one.get("extras") for one in (document.json["animations"][number], document.json["asset"])]
  rate = next((one["fps"] for one in about if isinstance(one, dict) and "fps" in one), None)
  times = np.unique(np.concatenate([track[0] for track in tracks.values()]))
  fps = float(rate) if isinstance(rate, int | float) and FRAME_RATES[0] <= rate <= FRAME_RATES[1] else _rate(times)
  count = int(np.floor((times[-1] - times[0]) * fps + 1e-3)) + 1
  human = _human_bones(document)
  bones = {*(human or bones_of(document) or (node for node, _ in tracks))}
  bones = bones & document.shown or bones
  nodes = [node for node in document.order if node in bones]
  check_size(path, count, len(document.nodes))
  rest = document.rest()
  moving = {kind: np.tile(values, (count, 1, 1)) for kind, values in zip(("translation", "rotation", "scale"), rest)}
  at = times[0] + np.arange(count) / fps
  for (node, kind), track in tracks.items():
    moving[kind][:, node] = _sampled(*track, at, kind == "rotation")
  names = [human.get(node) or document.name(node) for node in range(len(document.nodes))]
  return bone_capture(path, names, document.parents, nodes, rest, list(moving.values()), fps)


def _human_bones(document):
  """{node: VRM's name of the bone} of a VRM animation (.vrma), whose nodes may have any names; {} of other files."""
  about = document.json.get("extensions", {}).get("VRMC_vrm_animation")
  bones = about["humanoid"]["humanBones"] if about else {}
  return {bone["node"]: name for name, bone in bones.items()}


def bone_capture(path, names, parents, nodes, rest, moving, fps) -> Capture:
  """The Capture of some nodes of N, parents first, by translations, rotations and scales (N, ...) and (T, N, ...).

  What lies between two of them is carried along. Rotations are those from the rest pose.
  """
  order = np.argsort(_depths(parents), kind="stable").tolist()
  still, world = (world_matrices(order, parents, *parts)[..., nodes, :, :] for parts in (rest, moving))
  places_of = {node: place for place, node in enumerate(nodes)}
  own_parents = []
  for node in nodes:
    above = parents[node]
    while above >= 0 and above not in places_of:
      above = parents[above]
    own_parents.append(places_of.get(above, -1))
  return world_capture(path, [names[node] for node in nodes], own_parents, still, world, fps)


def world_capture(path, names, parents, still, world, fps, unit=None, usual="metres") -> Capture:
  """The Capture of N joints, parents first, by their world matrices at rest (N, 4, 4) and in motion (T, N, 4, 4).

  unit, usual: see `Capture`; with a unit the matrices are in it.
  """
  if not np.isfinite(world).all():
    raise InputError(f"{path}: its animation holds NaN or infinity; export it again")
  above = np.maximum(parents, 0)
  roots = np.array(parents) < 0
  rest_places, rest_turned, _ = take_apart(still)
  places, turned, _ = take_apart(world)
  turned = rot.continuous(rot.multiply(turned, rot.conjugate(rest_turned)[None]))
  offsets = rest_places - np.where(roots[:, None], 0, rest_places[above])
  local = rot.multiply(rot.conjugate(turned[:, above]), turned)
  local[:, roots] = turned[:, roots]
  metres = unit or 1.0
  return Capture(tuple(names), tuple(parents), offsets * metres, ((),) * len(names), fps, places * metres, local,
                 turned, unit, usual)


def _depths(parents):
  """How many nodes are above each; every node is walked over once."""
  depths = [-1] * len(parents)
  for node in range(len(parents)):
    way = []
    while node >= 0 and depths[node] < 0:
      way.append(node)
      node = parents[node]
    depth = depths[node] if node >= 0 else -1
    for above in reversed(way):
      depth += 1
      depths[above] = depth
  return depths


def joints_of(document) -> list[int]:
  """The nodes that are joints of any skin."""
  with document.checked():
    return sorted({joint for skin in document.json.get("skins", ()) for joint in skin["joints"]})


def bones_of(document) -> list[int]:
  """The joints of the skins; all nodes of their trees but meshes where an animation moves further ones of these: skins
  may hold a part of a skeleton."""
  bones = set(joints_of(document))
  with document.checked():
    moved = {channel["target"].get("node") for animation in document.json.get("animations", ())
             for channel in animation["channels"]}
    tops = set()
    for bone in bones:
      line = [bone]
      while document.parents[line[-1]] >= 0:
        line.append(document.parents[line[-1]])
      tops.add(next(node for node in reversed(line) if node in bones or node in moved))
    below = set()
    for node in document.order:
      if node in tops or document.parents[node] in below:
        below.add(node)
    below = {node for node in below if "mesh" not in document.nodes[node]}
    return sorted(bones | below if moved & below - bones else bones)


def nearest(document, node, among) -> int:
  """The position in `among` of the nearest node above a node that is among them, or -1."""
  places = {one: place for place, one in enumerate(among)}
  while (node := document.parents[node]) >= 0:
    if node in places:
      return places[node]
  return -1


def _tracks(document, animation, path):
  """{(node, kind): (times (K,), values (K, W), interpolation)} of an animation."""
  tracks = {}
  for channel in animation["channels"]:
    target = channel["target"]
    kind, node = target["path"], target.get("node")
    if node is None or kind not in _WIDTHS:  # morph targets, and what extensions animate
      continue
    sampler = animation["samplers"][channel["sampler"]]
    way = sampler.get("interpolation", "LINEAR")
    times, values = document.array(sampler["input"])[:, 0], document.array(sampler["output"])
    expected = len(times) * (3 if way == "CUBICSPLINE" else 1)
    document.nodes[node]
    if not len(times) or values.shape != (expected, _WIDTHS[kind]) or not (np.diff(times) > 0).all():
      raise InputError(f"{path}: the {kind} of node {document.name(node)!r} has {len(times)} times, rising or not, and "
                       f"values of shape {values.shape}; export the file again")
    tracks[node, kind] = times, values[:, [3, 0, 1, 2]] if kind == "rotation" else values, way
  return tracks


def _sampled(times, values, way, at, is_rotation):
  """Values of a track at times (T,), by the track's own interpolation."""
  after = np.clip(np.searchsorted(times, at, side="right"), 1, max(len(times) - 1, 1))
  if len(times) == 1:
    keys = values[1:2] if way == "CUBICSPLINE" else values
    found = np.repeat(keys, len(at), 0)
  else:
    before = after - 1
    span = times[after] - times[before]
    weight = np.clip((at - times[before]) / span, 0, 1)
    if way == "STEP":
      found = values[np.maximum(np.searchsorted(times, at + _ROUNDED, side="right") - 1, 0)]
    elif way == "CUBICSPLINE":
      tangent_in, keys, tangent_out = values[0::3], values[1::3], values[2::3]
      u, scale = weight[:, None], span[:, None]
      found = ((2 * u ** 3 - 3 * u ** 2 + 1) * keys[before] + (u ** 3 - 2 * u ** 2 + u) * scale * tangent_out[before]
               + (3 * u ** 2 - 2 * u ** 3) * keys[after] + (u ** 3 - u ** 2) * scale * tangent_in[after])
    elif is_rotation:
      found = rot.slerp(rot.unit(values[before]), rot.unit(values[after]), weight)
    else:
      found = values[before] + weight[:, None] * (values[after] - values[before])
  return rot.unit(found) if is_rotation else found


def _rate(times):
  """The rate whose frames the most keys lie on; of equals the first of the usual rates."""
  if len(times) < 2:
    return 30.0
  on = [np.mean(np.abs((times - times[0]) * rate - np.round((times - times[0]) * rate)) < 0.02) for rate in _RATES]
  if max(on) > 0.9:
    return _RATES[int(np.argmax(np.array(on) > max(on) - 0.01))]
  return float(np.clip(np.round(1 / np.median(np.diff(times)), 2), *FRAME_RATES))


def gltf_clip(path, mapping=None, fps=20.0, source_fps=None, clip=None, **options):
  """An animation of a glTF file as a Clip of 22 joints: `read_gltf` and `capture.to_clip`, whose options these are."""
  return to_clip(with_rate(read_gltf(path, clip), source_fps), path, mapping, fps, **{"up": "y"} | options)
