"""Export motions as one HTML file that any browser shows offline: a three.js viewer with the motion inside.

The viewer (assets/viewer.js) is built from tools/viewer; the page loads nothing from the network.
"""
import base64
import html as html_lib
import json
import pathlib
import re
from typing import TYPE_CHECKING

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.export.body import make_figure
from motion_jax.export.mesh import make_skins, rest_joints
from motion_jax.export.scene import distance, parts_of
from motion_jax.motion.figure import COLORS
from motion_jax.motion.pose import t_pose
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.motion.step_records import lines
from motion_jax.rigs.joint_names import ARMS, LEGS
from motion_jax.utils.atomic import atomic_path

if TYPE_CHECKING:
  from motion_jax.control.signal import ControlSignal

_ASSETS = pathlib.Path(__file__).parent / "assets"
VIEWER = _ASSETS / "viewer.js"
_LIMBS = {"legs": list(LEGS), "arms": list(ARMS)}  # names of a character's bones, for the viewer


def html(clip, path, title=None, colors=None, control=None, way_points=()) -> pathlib.Path:
  """Writes a page that plays one clip, or a list of clips side by side with a selector.

  colors: (3,) or (T, 3) values 0..1 that replace the body's colours, for instance in regenerated frames; NaN keeps
  them. control: a `ControlSignal` (1, T) of constraints, or one for each; it is drawn, and the page states the distance
  of the motion from it. way_points: [x, z] of the points that its path was drawn through.
  """
  path = pathlib.Path(path)
  text = html_page(clip, title, colors, control, way_points)
  with atomic_path(path) as temporary:
    temporary.write_text(text, encoding="utf-8")
  return path


def html_page(clip, title=None, colors=None, control=None, way_points=()) -> str:
  """The page that `html` writes."""
  clips = [clip] if isinstance(clip, Clip) else list(clip)
  signals = control if isinstance(control, list | tuple) else [control] * len(clips)
  bodies, described = [], []
  for item, signal in zip(clips, signals):
    figure = make_figure(item)
    tints = {} if colors is None else {"tints": _tints(colors, item.num_frames)}
    wish = {} if signal is None else _constraints(item, signal, way_points)
    described.append(_describe(item, figure) | tints | wish | {"body": _body_of(bodies, item.skeleton, figure)})
  data = {"clips": described, "bodies": [body for *_, body in bodies], "colors": COLORS}
  title = title or (clips[0].captions[0].text if clips[0].captions else clips[0].id)
  page = (_ASSETS / "viewer.html").read_text(encoding="utf-8")
  # A "<" in a caption must not end the script element: in JSON it may be written as \u003c.
  values = {"@TITLE@": html_lib.escape(title), "@DATA@": json.dumps(data, ensure_ascii=False).replace("<", "\\u003c"),
            "@STEPS@": _steps_of(clips), "@VIEWER@": VIEWER.read_text(encoding="utf-8")}
  return re.sub("|".join(values), lambda match: values[match[0]], page)  # one pass: values are not searched again


def _steps_of(clips):
  """The steps of the motions (`motion.step_records`), a line for each, as an element that opens on a click."""
  rows = [f"motion {number}: {line}" if len(clips) > 1 else line
          for number, clip in enumerate(clips, 1) for line in lines(clip.meta)]
  if not rows:
    return ""
  return f'<details id="steps"><summary>steps</summary><div>{html_lib.escape(chr(10).join(rows))}</div></details>\n'


def resting_body(skeleton: Skeleton = HUMANML3D) -> dict:
  """A skeleton's own body in its T-pose as JSON for the viewer, for a page that hangs it on joints that come later."""
  bodies = []
  rest = rest_joints(t_pose(skeleton), skeleton)
  rest[:, 1] -= rest[:, 1].min()  # the lowest joint on the ground, as that of a model's motion is
  figure = make_figure(Clip(rest[None].repeat(2, axis=0), skeleton.fps, skeleton=skeleton))
  _body_of(bodies, skeleton, figure)
  return bodies[0][-1] | {"colors": COLORS, "names": list(skeleton.joints), "limbs": _LIMBS,
                          "parents": [int(parent) for parent in skeleton.parents]}


def _describe(clip, figure):
  """A clip as JSON for the viewer: joints float32 and rotations int16 in base64, metres."""
  joints = figure.joints.astype("<f4")
  captions = clip.captions or ()
  return {"name": captions[0].text if captions else clip.id, "fps": clip.fps, "frames": clip.num_frames,
          "numJoints": joints.shape[1], "floor": round(figure.floor, 5),
          "captions": [{"text": c.text, "start": c.start, "end": c.end} for c in captions],
          "joints": _base64(joints), "turned": _base64(np.round(figure.pose.turned * 32767).astype("<i2")),
          "low": _round(joints.min((0, 1))), "high": _round(joints.max((0, 1))), "start": _round(joints[0, 0, [0, 2]]),
          "ahead": _round(figure.ahead.mean(0)[[0, 2]])}


def _constraints(clip, signal: "ControlSignal", way_points):
  """{constraints, low, high} of a clip: marks of a signal (1, T) and the motion's distance from it; bounds of both."""
  parts = parts_of(signal)
  figures = [make_figure(Clip(joints[None].astype(np.float32))) for _, joints in parts.poses]
  points = [*way_points, *(way[0, [0, 2]] for way in parts.ways if len(way) == 1)]
  drawn = {"lines": [_thin(way) for way in parts.ways if len(way) > 1], "points": [_round(point) for point in points],
           "targets": [[frame, *_round(place)] for frame, _, place in parts.targets],
           "poses": [{"frame": frame, "joints": _base64(figure.joints.astype("<f4")),
                      "turned": _base64(np.round(figure.pose.turned * 32767).astype("<i2"))}
                     for (frame, _), figure in zip(parts.poses, figures)]}
  drawn |= {"off": off} if (off := distance(signal, clip)) else {}
  places = [clip.joints.reshape(-1, 3), *parts.ways, *(place[None] for *_, place in parts.targets),
            *(joints for _, joints in parts.poses)]
  return {"constraints": drawn, "low": _round(np.min([place.min(0) for place in places], axis=0)),
          "high": _round(np.max([place.max(0) for place in places], axis=0))}


def _thin(way, most=300):
  """[[x, z], ...] of a path (N, 3), thinned to at most `most` points."""
  return [_round(way[i, [0, 2]]) for i in np.unique(np.linspace(0, len(way) - 1, min(most, len(way))).astype(int))]


def _tints(colors, num_frames):
  """[{first, past, color}]: spans of frames in one colour."""
  colors = np.asarray(colors, np.float64)
  if colors.shape not in ((3,), (num_frames, 3)):
    raise ValueError(f"got colors of shape {colors.shape}, expected (3,) or ({num_frames}, 3)")
  colors = np.broadcast_to(colors, (num_frames, 3))
  starts = np.flatnonzero(np.concatenate([[True], (np.diff(colors, axis=0) != 0).any(1)]))
  return [{"first": int(first), "past": int(past), "color": _round(colors[first])}
          for first, past in zip(starts, [*starts[1:], num_frames]) if not np.isnan(colors[first]).any()]


def _body_of(bodies, skeleton, figure):
  """The number of the body (skeleton, offsets, flesh, JSON) that fits a figure, appended to bodies if there is none.

  Clips whose bones differ by less than a centimetre share a skin, for the viewer moves its joints to their places in
  any case; clips whose soles differ visibly do not.
  """
  offsets = figure.pose.offsets
  flesh = np.array([(*part.a_offset, *part.b_offset) for part in figure.parts])
  for number, (other, known, covered, _) in enumerate(bodies):
    if other is skeleton and np.abs(known - offsets).max() < 0.01 and np.abs(covered - flesh).max() < 0.01:
      return number
  rest = rest_joints(offsets, skeleton)
  skins = make_skins(figure.parts, rest, skeleton)
  reach = float(max(np.abs(skin.points).max() for skin in skins))
  described = [{"group": skin.group, "points": _base64(np.round(skin.points / reach * 32767).astype("<i2")),
                "normals": _base64(np.round(skin.normals * 127).astype("i1")),
                "joints": _base64(skin.joints.astype("u1")), "weights": _base64(skin.weights.astype("u1")),
                "triangles": _base64(skin.triangles.astype("<u2"))} for skin in skins]
  bodies.append((skeleton, offsets, flesh, {"rest": [_round(at) for at in rest], "reach": reach, "skins": described}))
  return len(bodies) - 1


def _round(values):
  return [round(float(value), 5) for value in values]


def _base64(array):
  return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
