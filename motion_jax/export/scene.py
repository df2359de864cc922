"""Draw the constraints of a motion: its path on the floor, marks of targets, pale bodies in constrained poses.

Also draws a motion that covers ground from above, with its body at several moments.
"""
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from motion_jax.data.clip import Clip
from motion_jax.export import render
from motion_jax.export.body import default_colors, make_figure
from motion_jax.export.raster import pose_mesh

if TYPE_CHECKING:
  from motion_jax.control.constraints import Constraint
  from motion_jax.control.signal import ControlSignal

_PATH, _TARGET = (0.15, 0.62, 0.38), (0.88, 0.14, 0.40)  # green on the floor, red in the air
_BALL = 0.05         # metres, radius of a target's mark
_PALE = 0.72         # share of white in the colours of a constrained pose
_POSES, _BALLS = 10, 60  # most that are drawn
_GOES = (1.0, 3.0)   # metres; a motion that covers more is drawn from above: with constraints, without


class Marks(NamedTuple):
  """lines: on the floor, as `render.draw` takes them. bodies: balls and pale figures, at their frames."""
  lines: list[tuple[Any, tuple[float, float, float], float, float]]
  bodies: list[tuple[int, render.Body]]

  def of(self, figures: bool) -> list[int]:
    """The frames of poses, or of targets."""
    return sorted({frame for frame, body in self.bodies if (len(body[0]) > 1) == figures})

  def from_above(self, way: np.ndarray) -> bool:
    """Whether to draw a body on this path (T, 3) from above."""
    return bool(self.lines or self.bodies) and np.ptp(way, axis=0).max() > _GOES[not self.lines]


class Parts(NamedTuple):
  """The constraints of a signal to draw, world metres. ways: pieces (N, 3) of a path on the floor y = 0, of one
  point for a fixed place. targets: (frame, joint, place (3,)). poses: (frame, joints (22, 3)).
  """
  ways: list[np.ndarray]
  targets: list[tuple[int, int, np.ndarray]]
  poses: list[tuple[int, np.ndarray]]


def parts_of(signal: "ControlSignal") -> Parts:
  """The parts of a signal (1, T) to draw, at most as many as can be distinguished."""
  places, given = np.asarray(signal.positions, np.float64)[0], np.asarray(signal.given)[0]
  whole = given.all(-1)
  posed = whole.sum(1) >= 20
  on_path = given[:, 0][:, [0, 2]].all(-1) & ~posed
  ways = []
  for frames in _runs(np.flatnonzero(on_path)):
    way = places[frames, 0] * [1, 0, 1]
    ways.append(way[:1] if np.ptp(way, axis=0).max() < 0.02 else way)
  balls = [(int(frame), int(joint)) for frame, joint in np.argwhere(whole & ~posed[:, None])
           if joint or not on_path[frame]]
  return Parts(ways, [(frame, joint, places[frame, joint]) for frame, joint in _some(balls, _BALLS)],
               [(int(frame), places[frame]) for frame in _some(list(np.flatnonzero(posed)), _POSES)])


def drawn_constraints(constraints: Sequence["Constraint"], clips: Sequence[Clip], spans: Sequence[slice], path: str
                      ) -> dict[str, Any]:
  """The options of `export.save` that draw constraints on a page or picture of clips, cut to a span of frames each."""
  from motion_jax.control.compiling import compile  # loads JAX
  signals = [compile(constraints, clip.num_frames, clip.fps, clip.joints).slice_frames(span.start, span.stop)
             for clip, span in zip(clips, spans)]
  return {"control": signals} | ({"way_points": way_points(constraints)} if path.lower().endswith("html") else {})


def way_points(constraints: Sequence["Constraint"]) -> list[list[float]]:
  """[x, z] of the points that paths are drawn through."""
  from motion_jax.control.constraints import RootPath  # most files are written without constraints
  return [[float(point[0]), float(point[-1])] for constraint in constraints
          if isinstance(constraint, RootPath) and constraint.points is not None for point in constraint.points]


def distance(signal: "ControlSignal", clip: Clip) -> dict[str, Any] | None:
  """The distance of a clip from a signal (1, T), millimetres: {mean, worst, frame and joint of the worst}; None for a
  signal without constraints."""
  given = np.asarray(signal.given)[0].any(-1)
  if not given.any():
    return None
  from motion_jax.control.signal import errors  # loads JAX
  off = np.asarray(errors(signal, clip.joints[None]))[0]
  frame, joint = np.unravel_index(off.argmax(), off.shape)
  return {"mean": round(1000 * float(off[given].mean()), 2), "worst": round(1000 * float(off.max()), 2),
          "frame": int(frame), "joint": clip.skeleton.joints[joint].replace("_", " ")}


def marks_of(signal: "ControlSignal | None", floor: float) -> Marks:
  """The marks to draw for a signal (1, T), metres; none for None."""
  if signal is None:
    return Marks([], [])
  parts = parts_of(signal)
  lines = [(way + [[0, floor, 0], [1e-3, floor, 0]] if len(way) == 1 else way + [0, floor, 0], _PATH,
            0.12 if len(way) == 1 else 0.045, 0.85) for way in parts.ways]
  bodies: list[tuple[int, render.Body]] = [(frame, _ball(place)) for frame, _, place in parts.targets]
  for frame, joints in parts.poses:
    figure = make_figure(Clip(joints[None].astype(np.float32)))
    colors = default_colors(figure)
    bodies.append((int(frame), body_at(figure, 0, colors + (1 - colors) * _PALE)))
  return Marks(lines, bodies)


def body_at(figure: Any, t: int, colors: np.ndarray, move: Any = 0) -> render.Body:
  """The body at frame t, its parts in colors (P, 3), moved by move (3,)."""
  radii = (np.array([getattr(part, name) for part in figure.parts]) for name in ("a_radius", "b_radius"))
  mesh = pose_mesh(figure, t, colors, move) if figure.skinned else None
  return render.Body(figure.a[t] + move, figure.b[t] + move, *radii, colors, mesh)


def _ball(place):
  size = np.array([_BALL])
  return render.Body(place[None], place[None], size, size, np.array([_TARGET]))


def _runs(frames):
  return [run for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1) if len(run)]


def _some(items, most):
  """At most `most` of the items, evenly spaced."""
  chosen = np.linspace(0, max(len(items) - 1, 0), min(most, len(items))).astype(int)
  return [items[i] for i in chosen]


def from_above(figure: Any, bodies: Any, marks: Marks, size: tuple[int, int], trail: Any) -> np.ndarray:
  """A picture (H, W, 3) of bodies at several moments, obliquely from above, with marks and the path on the floor."""
  way = figure.joints[:, 0] * [1, 0, 1] + [0, figure.floor, 0]
  points = np.concatenate([way, *(line[0] for line in marks.lines), *(body[0] for _, body in marks.bodies)])
  low, high = points.min(0), points.max(0)
  elevation, focal = np.radians(38), 2.4
  # Seen across its longer side, from a little beside it.
  angle = np.pi / 2 + 0.25 if high[2] - low[2] > high[0] - low[0] else 0.25
  middle = (low + high) / 2 * [1, 0, 1] + [0, figure.floor + 0.7, 0]
  around = np.concatenate([points, points * [1, 0, 1] + [0, figure.floor + 1.9, 0]]) - middle
  camera = render.look_at(middle, angle, elevation, 0, focal)
  x, y, ahead = around @ camera.right, around @ camera.up, around @ camera.back
  distance = max(((np.abs(y) + 0.3) * 2 * focal + ahead).max(),
                 ((np.abs(x) + 0.6) * 2 * focal * size[1] / size[0] + ahead).max(), 4.0)
  camera = render.look_at(middle, angle, elevation, distance, focal)
  return render.draw(camera, size, figure.floor, [*bodies, *(body for _, body in marks.bodies)], [*marks.lines, trail])
