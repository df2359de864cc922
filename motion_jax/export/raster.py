"""Skinned meshes in our own pictures: the body of the .html page and the .glb file, frame by frame, in numpy."""
import functools
from typing import Any, NamedTuple

import numpy as np

from motion_jax.export.mesh import make_skins, rest_joints
from motion_jax.motion import rotations as rot

# Pixels across: triangles of about the same size are drawn together.
_SIZES = (2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 24, 32, 64, 128, 4096)
_AT_ONCE = 2_000_000  # candidates for pixels, which bounds the memory


class Mesh(NamedTuple):
  """One posed mesh: V points in the world, F triangles."""
  points: np.ndarray     # (V, 3)
  normals: np.ndarray    # (V, 3)
  triangles: np.ndarray  # (F, 3)
  colors: np.ndarray     # (F, 3) sRGB 0..1


def pose_mesh(figure: Any, t: int, colors: np.ndarray, move: Any = 0) -> Mesh:
  """The mannequin of a Figure at frame t, its parts in colors (P, 3), moved by move (3,)."""
  offsets = np.ascontiguousarray(figure.pose.offsets)
  points, normals, joints, weights, triangles, parts = _skin(figure.parts, offsets.tobytes(), figure.skeleton)
  turns = rot.to_matrix(figure.pose.turned[t])
  places = figure.joints[t] - np.einsum("jab,jb->ja", turns, rest_joints(offsets, figure.skeleton))
  turns = np.einsum("vk,vkab->vab", weights, turns[joints])
  placed = np.einsum("vab,vb->va", turns, points) + np.einsum("vk,vka->va", weights, places[joints])
  return Mesh(placed + move, np.einsum("vab,vb->va", turns, normals), triangles, colors[parts[triangles[:, 0]]])


@functools.lru_cache(maxsize=4)
def _skin(parts, offsets, skeleton):
  """Points, normals, joints, weights, triangles and parts of all skins of a body, as one mesh at rest."""
  skins = make_skins(parts, rest_joints(np.frombuffer(offsets).reshape(-1, 3), skeleton), skeleton)
  starts = np.cumsum([0] + [len(skin.points) for skin in skins[:-1]])
  joined = [np.concatenate([getattr(skin, name) for skin in skins])
            for name in ("points", "normals", "joints", "weights", "parts")]
  triangles = np.concatenate([skin.triangles + start for skin, start in zip(skins, starts)])
  return joined[0], joined[1], joined[2].astype(int), joined[3] / 255.0, triangles, joined[4]


def draw_mesh(points, normals, triangles, pixels, depth):
  """Puts a mesh into a depth image (H, W), in place, but for triangles that face away.

  points: (V, 3) in the camera's frame, z ahead. normals (V, 3) in the same. pixels: (V, 2) where they are in the image.
  Yields (pixels (N,), normals (N, 3), triangles (N,)) of what is now the nearest.
  """
  corners, z = pixels.astype(np.float32)[triangles], points[:, 2].astype(np.float32)[triangles]
  normals = normals.astype(np.float32)
  low, high = np.floor(corners.min(1)).astype(int), np.ceil(corners.max(1)).astype(int)
  height, width = depth.shape
  seen = (_area(corners) < -1e-9) & (z.min(1) > 0.05) & (high > 0).all(1) & (low < [width, height]).all(1)
  extent = (high - low).max(1)
  flat, before = depth.ravel(), 0
  for size in _SIZES:
    members = np.flatnonzero(seen & (extent > before) & (extent <= size))
    before = size
    for first in range(0, len(members), max(1, _AT_ONCE // size ** 2)):
      some = members[first:first + max(1, _AT_ONCE // size ** 2)]
      index, row, column, shares = _covered(corners[some], low[some], min(size, int(extent[some].max())), width, height)
      which = some[index]
      at = (low[which, 1] + row) * width + low[which, 0] + column
      ahead = np.einsum("nk,nk->n", shares, z[which])
      np.minimum.at(flat, at, ahead)
      won = ahead <= flat[at]
      which, shares = which[won], shares[won]
      yield at[won], np.einsum("nk,nka->na", shares, normals[triangles[which]]), which


def _area(corners):
  """Twice the signed area (F,) of triangles (F, 3, 2); negative where their front is seen, for rows count down."""
  (ax, ay), (bx, by), (cx, cy) = corners.transpose(1, 2, 0)
  return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


def _covered(corners, low, size, width, height):
  """(triangle, row, column (N,), shares of its corners (N, 3)) of the pixels that triangles (F, 3, 2) cover.

  Rows and columns count from low (F, 2), up to size.
  """
  grid = np.arange(size, dtype=np.float32) + np.float32(0.5)
  x, y = (low[:, i, None].astype(np.float32) + grid for i in range(2))
  (ax, ay), (bx, by), (cx, cy) = corners.transpose(1, 2, 0)[..., None]
  area = _area(corners)[:, None]
  # Barycentric shares are a sum of a part that depends on x and one that depends on y.
  u = ((bx - x) * (cy - by) / area)[:, None] - ((by - y) * (cx - bx) / area)[:, :, None]
  v = ((cx - x) * (ay - cy) / area)[:, None] - ((cy - y) * (ax - cx) / area)[:, :, None]
  there = ((x > 0) & (x < width))[:, None] & ((y > 0) & (y < height))[:, :, None]
  index, row, column = np.nonzero((u >= 0) & (v >= 0) & (u + v <= 1) & there)
  u, v = u[index, row, column], v[index, row, column]
  return index, row, column, np.stack([u, v, 1 - u - v], axis=-1)
