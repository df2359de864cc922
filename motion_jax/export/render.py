"""A small software renderer: meshes and tapered capsules in numpy.

Our own because OpenGL needs a display or a graphics driver, which servers and CI lack, and Pillow shades nothing.

A camera looks at a ground with a grid; bodies stand on it, shaded, with soft shadows. Images are
(H, W, 3) uint8. Bodies are drawn at twice the size and averaged, ground lines are smooth by formula.
"""
from typing import NamedTuple

import numpy as np

from motion_jax.export.raster import Mesh, draw_mesh
from motion_jax.utils.lazy import LazyModule

Image, ImageDraw, ImageFilter = (LazyModule(f"PIL.{name}") for name in ("Image", "ImageDraw", "ImageFilter"))

_LIGHT = np.array([0.45, 0.8, 0.42]) / np.linalg.norm([0.45, 0.8, 0.42])  # direction towards the light, camera frame
_SKY = np.array([0.965, 0.972, 0.984], np.float32)
_GROUND = np.array([0.912, 0.923, 0.942], np.float32)
_LINE = np.array([0.80, 0.82, 0.86], np.float32)
_SAMPLES = 2
_FLESH = 0.025  # metres by which a mesh may stand out of its balls
_BLEND = 0.022  # metres within which surfaces of one colour share their shading


class Body(NamedTuple):
  """A body to draw: hulls of two balls each, which cast the shadow and are visible if there is no mesh."""
  a: np.ndarray         # (P, 3)
  b: np.ndarray         # (P, 3)
  a_radius: np.ndarray  # (P,)
  b_radius: np.ndarray  # (P,)
  colors: np.ndarray    # (P, 3) sRGB 0..1
  mesh: Mesh | None = None


class Camera(NamedTuple):
  """A pinhole camera: position (3,), unit vectors of its frame, focal length in image heights."""
  position: np.ndarray
  right: np.ndarray
  up: np.ndarray
  back: np.ndarray  # from the target to the camera
  focal: float


def look_at(target, azimuth, elevation, distance, focal=1.9) -> Camera:
  """A camera `distance` metres from target; azimuth is the compass angle of the camera seen from there (0: at +z)."""
  back = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
  right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
  return Camera(np.asarray(target) + back * distance, right, np.cross(back, right), back, focal)


def project(camera, points, size):
  """Points (..., 3) to pixels (..., 2) and depths (...); size is (width, height)."""
  x, y, depth = _to_camera(camera, points)
  scale = camera.focal * size[1] / np.maximum(depth, 1e-3)
  return np.stack([size[0] / 2 + x * scale, size[1] / 2 - y * scale], axis=-1), depth


def _to_camera(camera, points):
  offset = np.asarray(points) - camera.position
  return offset @ camera.right, offset @ camera.up, -(offset @ camera.back)


def tones(background=None):
  """Colours (3,) of sky, ground and its lines, 0..1; background: the sky's, from which the others differ a little."""
  if background is None:
    return _SKY, _GROUND, _LINE
  sky = np.asarray(background, np.float32)
  if sky.mean() > 0.4:
    return sky, sky * (_GROUND / _SKY), sky * (_LINE / _SKY)
  lighter = lambda share: sky + (1 - sky) * np.float32(share)
  return sky, lighter(0.06), lighter(0.2)


def draw(camera, size, floor, bodies, lines=(), backdrop=None, background=None) -> np.ndarray:
  """One image. bodies: a `Body`, or a tuple of its fields, for each.

  lines: (points (N, 3), color (3,), width in metres, opacity) on the ground. backdrop: what `ground` gave, if known.
  background: colour of the sky, see `tones`.
  """
  image = ground(camera, size, floor, background) if backdrop is None else backdrop.copy()
  for points, color, width, opacity in lines:
    mask = _line_mask(camera, size, points, width)
    for view, cover in _patch(mask):
      image[view] += (np.array(color, np.float32) - image[view]) * (cover * np.float32(opacity))
  bodies = [Body(*body) for body in bodies]
  for layer, darkness in _shadows(camera, size, floor, bodies):
    for view, cover in _patch(layer):
      image[view] *= 1 - np.float32(darkness) * cover
  _draw_bodies(image, camera, size, bodies)
  return (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)


def _patch(mask):
  """The part of a mask (Pillow "L") that is not empty: where it lies in the picture, and its values (h, w, 1)."""
  box = mask.getbbox()
  if box:
    x0, y0, x1, y1 = box
    values = np.asarray(mask.crop(box), np.float32)
    yield (slice(y0, y1), slice(x0, x1)), values[..., None] * np.float32(1 / 255)


def ground(camera, size, floor, background=None):
  """Sky above, grid below, (H, W, 3) float32; lines every half metre that fade into the distance."""
  width, height = size
  sky, earth, line_color = tones(background)
  x = (np.arange(width, dtype=np.float32) + 0.5 - width / 2) / (camera.focal * height)
  y = (height / 2 - np.arange(height, dtype=np.float32) - 0.5) / (camera.focal * height)
  up, right, back = (v.astype(np.float32) for v in (camera.up, camera.right, camera.back))
  fall = y * up[1] - back[1]  # of a ray, per metre of depth; the camera never rolls, so rows share it
  drop = np.float32(floor - camera.position[1])
  with np.errstate(divide="ignore", invalid="ignore"):
    depth = np.where(fall < -1e-6, drop / fall, np.inf).astype(np.float32)
  image = np.empty((height, width, 3), np.float32)
  seen = np.isfinite(depth) & (depth < 200)
  fade_rows = np.exp(-np.maximum(depth - 1.2 * abs(camera.position[1]) - 4, 0) / 7)
  image[:] = sky
  if not seen.any():
    return image
  d, yy = depth[seen][:, None], y[seen][:, None]
  cover = np.zeros((len(d), width), np.float32)
  pixel = d / (camera.focal * height)  # metres per pixel across the line of sight
  slant = pixel * np.abs(d / np.float32(max(abs(drop), 1e-3)))  # and along it, where the ground is foreshortened
  for axis in (0, 2):
    place = np.float32(camera.position[axis]) + d * (x * right[axis] + (yy * up[axis] - back[axis]))
    away = np.abs(right[axis]) * pixel + np.abs(back[axis]) * slant
    for step, half, weight in ((0.5, 0.004, 0.45), (1.0, 0.008, 1.0)):
      place_in = place * np.float32(1 / step)
      gap = np.abs(place_in - np.round(place_in))
      line = (half / away + 0.5) - gap * (step / away)
      np.maximum(cover, np.minimum(line, np.minimum(1, 2 * half / away)) * np.float32(weight), out=cover)
  fade = fade_rows[seen][:, None].astype(np.float32)
  rows = sky + (earth - sky) * fade
  image[seen] = rows[:, None] + (cover * fade)[..., None] * (line_color - earth)
  return image


def _line_mask(camera, size, points, width):
  """Coverage ("L" image) of a line on the ground, its width in metres seen in perspective."""
  image = Image.new("L", (size[0] * 2, size[1] * 2))
  pixels, depth = project(camera, points, (size[0] * 2, size[1] * 2))
  pen = ImageDraw.Draw(image)
  for p, q, near in zip(pixels[:-1], pixels[1:], np.minimum(depth[:-1], depth[1:])):
    if near > 0.2 and np.abs(q - p).max() > 0:
      thick = max(2, round(width * camera.focal * size[1] * 2 / near))
      pen.line([tuple(p), tuple(q)], fill=255, width=thick)
      r = thick / 2 - 0.5
      pen.ellipse([q[0] - r, q[1] - r, q[0] + r, q[1] + r], fill=255)
  return image.reduce(2)


def _halve(a):
  """Means of 2 x 2 samples."""
  rows = a[::2] + a[1::2]
  return (rows[:, ::2] + rows[:, 1::2]) * np.float32(0.25)


def _world_light(camera):
  """Direction towards the light: over the viewer's right shoulder, whatever way the camera looks."""
  back = np.array([camera.back[0], 0, camera.back[2]])
  back = back / max(np.linalg.norm(back), 1e-6)
  return _LIGHT[0] * camera.right + _LIGHT[1] * np.array([0, 1, 0]) + _LIGHT[2] * back


def _shadows(camera, size, floor, bodies):
  """Yields ("L" image, darkness): a soft shadow along the light, and a contact shadow under what is near the ground."""
  small = (size[0] // 2 + 1, size[1] // 2 + 1)  # soft things need no more
  near = np.concatenate([np.minimum(a[:, 1] - ra, b[:, 1] - rb) for a, b, ra, rb, *_ in bodies]) - floor
  a, b, a_radius, b_radius = (np.concatenate([body[i] for body in bodies]) for i in range(4))
  angles = np.linspace(0, 2 * np.pi, 13)[:-1]
  circle = np.stack([np.cos(angles), 0 * angles, np.sin(angles)], axis=-1)
  straight = np.array([0, 1.0, 0])
  for along, blur, darkness, low in ((_world_light(camera), 0.03, 0.21, np.inf), (straight, 0.015, 0.26, 0.12)):
    layer = Image.new("L", small)
    pen, scale = ImageDraw.Draw(layer), 0.0
    rims = np.concatenate([
        (balls - along * ((balls[:, 1:2] - floor) / along[1]))[:, None] + circle * radii[:, None, None]
        for balls, radii in ((a, a_radius), (b, b_radius))], axis=1)
    pixels, depth = project(camera, rims, size)
    for rim, distance, height in zip(pixels / 2, depth.min(1), near):
      if height < low and distance > 0.2:
        dark = 255 if low == np.inf else int(255 * (1 - max(height, 0) / low))
        pen.polygon([tuple(corner) for corner in _hull(rim)], fill=dark)
        scale = max(scale, camera.focal * size[1] / distance / 2)
    if scale:
      soft = layer.filter(ImageFilter.GaussianBlur(float(scale * blur)))
      yield soft.resize((small[0] * 2, small[1] * 2), Image.Resampling.BILINEAR).crop((0, 0, *size)), darkness


def _hull(points):
  """Corners of the convex hull of points (N, 2), in order (monotone chain)."""
  points = points[np.lexsort((points[:, 1], points[:, 0]))].tolist()
  rows = []
  for sequence in (points, points[::-1]):
    row = []
    for p in sequence:
      while len(row) > 1 and ((row[-1][0] - row[-2][0]) * (p[1] - row[-2][1])
                              - (row[-1][1] - row[-2][1]) * (p[0] - row[-2][0])) <= 0:
        row.pop()
      row.append(p)
    rows += row[:-1]
  return rows or points[:1] * 3


def _draw_bodies(image, camera, size, bodies):
  """Draws bodies into image (H, W, 3) float in place: the nearest surface, lit, averaged over samples."""
  a, b, a_radius, b_radius, colors = (np.concatenate([body[i] for body in bodies]) for i in range(5))
  meshes = [body.mesh for body in bodies if body.mesh is not None]
  fleshed = np.concatenate([np.full(len(body.a), body.mesh is not None) for body in bodies])
  a, b = (np.stack(_to_camera(camera, ends), axis=-1) for ends in (a, b))  # x right, y up, z ahead
  visible = np.minimum(a[:, 2] - a_radius, b[:, 2] - b_radius) > 0.05
  focal, scale = camera.focal * size[1] * _SAMPLES, 1 / (camera.focal * size[1] * _SAMPLES)
  centre = np.array(size) * _SAMPLES / 2
  middle = [ends[:, :2] / ends[:, 2:] * focal for ends in (a, b)]
  # A ball reaches a little further across than its radius in perspective; 6 % covers that.
  room = _FLESH * fleshed
  reach = [(1.06 * (radius + room) / (ends[:, 2] - radius) * focal)[:, None]
           for ends, radius in ((a, a_radius), (b, b_radius))]
  low = np.minimum(middle[0] - reach[0], middle[1] - reach[1])
  high = np.maximum(middle[0] + reach[0], middle[1] + reach[1])
  box = np.stack([low[:, 0] + centre[0], high[:, 0] + centre[0], centre[1] - high[:, 1], centre[1] - low[:, 1]], -1)
  limits = np.array([size[0], size[0], size[1], size[1]]) * _SAMPLES
  even = np.array([-1, 1, -1, 1])
  box = np.clip((np.floor((box * even + 1) / 2) * 2 * even).astype(int), 0, limits)
  visible &= (box[:, 1] > box[:, 0]) & (box[:, 3] > box[:, 2])
  if not visible.any():
    return
  x0, x1, y0, y1 = (pick(box[visible, i]) for i, pick in enumerate((np.min, np.max, np.min, np.max)))
  shape = (y1 - y0, x1 - x0)
  depth, normals = np.full(shape, np.inf, np.float32), np.zeros((shape[0] * shape[1], 3), np.float32)
  paint, flat_depth = np.full(depth.size, -1, np.int16), depth.ravel()  # one memory, two views
  palette, which = np.unique(np.concatenate([colors, *(mesh.colors for mesh in meshes)]).astype(np.float32), axis=0,
                             return_inverse=True)
  nearest_first = np.argsort(np.minimum(a[:, 2], b[:, 2]))  # hidden parts then cost little
  for k in nearest_first[(visible & ~fleshed)[nearest_first]]:
    left, right, top, bottom = box[k]
    x = ((np.arange(left, right) + 0.5 - centre[0]) * scale).astype(np.float32)[None, :]
    y = ((centre[1] - np.arange(top, bottom) - 0.5) * scale).astype(np.float32)[:, None]
    view = slice(top - y0, bottom - y0), slice(left - x0, right - x0)
    rows, columns, t, normal = _hit(x, y, a[k], b[k], float(a_radius[k]), float(b_radius[k]), depth[view] + _BLEND)
    at = (rows + view[0].start) * shape[1] + columns + view[1].start
    behind, painted = flat_depth[at], paint[at]
    ahead = behind - t
    # Parts of one colour melt into each other where their surfaces are near: there the normals mix.
    weight = np.clip(0.5 + ahead * np.float32(0.5 / _BLEND), 0, 1)
    weight = np.where(painted == which[k], weight, (ahead > 0).astype(np.float32))[:, None]
    before = normals[at]
    normals[at] = before + (normal - before) * weight
    flat_depth[at] = np.minimum(behind, t)
    paint[at] = np.where(ahead > 0, which[k], painted)
  axes = (camera.right, camera.up, -camera.back)
  first = len(colors)
  for mesh in meshes:
    points = np.stack(_to_camera(camera, mesh.points), axis=-1)
    pixels = points[:, :2] * [1, -1] / np.maximum(points[:, 2:], 1e-3) * focal + centre - [x0, y0]
    for at, normal, faces in draw_mesh(points, mesh.normals @ np.stack(axes, -1), mesh.triangles, pixels, depth):
      normals[at], paint[at] = normal, which[first + faces]
    first += len(mesh.colors)
  drawn = np.isfinite(depth)
  rows, columns = np.nonzero(drawn)
  ray = np.stack([((columns + x0 + 0.5 - centre[0]) * scale), ((centre[1] - rows - y0 - 0.5) * scale),
                  np.ones(len(rows))], axis=-1).astype(np.float32)
  light, sky = (np.array([v @ axis for axis in axes], np.float32) for v in (_world_light(camera), np.array([0, 1, 0])))
  shade = np.zeros(shape + (3,), np.float32)
  shade[rows, columns] = _shade(normals[drawn.ravel()], ray, palette[paint[drawn.ravel()]], light, sky)
  # The outline: where the depth jumps behind a limb, the farther side darkens a little, so that limbs stand apart.
  shade *= (1 - 0.35 * _creases(depth, drawn))[..., None]
  cover = _halve(drawn.astype(np.float32))
  view = slice(y0 // 2, y1 // 2), slice(x0 // 2, x1 // 2)
  image[view] = image[view] * (1 - cover)[..., None] + _halve(shade)


def _creases(depth, drawn):
  far = np.where(drawn, depth, 1e3)
  near = far.copy()
  for shift, axis in ((2, 0), (-2, 0), (2, 1), (-2, 1)):
    near = np.minimum(near, np.roll(far, shift, axis))
  return np.where(drawn, np.clip((far - near - 0.03) / 0.12, 0, 1), 0)


def _hit(x, y, a, b, ra, rb, depth):
  """Where rays (x, y, 1) from the origin first meet the hull of two balls in front of depth.

  Returns row and column indices, the depth t of the points, and unit normals. The side of the hull is a cone that
  touches both balls: with u the axis, L the length and k = (ra - rb) / L, a point at height h along the axis and
  distance d from it is on the cone where d sqrt(1 - k^2) = ra - k h, and the ball that touches it there sits at
  s = (h - ra k) / (1 - k^2), which must lie between 0 and L.
  """
  square = x * x + y * y + 1
  best = np.full(square.shape, np.inf, np.float32)
  for centre, radius in ((a, ra), (b, rb)):
    along = x * np.float32(centre[0]) + y * np.float32(centre[1]) + np.float32(centre[2])
    under = along * along - square * np.float32(centre @ centre - radius * radius)
    t = (along - np.sqrt(np.maximum(under, 0))) / square
    np.minimum(best, np.where(under > 0, t, np.inf), out=best)
  axis = b - a
  length = float(np.linalg.norm(axis))
  k = (ra - rb) / length if length > 1e-6 else 2.0
  if abs(k) < 1:  # else one ball holds the other
    u = axis / length
    cosine = 1 - k * k
    h0, hd = -float(a @ u), x * np.float32(u[0]) + y * np.float32(u[1]) + np.float32(u[2])
    along = -(x * np.float32(a[0]) + y * np.float32(a[1]) + np.float32(a[2]))
    qa = cosine * square - hd * hd
    qb = cosine * along - hd * np.float32(h0 - ra * k)
    qc = cosine * float(a @ a) - h0 * h0 + 2 * ra * k * h0 - ra * ra
    under = qb * qb - qa * np.float32(qc)
    t = (-qb - np.sqrt(np.maximum(under, 0))) / np.where(np.abs(qa) < 1e-9, 1e-9, qa)
    s = (h0 + t * hd - ra * k) / cosine
    np.minimum(best, np.where((under > 0) & (s > 0) & (s < length) & (t > 0), t, np.inf), out=best)
  rows, columns = np.nonzero(best < depth)
  t = best[rows, columns]
  point = np.stack([x[0, columns], y[rows, 0], np.ones_like(t)], axis=-1) * t[:, None]
  point -= a.astype(np.float32)
  if abs(k) < 1:
    s = np.clip((point @ u.astype(np.float32) - ra * k) / cosine, 0, length)
    normal = point - s[:, None] * u.astype(np.float32)
  else:
    normal = point if ra >= rb else point - axis.astype(np.float32)
  return rows, columns, t, _unit(normal)


def _shade(normal, ray, color, light, sky):
  """Colours (N, 3) by a soft key light, light from above and below, a highlight, and a rim."""
  normal = _unit(normal)
  eye = _unit(-ray)
  key = np.clip(normal @ light * 0.85 + 0.15, 0, 1)[:, None]
  above = (normal @ sky * 0.5 + 0.5)[:, None]
  gloss = np.clip(_dot(normal, _unit(light + eye)), 0, 1)
  for _ in range(5):
    gloss = gloss * gloss  # to the 32nd
  rim = 1 - np.clip(_dot(normal, eye), 0, 1)
  base = color * ((0.42 + 0.16 * above + 0.56 * key) * (1 - 0.25 * rim * rim * rim)[:, None])
  return np.clip(base + 0.10 * gloss[:, None], 0, 1)


def _dot(a, b):
  return np.einsum("ij,ij->i", a, b)  # several times faster than (a * b).sum(-1) on short rows


def _unit(v):
  return v / np.maximum(np.sqrt(_dot(v, v)), 1e-9)[:, None]
