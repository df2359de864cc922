"""The mannequin's mesh in films and pictures: where the page has it, nearest surface first, facing triangles alone."""
import base64

import numpy as np
import pytest

from motion_jax.export import frame
from motion_jax.export.body import default_colors, make_figure
from motion_jax.export.html import html_page
from motion_jax.export.raster import draw_mesh, pose_mesh
from motion_jax.motion import rotations as rot
from tests.export.test_html import data_of, make


def test_the_film_shows_the_mesh_of_the_page(tmp_path):
  clip = make("walk", 20)
  (tmp_path / "a.html").write_text(html_page(clip), encoding="utf-8")
  body, = data_of(tmp_path / "a.html")["bodies"]
  figure = make_figure(clip)
  mesh = pose_mesh(figure, 7, default_colors(figure))
  decode = lambda text, kind, width: np.frombuffer(base64.b64decode(text), kind).reshape(-1, width)
  first = 0
  for skin in body["skins"]:  # as the viewer poses them: bones at the joints, bound where they rest
    points = decode(skin["points"], "<i2", 3) / 32767 * body["reach"]
    joints, weights = decode(skin["joints"], "u1", 4), decode(skin["weights"], "u1", 4) / 255
    at = figure.joints[7][joints] + rot.rotate(figure.pose.turned[7][joints],
                                               points[:, None] - np.array(body["rest"])[joints])
    there = mesh.points[first:first + len(points)]
    assert np.abs((weights[..., None] * at).sum(1) - there).max() < 1e-3  # metres; the page rounds
    first += len(points)
  assert first == len(mesh.points)
  image = frame(clip, 7, (320, 180)).astype(int)
  assert (image[..., 2] - image[..., 0] > 60).sum() > 100 and (image[..., 0] - image[..., 2] > 60).sum() > 100


def square(depth, size=1.0):
  """Two triangles that face the camera, at a depth: points (4, 3), normals, triangles."""
  corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) * size
  return np.c_[corners, np.full(4, depth)], np.tile([0, 0, -1.0], (4, 1)), np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("reach", [1.3, 3.0, 20.0, 90.0])
def test_the_nearest_surface_that_faces_the_camera_is_seen(reach):
  depth = np.full((240, 200), np.inf, np.float32)
  place = lambda points: np.array([100, 120]) + points[:, :2] * [reach, -reach]  # y up, rows down
  drawn = 0
  for far, seen in ((5.0, True), (4.0, True), (6.0, False)):
    points, normals, triangles = square(far)
    found = np.concatenate([at for at, *_ in draw_mesh(points, normals, triangles, place(points), depth)] or [[]])
    assert (len(found) > 0) == seen
    drawn = max(drawn, len(np.unique(found)))
  assert drawn == np.isfinite(depth).sum() and abs(drawn - (2 * reach) ** 2) <= 8 * reach + 4
  np.testing.assert_allclose(depth[np.isfinite(depth)], 4.0, rtol=1e-5)
  points, normals, triangles = square(3.0)
  assert not list(draw_mesh(points, normals, triangles[:, ::-1], place(points), depth)), "it faces away"
