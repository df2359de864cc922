"""Joint positions as tables: .csv for spreadsheets and scripts, .trc for OpenSim, .c3d for motion laboratories.

All hold where joints are and not how they turn. Any of them is read by the names of its points, as a .bvh is; `mapping`
names those that are not known.
"""
import errno
import os
import pathlib
import re
import struct
import warnings
from typing import NamedTuple

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.data.mocap import native
from motion_jax.motion import plausibility
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.rigs.joint_maps import map_joints, own_joints, skeleton_of
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.install import pip_install
from motion_jax.utils.numerals import named
from motion_jax.utils.text_files import LARGEST_MOTION, read_lines, split_cells

_MEMORY = 2e9  # bytes of address space of the process that reads a C3D file
_OPENSIM = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])    # y up, facing +z -> y up, facing +x
_LABORATORY = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # y up, facing +z -> z up, facing +x


class Points(NamedTuple):
  """Named points of a file, in its own unit and axes."""
  names: list[str]
  positions: np.ndarray        # (T, N, 3), NaN in gaps
  fps: float | None            # None: not stated
  unit: str = ""               # stated by the file
  axes: np.ndarray | None = None  # (3, 3), points @ axes are y up and face +z, in files as their programs write them


def _metres(clip):
  return np.asarray(clip.joints, np.float64) * clip.skeleton.unit


def csv(clip, path) -> pathlib.Path:
  """Writes frame, time and x, y, z of each joint, a row per frame: seconds and metres, y up, facing +z."""
  head = ["frame", "time", *(f"{name}_{axis}" for name in clip.skeleton.joints for axis in "xyz")]
  rows = [",".join([str(frame), f"{frame / clip.fps:.6f}", *(f"{value:.6f}" for value in pose.ravel())])
          for frame, pose in enumerate(_metres(clip))]
  return _write(path, [",".join(head), *rows])


def trc(clip, path) -> pathlib.Path:
  """Writes the joints as OpenSim's markers: millimetres, y up, facing +x."""
  names, rate, count = clip.skeleton.joints, f"{clip.fps:.10g}", clip.num_frames
  lines = [f"PathFileType\t4\t(X/Y/Z)\t{pathlib.Path(path).name}",
           "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
           f"{rate}\t{rate}\t{count}\t{len(names)}\tmm\t{rate}\t1\t{count}",
           "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
           "\t\t" + "\t".join(f"{axis}{number}" for number in range(1, len(names) + 1) for axis in "XYZ"), ""]
  lines += ["\t".join([str(frame + 1), f"{frame / clip.fps:.6f}", *(f"{value:.3f}" for value in pose.ravel())])
            for frame, pose in enumerate(1000 * _metres(clip) @ _OPENSIM.T)]
  return _write(path, lines)


def c3d(clip, path) -> pathlib.Path:
  """Writes the joints as the points of a C3D file: millimetres, z up, facing +x. Needs the extra `c3d` (ezc3d)."""
  file = _ezc3d().c3d()
  points = np.ones((4, clip.skeleton.num_joints, clip.num_frames))
  points[:3] = (1000 * _metres(clip) @ _LABORATORY.T).transpose(2, 1, 0)
  file["parameters"]["POINT"]["RATE"]["value"] = [float(clip.fps)]
  file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
  file["parameters"]["POINT"]["LABELS"]["value"] = tuple(clip.skeleton.joints)
  file["data"]["points"] = points
  with atomic_path(path) as temporary:
    file.write(str(temporary))
    if not _is_whole(temporary):  # ezc3d does not say when the disk is full
      raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
  return pathlib.Path(path)


def read_csv(path, fps=None) -> Points | Clip:
  """A table that names its columns as `csv` does. One of numbers alone is a robot's (`motion_jax.robots`): a Clip.

  fps: frame rate of the file, replacing that of its column of times.
  """
  lines = [line for line in read_lines(path, "CSV file", LARGEST_MOTION) if line.strip()]
  notes = [line.lstrip("# ") for line in lines if line.startswith("#")]  # numpy.savetxt writes the header so
  lines = [line for line in lines if not line.startswith("#")]
  head, *cells = split_cells(lines) or [[]]
  is_bare = bool(head) and all(map(_is_number, head))
  if is_bare and notes and any(map(_COORDINATE.fullmatch, split_cells(notes[-1:])[0])):
    lines, is_bare = [notes[-1], *lines], False
    head, *cells = split_cells(lines)
  if is_bare:
    from motion_jax import robots
    if len(head) not in (36, 30):
      raise InputError(f"{path}: got {len(head)} numbers a row and no header, expected 36 or 30 (a Unitree G1: root "
                       "position, quaternion, 29 or 23 angles), or a header of columns NAME_x, NAME_y, NAME_z")
    return robots.read_csv(path, robots.load("g1").with_joints(len(head) - 7), None, fps).to_clip()
  columns, units = {}, set()  # {(name, axis): column}
  for number, title in enumerate(head):
    if match := _COORDINATE.fullmatch(title):
      columns[match["name"], match["axis"].lower()] = number
      units.add(match["unit"] or "")
  names = [name for name, axis in columns if axis == "x" and {(name, "y"), (name, "z")} <= columns.keys()]
  if not names:
    raise InputError(f"{path}: got the header {lines[0][:60] if lines else ''!r}, expected columns NAME_x, NAME_y, "
                     "NAME_z of each joint, or a Unitree G1's 36 numbers a row without a header")
  rows = _rows(path, cells, len(head), 2)
  points = rows[:, [[columns[name, axis] for axis in "xyz"] for name in names]]
  if fps is None:
    fps = _rate_of_table(path, head, rows)
  return Points(names, points, fps, units.pop() if len(units) == 1 else "")


# Columns of coordinates: pelvis_x, pelvis.X, pelvisX, "pelvis x (mm)", pelvis_pos_x, pelvis[x], pelvis.Xposition.
_POSITION = "(?i:pos|position|translation|location|loc|t)"
_COORDINATE = re.compile(rf"(?P<name>.*?[^\W_])(?:[ _.:\[(-]+(?:{_POSITION}[ _.:-]*)?|(?<=[a-z0-9])(?=[XYZ]))"
                         rf"(?P<axis>[xyzXYZ])[\])]?(?:[ _.]?{_POSITION})?"
                         r"(?:[ _]*[\[(]?(?P<unit>mm|cm|m|in|ft)[\])]?)?")
# Columns of times: time, Time, t, "Time [s]", time_ms, seconds; seconds of a unit.
_TIMES = "time", "time stamp", "timestamp", "timestamps", "t", "elapsed", "elapsed time"
_UNITS_OF_TIME = {unit: seconds for units, seconds in (
    ("s sec secs second seconds", 1.0), ("ms msec millisecond milliseconds", 1e-3),
    ("us usec µs μs microseconds", 1e-6), ("ns nsec nanoseconds", 1e-9)) for unit in units.split()}


def _time_unit(title):
  """Seconds of the unit of a column of times; None for another column."""
  words = " ".join(re.findall(r"[^\W_]+", title.lower()))
  name, _, unit = words.rpartition(" ")
  if words in _TIMES:
    return 1.0
  return _UNITS_OF_TIME.get(unit) if name in _TIMES or not name and len(unit) > 1 else None


def _rate_of_table(path, head, rows):
  """The rate by a column of times; None, with a warning, where there is none."""
  times = [(number, unit) for number, title in enumerate(head) if (unit := _time_unit(title))]
  if times and len(rows) > 1:
    number, unit = times[0]
    return _rate(rows[:, number] * unit, path)
  if len(rows) > 1:
    warnings.warn(f"{path} has no column of times, taken as {HUMANML3D.fps:g} frames a second; --fps (fps=) sets "
                  "another rate", stacklevel=2)
  return None


def read_trc(path, fps=None) -> Points:
  """A .trc file's markers."""
  lines = read_lines(path, "TRC file", LARGEST_MOTION)
  if len(lines) < 6 or not lines[0].startswith("PathFileType"):
    raise InputError(f"{path}: expected PathFileType and five more lines before the frames; it is cut or no TRC file")
  about = dict(zip(lines[1].split("\t"), lines[2].split("\t")))
  names = [name for name in lines[3].rstrip().split("\t")[2:] if name]
  cells = [line.rstrip("\r\n").split("\t") for line in lines[5:] if line.strip()]
  rows = _rows(path, [row[:2 + 3 * len(names)] for row in cells], 2 + 3 * len(names), 6)
  if fps is None:
    fps = float(about["DataRate"]) if _is_number(about.get("DataRate", "")) else _rate(rows[:, 1], path)
  points = rows[:, 2:].reshape(len(rows), len(names), 3)
  return Points(names, points, fps, about.get("Units", ""), _OPENSIM)


def read_c3d(path, fps=None) -> Points:
  """The points of a C3D file. Needs the extra `c3d`."""
  if not _is_whole(path):
    raise InputError(f"{path} is cut or no C3D file")
  file = native.read("C3D", path, library="ezc3d", extra="c3d", advice="or export a .trc or .csv from the program that "
                     "made it", memory=_MEMORY)
  points = file["points"]
  return Points(file["labels"].tolist()[:points.shape[1]], points, fps or float(file["rate"]), file["units"].item(),
                _LABORATORY)


POINTS = {".csv": read_csv, ".trc": read_trc, ".c3d": read_c3d}


def load_points(path, fps, unit, up, mapping) -> Clip:
  """The Clip of a file of `POINTS`."""
  read = POINTS[path.suffix.lower()](path, fps)
  if isinstance(read, Clip):
    return read
  points = read.positions if up or read.axes is None else read.positions @ read.axes
  unit = read.unit.lower() if unit == "auto" and read.unit.lower() in plausibility.UNITS else unit
  return _clip(path, read.names, points, read.fps, unit, up or "y", mapping)


def _is_whole(path):
  """Whether a C3D file ends where its frames do: ezc3d fills a cut one with zeros. Source: c3d.org, header section."""
  data = path.read_bytes()[:512]
  if len(data) == 512 and data[1] == 0x50:
    points, analog, first, last, _, scale, start = struct.unpack_from("<4Hhfh", data, 2)
    size = (4 * points + analog) * (4 if scale < 0 else 2) * (last - first + 1) + 512 * (start - 1)
    return path.stat().st_size >= size
  return False


def _clip(path, names, points, fps, unit, up, mapping):
  """Points (T, N, 3) of a file as the joints of a known skeleton. Points that no joint depends on may have gaps."""
  skeleton = HUMANML3D if mapping else skeleton_of(names)
  own_skeleton = skeleton is not HUMANML3D
  read = lambda at: own_joints(names, at, skeleton) if own_skeleton else map_joints(names, at, mapping)[0]
  gaps = ~np.isfinite(points)
  if gaps.all():
    raise InputError(f"{path}: all of its points are missing in all frames")
  size = np.ptp(points[~gaps]) if gaps.any() else 0.0
  joints = read(np.where(gaps, np.mean(points[~gaps]), points))
  if gaps.any():  # whatever stands in the gaps, the joints are the same
    off = np.abs(read(np.where(gaps, np.mean(points[~gaps]) + size, points)) - joints).max((1, 2))
    if off.max() > 1e-4 * size:
      frame = int(np.argmax(off > 1e-4 * size))
      lost = [name for name, gap in zip(names, gaps[frame].any(-1)) if gap] or ["a joint"]
      raise InputError(f"{path}: point {named(lost, 4)} of frame {frame + 1} is missing; fill gaps first")
    warnings.warn(f"{path}: {named([name for name, gap in zip(names, gaps.any((0, 2))) if gap], 6)} have gaps, and no "
                  "joint depends on them", stacklevel=3)
  joints = plausibility.to_unit(joints, skeleton, unit, up, str(path))
  rate = skeleton.fps if fps is None else fps  # a rate of 0 is refused, not replaced
  return Clip(joints.astype(np.float32), rate, id=path.stem, source=path.name, skeleton=skeleton)


def _rows(path, cells, width, first):
  """Numbers (T, width) of the cells of lines, NaN of empty ones; first: the number of the first line."""
  for number, row in enumerate(cells, first):
    if len(row) != width or not all(_is_number(cell) or _is_gap(cell) for cell in row):
      raise InputError(f"{path} row {number}: got {len(row)} cells, expected {width} numbers; it is cut")
  if not cells:
    raise InputError(f"{path}: it has a header but no frames; it is cut")
  return np.array([["nan" if _is_gap(cell) else cell for cell in row] for row in cells], np.float64)


def _rate(times, path):
  steps = np.diff(times)
  if not (len(steps) and (steps > 0).all() and steps.max() < 1.1 * steps.min() + 2e-6):
    raise InputError(f"{path}: its times do not rise evenly; give the rate by --fps (fps=)")
  rate = float(1 / steps.mean())
  return float(round(rate)) if abs(rate - round(rate)) < 0.01 else rate


def _is_gap(cell):
  return cell.strip().lower() in ("", "nan")


def _is_number(cell):
  return bool(re.fullmatch(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*", cell))


def _write(path, lines):
  with atomic_path(path) as temporary:
    temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
  return pathlib.Path(path)


def _ezc3d():
  try:
    import ezc3d
  except ImportError:
    raise _no_ezc3d() from None
  return ezc3d


def _no_ezc3d():
  return InputError(f".c3d files are written by ezc3d: {pip_install('c3d')}; .trc and .csv need nothing")
