"""ASF/AMC motion capture files (Acclaim): one skeleton per person, then the angles of each frame.

A bone of the ASF file turns about its own axes: R = C M C^-1 with C from `axis` and M from the AMC line. The joint at
the end of a bone takes the bone's name; the start of all is "root". CMU's units are inches / 0.45.
"""
import pathlib

import numpy as np

from motion_jax.data.mocap.capture import Capture, check_size, to_clip
from motion_jax.motion import rotations as rot
from motion_jax.utils import text_files
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import named, shortened

AMC_FPS = 120.0  # CMU's; AMC files do not say
_WITH_VALUE = ("axis", "name", "order", "direction", "length", "position", "orientation")
_DOFS = ("rx", "ry", "rz", "tx", "ty", "tz", "l")


def read_amc(path, skeleton=None, fps=AMC_FPS) -> Capture:
  """Reads an AMC file and its ASF skeleton; forward kinematics in float64, positions in metres if the ASF says inches.

  skeleton is the ASF file; None looks for one beside the AMC file: the same name, or the part before "_" (02_01.amc has
  02.asf). AMC files do not tell their rate; CMU's is 120. Raises FileNotFoundError, or ValueError with the line.
  """
  path = pathlib.Path(path)
  skeleton = pathlib.Path(skeleton) if skeleton else _find_skeleton(path)
  bones = read_asf(skeleton)
  lines = _lines(path)
  index = {name: i for i, name in enumerate(bones.names)}
  frames, current, degrees = [], None, True
  expected = {i for i, dofs in enumerate(bones.dofs) if dofs}
  for number, line in enumerate(lines, 1):
    words = line.split()
    if not words or words[0].startswith("#"):
      continue
    if words[0].startswith(":"):
      degrees = words[0].upper() != ":RADIANS" and degrees
    elif words[0].isdigit() and len(words) == 1:
      _check_whole(path, number, frames, current, expected, bones.names)
      current = {}
      frames.append(current)
      check_size(path, 2 * len(frames), len(bones.names))  # read bone by bone it takes twice the memory
    else:
      if current is None:
        raise InputError(f"{path} line {number}: got {shortened(words[0])!r}, expected the number of a frame")
      if words[0] not in index:
        raise InputError(f"{path} line {number}: bone {shortened(words[0])!r} is not in {skeleton.name}, which has "
                         f"{named(bones.names)}; give the skeleton that belongs to this file")
      bone = index[words[0]]
      current[bone] = _numbers(path, number, words[1:], len(bones.dofs[bone]))
  if not frames:
    raise InputError(f"{path}: no frame in it; the file is cut or no AMC file")
  _check_whole(path, len(lines), frames, current, expected, bones.names)
  positions, rotations, turned = _pose(bones, frames, 1.0 if not degrees else np.pi / 180)
  offsets = bones.directions * bones.lengths[:, None] * bones.unit
  return Capture(bones.names, bones.parents, offsets, bones.dofs, float(fps), positions, rotations, turned,
                 bones.unit if bones.unit != 1.0 else None)


def amc_clip(path, skeleton=None, source_fps=None, **options):
  """An AMC file as a Clip: `read_amc` and `capture.to_clip`, whose options these are."""
  return to_clip(read_amc(path, skeleton, source_fps or AMC_FPS), path, **options)


class _Bones:
  """An ASF file: names, parents, dofs (tuples), directions (N, 3), lengths (N,), axes (N, 4), root order, unit."""

  def __init__(self):
    self.names, self.dofs, self.directions, self.lengths, self.axes = ["root"], [()], [np.zeros(3)], [0.0], [None]
    self.parents, self.unit, self.degrees = [], 1.0, True
    self.position, self.orientation, self.root_axis = np.zeros(3), np.zeros(3), "XYZ"


def read_asf(path) -> _Bones:
  """Reads a skeleton. Raises ValueError with the line for what does not belong there."""
  path = pathlib.Path(path)
  bones, section, bone, parents = _Bones(), None, None, {}
  lines = _lines(path)
  for number, line in enumerate(lines, 1):
    words = line.split("#")[0].split()
    if not words:
      continue
    key = words[0].lower()
    if key in _WITH_VALUE and len(words) < 2 and section in (":root", ":bonedata"):
      raise InputError(f"{path} line {number}: {key} without a value; the file is cut or damaged")
    if key.startswith(":"):
      section = key
    elif section == ":units" and key == "length":
      # CMU: one unit is 1 / 0.45 inch. A length of 1 says nothing; then the legs show the unit.
      length = _numbers(path, number, words[1:], 1)[0]
      bones.unit = 0.0254 / length if length not in (0.0, 1.0) else 1.0
    elif section == ":units" and key == "angle":
      bones.degrees = words[1:] != ["rad"]
    elif section == ":root":
      if key == "order":
        bones.dofs[0] = _dofs(path, number, words[1:])
      elif key == "axis":
        bones.root_axis = _axes(path, number, words[1])
      elif key in ("position", "orientation"):
        setattr(bones, key, _numbers(path, number, words[1:], 3))
    elif section == ":bonedata":
      if key == "begin":
        bone = {"dof": (), "axis": (np.zeros(3), "XYZ")}
      elif key == "end":
        _add_bone(path, number, bones, bone)
        bone = None
      elif bone is not None and key == "name":
        bone["name"] = words[1]
      elif bone is not None and key == "direction":
        bone["direction"] = _numbers(path, number, words[1:], 3)
      elif bone is not None and key == "length":
        bone["length"] = _numbers(path, number, words[1:], 1)[0]
      elif bone is not None and key == "axis":
        bone["axis"] = _numbers(path, number, words[1:4], 3), _axes(path, number, words[4] if len(words) > 4 else "XYZ")
      elif bone is not None and key == "dof":
        bone["dof"] = _dofs(path, number, words[1:])
    elif section == ":hierarchy" and key not in ("begin", "end"):
      parents |= {child: words[0] for child in words[1:]}
  if section != ":hierarchy" or len(bones.names) < 2:
    raise InputError(f"{path} line {len(lines)}: no bones or no hierarchy up to here; the file is cut or no ASF file")
  return _in_order(path, bones, parents)


def _dofs(path, number, words):
  dofs = tuple(word.lower() for word in words)
  if set(dofs) - set(_DOFS) or len(set(dofs)) < len(dofs):
    raise InputError(f"{path} line {number}: got the channels {shortened(' '.join(words))}, expected some of "
                     f"{', '.join(_DOFS)}")
  return dofs


def _axes(path, number, text):
  if sorted(text.upper()) != ["X", "Y", "Z"]:
    raise InputError(f"{path} line {number}: got the axes {shortened(text)!r}, expected X, Y and Z in some order")
  return text.upper()


def _add_bone(path, number, bones, bone):
  missing = [key for key in ("name", "direction", "length") if key not in (bone or {})]
  if missing:
    raise InputError(f"{path} line {number}: a bone ends without its {', '.join(missing)}")
  bones.names.append(bone["name"])
  bones.dofs.append(bone["dof"])
  bones.directions.append(bone["direction"])
  bones.lengths.append(bone["length"])
  bones.axes.append(bone["axis"])


def _in_order(path, bones, parents):
  """Sorts bones so that parents come first, and turns their lists into arrays."""
  unknown = [name for name in bones.names[1:] if parents.get(name) not in bones.names]
  if "root" in parents:
    raise InputError(f"{path}: the hierarchy gives the root a parent, {shortened(parents['root'])!r}")
  if unknown:
    raise InputError(f"{path}: the hierarchy gives no parent that exists to {named(unknown, 5)}; the file is cut")
  order = [0]
  while len(order) < len(bones.names):
    more = [i for i, name in enumerate(bones.names) if i not in order and bones.names.index(parents.get(name)) in order]
    if not more:
      raise InputError(f"{path}: the hierarchy goes round in a circle")
    order += more
  names = [bones.names[i] for i in order]
  bones.parents = tuple(names.index(parents[name]) if name in parents else -1 for name in names)
  scale = np.pi / 180 if bones.degrees else 1.0
  axes = [(bones.orientation, bones.root_axis) if i == 0 else bones.axes[i] for i in order]
  bones.axes = np.stack([_euler(np.asarray(angles)[None] * scale, order_)[0] for angles, order_ in axes])
  bones.dofs = tuple(bones.dofs[i] for i in order)
  bones.directions = rot.unit(np.array([bones.directions[i] for i in order]), eps=1e-12)
  bones.lengths = np.array([bones.lengths[i] for i in order])
  bones.names = tuple(names)
  return bones


def _pose(bones, frames, scale):
  """World positions, rotations relative to the parent, world rotations."""
  count = len(bones.names)
  rotations = np.zeros((len(frames), count, 4))
  rotations[..., 0] = 1
  positions = np.zeros((len(frames), count, 3))
  turned = rotations.copy()
  for bone, dofs in enumerate(bones.dofs):
    values = np.array([frame[bone] for frame in frames]) if dofs else np.zeros((len(frames), 0))
    moved = np.zeros((len(frames), 3))
    spin = [i for i, dof in enumerate(dofs) if dof[0] == "r"]
    if spin:
      turn = _euler(values[:, spin] * scale, "".join(dofs[i][1] for i in spin).upper())
      axis = np.broadcast_to(bones.axes[bone], turn.shape)
      turn = rot.multiply(axis, turn)
      rotations[:, bone] = turn if bone == 0 else rot.multiply(turn, rot.conjugate(axis))
    for i, dof in enumerate(dofs):
      if dof[0] == "t":
        moved[:, "xyz".index(dof[1])] += values[:, i]
    parent = bones.parents[bone]
    if parent < 0:
      turned[:, bone] = rotations[:, bone]
      positions[:, bone] = bones.position + moved
      continue
    turned[:, bone] = rot.multiply(turned[:, parent], rotations[:, bone])
    length = bones.lengths[bone] + (values[:, dofs.index("l")] if "l" in dofs else 0.0)
    along = bones.directions[bone] * np.reshape(length, (-1, 1)) + moved
    positions[:, bone] = positions[:, parent] + rot.rotate(turned[:, bone], along)
  return positions * bones.unit, rotations, turned


def _euler(angles, order):
  """Radians (T, K) about the axes named by order, the first one turning first, to quaternions (T, 4)."""
  turn = np.tile([1.0, 0, 0, 0], (len(angles), 1))
  for axis, angle in zip(order.lower(), angles.T):
    turn = rot.multiply(rot.about_axis(angle, axis), turn)
  return turn


def _find_skeleton(path):
  for stem in (path.stem, path.stem.split("_")[0]):
    for suffix in (".asf", ".ASF"):
      if (candidate := path.with_name(stem + suffix)).is_file():
        return candidate
  raise FileNotFoundError(f"{path} has no skeleton beside it: expected {path.stem}.asf or "
                          f"{path.stem.split('_')[0]}.asf")


def _lines(path):
  return text_files.read_lines(path, "file", text_files.LARGEST_MOTION)


def _check_whole(path, number, frames, current, expected, names):
  if current is not None and (missing := expected - set(current)):
    lacks = named([names[i] for i in sorted(missing)], 5)
    raise InputError(f"{path} line {number}: frame {len(frames)} lacks {lacks}; the file is cut")


def _numbers(path, number, words, count):
  try:
    values = np.array(words, np.float64)
  except ValueError:
    raise InputError(f"{path} line {number}: {' '.join(words)[:60]!r} are not all numbers") from None
  if len(values) != count:
    raise InputError(f"{path} line {number}: got {len(values)} numbers, expected {count}; the file is cut or damaged")
  if not np.isfinite(values).all():
    raise InputError(f"{path} line {number}: NaN or infinity among the numbers")
  return values
