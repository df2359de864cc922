"""BVH motion capture files: a skeleton of offsets, then one line of channel values per frame.

Any channel order per joint; position channels on any joint take the place of its OFFSET, axis by axis (the Bandai files
have them everywhere). End Sites become joints named after their parent with "_end", for some figures keep their toes
there.
"""
import collections
import pathlib
import warnings

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.data.mocap import capture
from motion_jax.data.mocap.capture import Capture, forward_kinematics, to_clip, with_rate
from motion_jax.motion import rotations as rot
from motion_jax.utils import text_files
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import FRAME_RATES, NumberError, shortened, whole

_COUNTS = tuple("0123456")
_CHANNELS = tuple(axis + kind for kind in ("position", "rotation") for axis in "XYZ")


def read_bvh(path) -> Capture:
  """Reads a BVH file and runs its forward kinematics, float64.

  Raises FileNotFoundError, or ValueError with the line for a file that is cut, has a wrong count of numbers, or NaN.
  """
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}; expected a BVH file")
  lines = text_files.read_lines(path, "BVH file", text_files.LARGEST_MOTION)
  names, parents, offsets, channels, motion = _read_hierarchy(path, lines)
  values, fps = _read_motion(path, lines, motion, sum(map(len, channels)), len(names))
  local, rotations = _local(values, offsets, channels)
  positions, turned = forward_kinematics(parents, local, rotations)
  return Capture(tuple(names), tuple(parents), np.array(offsets), tuple(channels), fps, positions, rotations, turned)


def bvh_clip(path, mapping=None, fps=20.0, source_fps=None, **options) -> Clip:
  """A BVH file as a Clip of 22 joints: `read_bvh` and `capture.to_clip`, whose options these are.

  source_fps: its frames per second, whatever the file states.
  """
  return to_clip(with_rate(read_bvh(path), source_fps), path, mapping, fps, **options)


def _read_hierarchy(path, lines):
  """names, parents, offsets, channels, and the index of the line MOTION."""
  names, parents, offsets, channels, ends = [], [], [], [], set()
  open_joints, pending, seen = [], None, False
  for number, line in enumerate(lines, 1):
    words = collections.deque(line.replace("{", " { ").replace("}", " } ").split())
    take = lambda count, words=words: [words.popleft() for _ in range(min(count, len(words)))]
    while words:
      word = words.popleft()
      key = word.upper()
      if key == "HIERARCHY":
        seen = True
      elif key == "MOTION":
        if open_joints or pending is not None:
          raise InputError(f"{path} line {number}: MOTION comes before {shortened(names[-1])!r} is closed; the "
                           "skeleton is cut")
        if not names:
          raise InputError(f"{path} line {number}: no ROOT before MOTION; this is no BVH file")
        return names, parents, offsets, channels, number
      elif not seen:
        raise InputError(f"{path} line {number}: got {line.strip()[:40]!r}, expected HIERARCHY; this is no BVH file")
      elif key in ("ROOT", "JOINT", "END"):
        label = " ".join(take(next((count for count, other in enumerate(words) if other == "{"), len(words))))
        if open_joints and open_joints[-1] in ends:
          raise InputError(f"{path} line {number}: {shortened(label)!r} is inside an End Site, which has no joints")
        if key == "END":
          ends.add(len(names))
        parents.append(open_joints[-1] if open_joints else -1)
        names.append(f"{names[parents[-1]]}_end" if key == "END" else label.split(":")[-1])
        offsets.append(np.zeros(3))
        channels.append(())
        pending = len(names) - 1
      elif word == "{" and pending is not None:
        open_joints.append(pending)
        pending = None
      elif word == "}" and open_joints:
        open_joints.pop()
      elif key == "OFFSET" and open_joints:
        offsets[open_joints[-1]] = _numbers(path, number, take(3), 3)
      elif key == "CHANNELS" and open_joints:
        given = take(1)
        count = int(given[0]) if given and given[0] in _COUNTS else 0
        given += take(count)
        own = tuple(name[:1].upper() + name[1:].lower() for name in given[1:])
        if given[:1] != [str(len(own))] or any(name not in _CHANNELS for name in own):
          raise InputError(f"{path} line {number}: got {shortened(' '.join(given))!r}, expected a count and as many of "
                           f"{', '.join(_CHANNELS)}")
        channels[open_joints[-1]] = own
      else:
        raise InputError(f"{path} line {number}: {shortened(word)!r} has no place here in a BVH skeleton")
  raise InputError(f"{path} line {len(lines)}: the file ends before MOTION; it is cut or no BVH file")


def _read_motion(path, lines, at, width, num_joints):
  """Channel values (T, width) and frames per second, from the lines after MOTION."""
  head = [(number, line) for number, line in enumerate(lines[at:], at + 1) if line.strip()]
  fields = {}
  for number, line in head[:2]:
    name, _, value = line.partition(":")
    fields[name.strip().lower()] = (number, value.strip())
  if not {"frames", "frame time"} <= set(fields):
    raise InputError(f"{path} line {at + 1}: expected 'Frames: N' and 'Frame Time: seconds' after MOTION; "
                     "the file is cut")
  number, text = fields["frames"]
  try:
    num_frames = whole(1, unit="frames")(text)
  except NumberError as error:
    raise InputError(f"{path} line {number}: {error}") from None
  seconds = _numbers(path, fields["frame time"][0], fields["frame time"][1].split(), 1)[0]
  slowest, fastest = FRAME_RATES
  if not 0.99 / fastest <= seconds <= 1.01 / slowest:
    raise InputError(f"{path} line {fields['frame time'][0]}: got a frame time of {seconds:g} s, expected "
                     f"{1 / fastest:g} to {1 / slowest:g}")
  rows = head[2:]
  if len(rows) < num_frames:
    raise InputError(f"{path} line {len(lines)}: the file ends after {len(rows)} of {num_frames} frames; it is cut")
  surplus = len(rows) - num_frames
  if surplus:
    more = next((i for i, (_, line) in enumerate(rows[num_frames:]) if not _is_row(line, width)), surplus)
    warnings.warn(f"{path}: its header says {num_frames} frames, {len(rows)} lines follow; {num_frames + more} frames "
                  "are read", stacklevel=4)
    num_frames += more
  capture.check_size(path, num_frames, num_joints)
  values = np.empty((num_frames, width))
  for row, (number, line) in zip(values, rows):
    row[:] = _numbers(path, number, line.split(), width)
  fps = 1 / seconds
  return values, round(fps) if abs(fps - round(fps)) < 0.01 else fps  # files write 0.0333333 for a thirtieth


def _is_row(line, width):
  """Whether a line may be a frame; if it is, but damaged, `_numbers` says so."""
  words = line.split()
  return len(words) == width and all(word[:1] in "+-.0123456789" for word in words)


def _numbers(path, number, words, count):
  if len(words) != count:
    raise InputError(f"{path} line {number}: got {len(words)} numbers, expected {count}; the file is cut or damaged")
  try:
    values = np.array(words, np.float64)
  except ValueError:
    raise InputError(f"{path} line {number}: {' '.join(words)[:60]!r} are not all numbers") from None
  if not np.isfinite(values).all():
    raise InputError(f"{path} line {number}: number {int(np.argmin(np.isfinite(values))) + 1} is NaN or infinite")
  return values


def _local(values, offsets, channels):
  """Positions (T, N, 3) and rotations (T, N, 4) relative to the parents; rotations multiply in channel order."""
  local = np.tile(np.array(offsets), (len(values), 1, 1))
  rotations = np.zeros(local.shape[:2] + (4,))
  rotations[..., 0] = 1
  starts = np.cumsum([0, *map(len, channels)])
  for own in set(channels):  # joints of the same channels together
    joints = np.array([joint for joint, other in enumerate(channels) if other == own])
    columns = {name: values[:, starts[joints] + i] for i, name in enumerate(own)}  # (T, K) each; the last of a name
    # MakeHuman writes poses whose position channels are zero: those joints stay where OFFSET puts them.
    places = {name[0].lower(): value for name, value in columns.items() if name.endswith("position")}
    moved = np.max([np.abs(value).max(0) for value in places.values()], axis=0, initial=0)
    moves = (joints == 0) | (moved >= 0.01 * np.linalg.norm(np.array(offsets)[joints], axis=-1))
    for axis, value in places.items():
      local[:, joints[moves], "xyz".index(axis)] = value[:, moves]
    for name, value in columns.items():
      if name.endswith("rotation"):
        turn = rot.about_axis(np.radians(value), name[0].lower())
        rotations[:, joints] = rot.multiply(rotations[:, joints], turn)
  return local, rotations
