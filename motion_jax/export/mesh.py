"""The mannequin as a skinned mesh: the skin of blended capsules, and how each joint carries it.

The parts of one colour melt into one solid: its distance function is a soft minimum over the parts' own (Quilez' smooth
union). A net of points is laid over its zero level (naive surface nets: one point per grid cell that the surface
crosses, one quad per grid edge), pulled onto the surface, with the gradient as normal. Elbows and knees stay smooth
when they bend, for a point's weights are shared by the parts that are near it.
"""
from typing import NamedTuple

import numpy as np

from motion_jax.motion.skeleton import Skeleton

# Grid step and softness (metres): bodies and limbs are large and plain, faces and fingers small.
_STEP = {"middle": (0.019, 0.014), "left": (0.0165, 0.010), "right": (0.0165, 0.010), "head": (0.012, 0.007),
         "dark": (0.009, 0.003)}
_SHARE = 0.018  # metres over which the weights of one part give way to those of the next
_CHUNK = 4096  # grid points at once, so that the arrays stay in the cache


class Skin(NamedTuple):
  """The mesh of one colour in the T-pose: V points, F triangles; weights are whole and add up to 255."""
  group: str
  points: np.ndarray     # (V, 3)
  normals: np.ndarray    # (V, 3)
  joints: np.ndarray     # (V, 4)
  weights: np.ndarray    # (V, 4)
  triangles: np.ndarray  # (F, 3)
  parts: np.ndarray      # (V,) the number of the part that each point is on


def rest_joints(offsets, skeleton: Skeleton):
  """Joint positions (J, 3) of the T-pose, soles near the ground."""
  rest = np.zeros_like(offsets)
  for chain in skeleton.chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      rest[joint] = rest[parent] + offsets[joint]
  return rest - [0, rest[:, 1].min() - 0.02, 0]


def make_skins(parts, rest, skeleton: Skeleton) -> list[Skin]:
  """One Skin per colour group of the parts, for joints that rest at (J, 3)."""
  skins = []
  for group, (step, softness) in _STEP.items():
    members = [part for part in parts if part.group == group]
    pieces = [_skin(piece, rest, skeleton, step, softness) for piece in _pieces(members, rest)]
    numbers = [np.array([parts.index(member) for member in piece]) for piece in _pieces(members, rest)]
    if pieces:
      starts = np.cumsum([0] + [len(piece[0]) for piece in pieces[:-1]])
      arrays = [np.concatenate([piece[i] for piece in pieces]) for i in range(4)]
      triangles = np.concatenate([piece[4] + start for piece, start in zip(pieces, starts)])
      owners = np.concatenate([number[piece[5]] for number, piece in zip(numbers, pieces)])
      skins.append(Skin(group, *arrays, triangles, owners))
  return skins


def _ends(parts, rest):
  """Balls of the parts in the T-pose: centres (P, 2, 3) and radii (P, 2)."""
  return (np.array([[rest[part.a] + part.a_offset, rest[part.b] + part.b_offset] for part in parts]),
          np.array([[part.a_radius, part.b_radius] for part in parts]))


def _pieces(parts, rest):
  """Groups of parts that touch: a hand and a foot are two nets, not one over the whole body."""
  pieces = []
  for part in parts:
    low, high = _box(*_ends([part], rest))
    near = [piece for piece in pieces if (piece[1] < high).all() and (low < piece[2]).all()]
    pieces = [piece for piece in pieces if not any(piece is other for other in near)]
    members = [member for piece in near for member in piece[0]] + [part]
    pieces.append((members, np.min([low, *(p[1] for p in near)], 0), np.max([high, *(p[2] for p in near)], 0)))
  return [piece[0] for piece in pieces]


def _skin(parts, rest, skeleton, step, softness):
  """Points, normals, joints, weights and triangles of one solid, and the nearest member of parts to each point."""
  ends, radii = _ends(parts, rest)
  low, high = _box(ends, radii)
  counts = np.ceil((high - low) / step).astype(int) + 7
  points, triangles = _surface_net(lambda p: _soft_minimum(_capsules(p, ends, radii)[0], softness)[0],
                                    low - 3.3 * step, counts, step)
  for _ in range(3):  # Newton: onto the surface
    distance, gradient = _solid(points, ends, radii, softness)
    points = points - distance[:, None] * gradient
  normals = _solid(points, ends, radii, softness)[1]
  normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
  nearest = _capsules(points, ends, radii)[0].argmin(1)
  return points, normals, *_weights(points, parts, ends, radii, skeleton), triangles, nearest


def _capsules(points, ends, radii):
  """Signed distance (N, P) of points (N, 3) to the parts, the lines to them from the parts' axes (N, P, 3), the lengths
  of these (N, P), and how far along the axes they begin (N, P), 0..1.

  The nearest ball of a hull sits where the line to it leans back by the cone's slope k: s = h - k d / sqrt(1 - k^2).
  """
  axis = ends[:, 1] - ends[:, 0]
  length = np.maximum(np.linalg.norm(axis, axis=-1), 1e-6)
  u = axis / length[:, None]
  k = np.clip((radii[:, 0] - radii[:, 1]) / length, -0.999, 0.999)
  offset = points[:, None] - ends[None, :, 0]
  h = (offset * u).sum(-1)
  d = np.linalg.norm(offset - h[..., None] * u, axis=-1)
  s = np.clip(h - k * d / np.sqrt(1 - k * k), 0, length)
  away = offset - s[..., None] * u
  reach = np.linalg.norm(away, axis=-1)
  return reach - (radii[:, 0] - k * s), away, reach, s / length


def _solid(points, ends, radii, softness):
  """Soft minimum of the distances (N,) and its gradient (N, 3)."""
  distance, away, reach, _ = _capsules(points, ends, radii)
  value, share, total = _soft_minimum(distance, softness)
  gradient = away / np.maximum(reach, 1e-9)[..., None]
  return value, (share[..., None] * gradient).sum(1) / total[:, None]


def _soft_minimum(distance, softness):
  """The soft minimum (N,) of distances (N, P), the share (N, P) of each in it, and the sum (N,) of the shares."""
  nearest = distance.min(1, keepdims=True)
  share = np.exp((nearest - distance) / softness)
  total = share.sum(1)
  return nearest[:, 0] - softness * np.log(total), share, total


def _box(ends, radii):
  """Lowest and highest corner (3,) around balls."""
  return (ends - radii[..., None]).min((0, 1)), (ends + radii[..., None]).max((0, 1))


def _surface_net(field, low, counts, step):
  """Points (V, 3) and triangles (F, 3), outward, of the zero level of field on a grid of counts (3,) points."""
  grid = np.stack(np.meshgrid(*[low[i] + step * np.arange(counts[i]) for i in range(3)], indexing="ij"), axis=-1)
  flat = grid.reshape(-1, 3)
  value = np.concatenate([field(flat[i:i + _CHUNK]) for i in range(0, len(flat), _CHUNK)]).reshape(counts)
  inside = value < 0
  cells = tuple(counts - 1)
  total, crossings = np.zeros(cells + (3,)), np.zeros(cells)
  corner = lambda array, i, j, k: array[i:i + cells[0], j:j + cells[1], k:k + cells[2]]
  for axis in range(3):  # the 12 edges of a cell: where does the surface cross them
    for p in (0, 1):
      for q in (0, 1):
        start = np.insert([p, q], axis, 0)
        end = np.insert([p, q], axis, 1)
        a, b = corner(value, *start), corner(value, *end)
        crosses = (a < 0) != (b < 0)
        along = np.where(crosses, a / np.where(crosses, a - b, 1), 0)
        total += crosses[..., None] * (start + along[..., None] * (end - start))
        crossings += crosses
  used = crossings > 0
  index = np.full(cells, -1)
  index[used] = np.arange(used.sum())
  points = low + step * (np.argwhere(used) + total[used] / crossings[used][:, None])
  quads = []
  for axis in range(3):  # an edge that crosses the surface is shared by four cells: their points make a quad
    i, j = (axis + 1) % 3, (axis + 2) % 3
    first = np.take(inside, range(counts[axis] - 1), axis)
    second = np.take(inside, range(1, counts[axis]), axis)
    edges = np.argwhere(first != second)
    around = []
    for di, dj in ((-1, -1), (0, -1), (0, 0), (-1, 0)):
      cell = edges.copy()
      cell[:, i] += di
      cell[:, j] += dj
      around.append(index[tuple(cell.T)])
    quad = np.stack(around, axis=1)
    leaves = first[tuple(edges.T)]  # inside first: the surface faces along +axis
    quads.append(np.where(leaves[:, None], quad, quad[:, ::-1]))
  quads = np.concatenate(quads)
  return points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _weights(points, members, ends, radii, skeleton):
  """The four joints (V, 4) that carry each point most, and their weights (V, 4), whole numbers that add up to 255."""
  distance, _, _, along = _capsules(points, ends, radii)
  share = np.exp((distance.min(1, keepdims=True) - distance) / _SHARE)
  bend = along * along * (3 - 2 * along)
  full = np.zeros((len(points), skeleton.num_joints))
  for number, part in enumerate(members):
    first, second = _bones(part, skeleton)
    full[:, first] += share[:, number] * (1 - bend[:, number])
    full[:, second] += share[:, number] * bend[:, number]
  joints = np.argsort(-full, axis=1)[:, :4]
  top = np.take_along_axis(full, joints, axis=1)
  weights = np.round(top / top.sum(1, keepdims=True) * 255)
  weights[:, 0] += 255 - weights.sum(1)
  return np.where(weights > 0, joints, 0), weights


def _bones(part, skeleton):
  """The joints whose turns carry the two ends of a part: its own frame, or what moves the joint that the end is at."""
  carries = lambda joint: part.frame in (joint, skeleton.parents[joint])
  first = part.frame if carries(part.a) else part.a
  second = part.frame if carries(part.b) else skeleton.parents[part.b]
  return first, second
