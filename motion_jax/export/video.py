"""Films and pictures of a motion: mp4, gif, and png strips of several moments, by our own renderer.

`frames(clip)` yields the images; the rest writes them. No OpenGL, no matplotlib: `render.py` needs numpy and Pillow.
"""
import collections
import concurrent.futures
import contextlib
import io
import itertools
import os
import pathlib
import shutil
import subprocess
import textwrap
import unicodedata

import numpy as np

from motion_jax.export import gif, render
from motion_jax.export.body import default_colors, make_figure
from motion_jax.export.scene import body_at, from_above, marks_of
from motion_jax.motion.looping import is_loop
from motion_jax.motion.retiming import resample
from motion_jax.motion.smoothing import gaussian_filter1d
from motion_jax.utils import progress, stopping
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import EncoderError, InputError
from motion_jax.utils.install import pip_install
from motion_jax.utils.lazy import LazyModule
from motion_jax.utils.nearest import did_you_mean

Image, ImageColor, ImageDraw, ImageFont = (
  LazyModule(f"PIL.{name}") for name in ("Image", "ImageColor", "ImageDraw", "ImageFont"))

INK, _PALE_INK = (52, 56, 66), (225, 228, 235)
VIEWS = {"front": (0, 13), "side": (90, 13), "top": (0, 89), "three-quarter": (35, 13)}  # azimuth, elevation, degrees
SIZE, GIF_SIZE = (960, 540), (640, 360)  # six seconds of a gif of that size are about a megabyte
_MOST, _LEAST = 4096, 16  # pixels of a side
_PATH, _TRAIL = (0.55, 0.60, 0.72), (0.95, 0.52, 0.25)


def video(clip, path, size=None, fps=None, **options) -> pathlib.Path:
  """Writes a film of a clip as .mp4 or .gif, at the clip's own speed. Options are those of `frames`.

  size: (width, height) in pixels, by default (960, 540), of a gif (640, 360). fps: pictures a second of the film, such
  as 24, 30 or 60, the clip's own by default; the motion is interpolated and stays as fast as it is. Raises ValueError
  for another extension, RuntimeError where no mp4 encoder is to be had.
  """
  path = pathlib.Path(path)
  write = {".mp4": _write_mp4, ".gif": _write_gif}.get(path.suffix.lower())
  if write is None:
    raise InputError(f"got {path.name!r}, a film is .mp4 or .gif")
  size = size or (SIZE if write is _write_mp4 else GIF_SIZE)
  check_film(size, fps, options.get("camera", "auto"), options.get("background"))
  size = (size[0] + size[0] % 2, size[1] + size[1] % 2)  # mp4 has no odd sizes
  if fps is not None:
    clip, options["colors"] = _at_rate(clip, fps, options.get("colors"))
  if write is _write_mp4:
    how = find_ffmpeg()  # before minutes of work
  else:  # one palette from four moments: a palette per frame would flicker
    picture, moments = _painter(clip, size, **options), np.linspace(0, clip.num_frames - 1, 4).round().astype(int)
    how = gif.common_palette([picture(t) for t in progress.each(moments, f"choosing the colours of {path.name}")])
  # Players repeat films: of a loop the last frame, which is the first again, would stand twice as long.
  count = clip.num_frames - is_loop(clip.joints, clip.skeleton)
  with atomic_path(path) as temporary:
    images = progress.each(itertools.islice(frames(clip, size=size, **options), count), f"drawing {path.name}", count,
                           "frame")
    write(temporary, images, size, clip.fps, how)
  return path


def check_film(size=SIZE, fps=None, camera="auto", background=None):
  """Raises InputError for a size, rate, camera or background that a film cannot have."""
  if len(size) != 2 or not all(isinstance(side, int | np.integer) and _LEAST <= side <= _MOST for side in size):
    raise InputError(f"got a film of size {'x'.join(map(str, size))}, expected WIDTHxHEIGHT in pixels, each side from "
                     f"{_LEAST} to {_MOST}, such as 720x720")
  if fps is not None and not 1 <= fps <= 240:
    raise InputError(f"got a film of {fps:g} frames a second, expected 1 to 240")
  if camera not in ("auto", "follow", "fixed", *VIEWS):
    raise InputError(f"got camera {camera!r}{did_you_mean(camera, ('auto', 'follow', 'fixed', *VIEWS))}, expected "
                     f"auto, follow, fixed or one of {', '.join(VIEWS)}")
  if background is not None:
    color_of(background)


def color_of(background):
  """A colour (3,) 0..1 from three such numbers, or from words as in HTML: white, #102030, rgb(10, 20, 30)."""
  if isinstance(background, str):
    try:
      return np.array(ImageColor.getrgb(background)[:3], np.float32) / 255
    except ValueError:
      raise InputError(f"got the background {background!r}{did_you_mean(background, ImageColor.colormap)}, expected a "
                       "colour such as white or #203040") from None
  color = np.asarray(background, np.float32)
  if color.shape != (3,) or not ((color >= 0) & (color <= 1)).all():
    raise InputError(f"got the background {background!r}, expected a colour's name or three numbers 0..1")
  return color


def _at_rate(clip, fps, colors):
  """(the clip at another rate, colours (T, 3) of its frames), as fast as before."""
  # Smooth curves: straight lines from frame to frame would jerk, and cut corners.
  joints = resample(np.asarray(clip.joints, np.float64), clip.fps, fps, smooth=True)
  if colors is not None and np.ndim(colors) > 1:
    nearest = np.round(np.arange(len(joints)) * (clip.fps / fps)).astype(int)
    colors = np.asarray(colors)[np.minimum(nearest, clip.num_frames - 1)]
  return clip.replace(joints=joints.astype(np.float32), fps=float(fps), features=None), colors


def frames(clip, size=SIZE, **options):
  """Yields one (H, W, 3) uint8 image per frame of a clip. Options:

  camera: "follow" goes with the body, "fixed" sees the whole path, "auto" chooses; "front", "side", "top" and
  "three-quarter" say from where to look, and choose so. azimuth: degrees from which to look, 0 is in front of the body;
  35 by default. background: a colour, such as "white" or "#203040". caption: text below, what the clip's captions say
  of the moment by default, "" for none.
  colors: (3,), (T, 3) or (T, P, 3) values 0..1 that replace the colours of the P parts; a NaN keeps the part's own, so
  a mask becomes np.where(kept_mask[:, None], np.nan, (1, .6, .2)). path: draw the root's way on the ground.
  control: a `ControlSignal` (1, T) of constraints, drawn on the floor, as marks and as pale bodies.
  """
  picture = _painter(clip, size, **options)
  workers = min(4, os.cpu_count() or 1)
  with concurrent.futures.ThreadPoolExecutor(workers) as pool:  # numpy and Pillow release the lock
    ahead = collections.deque()
    for t in range(clip.num_frames):
      ahead.append(pool.submit(picture, t))
      if len(ahead) > 2 * workers:
        yield ahead.popleft().result()
    while ahead:
      yield ahead.popleft().result()


def frame(clip, t=0, size=SIZE, **options) -> np.ndarray:
  """One image (H, W, 3) uint8 of a clip, at frame t; options as in `frames`."""
  if not -clip.num_frames <= t < clip.num_frames:
    raise ValueError(f"got frame {t}, the clip has frames 0 to {clip.num_frames - 1}")
  return _painter(clip, size, **options)(t % clip.num_frames)


def _painter(clip, size, camera="auto", azimuth=None, caption=None, colors=None, path=True, background=None,
             control=None):
  """A function of t that draws frame t."""
  check_film(size, None, camera, background)
  background = None if background is None else color_of(background)
  figure = make_figure(clip)
  tints = _tints(figure, colors)
  cameras = _cameras(figure, clip.fps, size, camera, azimuth)
  ink = INK if background is None or background.mean() > 0.4 else _PALE_INK
  caption_at = (lambda t: _caption(clip, t)) if caption is None else lambda t: caption
  way = figure.joints[:, 0] * [1, 0, 1] + [0, figure.floor, 0]
  marks = marks_of(control, figure.floor)
  shown = [body for _, body in marks.bodies]
  still = all(np.array_equal(view.position, cameras[0].position) for view in cameras)
  backdrop = render.ground(cameras[0], size, figure.floor, background) if still else None

  def picture(t):
    near = slice(max(0, t - int(60 * clip.fps)), t + int(60 * clip.fps))  # of the path, a minute around the frame
    lines = [(_thin(way[near]), _PATH, 0.022, 0.45), (_thin(way[near.start:t + 1]), _TRAIL, 0.026, 0.9)] if path else ()
    image = render.draw(cameras[t], size, figure.floor, [body_at(figure, t, tints[t]), *shown], [*marks.lines, *lines],
                        backdrop, background)
    return _write_text(image, caption_at(t), f"{t / clip.fps:.1f} s", ink)

  return picture


def strip(clip, path, num=8, height=360, azimuth=None, caption=None, colors=None, spread=None,
          control=None) -> pathlib.Path:
  """Writes one wide picture (.png, .jpg) of num moments of a clip, left to right with their times.

  A body that walks far enough is drawn where it was, seen from the side; otherwise the moments are set side by side
  (spread=True forces this). Pass a list of clips for one row each. control: a `ControlSignal` (1, T) of constraints
  to draw, or one for each; a motion that goes somewhere is then seen from above.
  """
  path, clips = pathlib.Path(path), list(clip) if isinstance(clip, list | tuple) else [clip]
  signals = control if isinstance(control, list | tuple) else [control] * len(clips)
  rows = [_strip(item, num, height, azimuth, caption, colors, spread, signal) for item, signal in zip(clips, signals)]
  width = max(needed for needed, _ in rows)
  rows = [draw(width) for _, draw in rows]
  data = io.BytesIO()  # on a full disk Pillow would write half a JPEG without a word
  Image.fromarray(np.concatenate(rows)).save(data, "PNG" if path.suffix.lower() == ".png" else "JPEG")
  with atomic_path(path) as temporary:
    temporary.write_bytes(data.getvalue())
  return path


def _strip(clip, num, height, azimuth, caption, colors, spread, control=None):
  """(the width that a strip needs, a function of the width that draws it)."""
  figure = make_figure(clip)
  tints = _tints(figure, colors)
  at = np.unique(np.linspace(0, clip.num_frames - 1, num).round().astype(int))
  way = figure.joints[:, 0] * [1, 0, 1]
  marks = marks_of(control, figure.floor)
  if not spread and marks.from_above(way):
    tall, text = round(1.6 * height), _caption(clip) if caption is None else caption
    trail = _thin(way) + [0, figure.floor, 0], _PATH, 0.022, 0.6
    shown = set(at) | set(marks.of(figures=False)[:2 * num]) - set(marks.of(figures=True))  # these are drawn pale
    bodies = [body_at(figure, t, tints[t]) for t in sorted(shown)]
    return 2 * tall, lambda width: _write_text(from_above(figure, bodies, marks, (width, tall), trail), text,
                                               f"{clip.seconds:.1f} s")
  at = np.unique([*at, *marks.of(True)[:num], *marks.of(False)[:num]])  # constraints are visible at their time
  tall = _height(figure)
  reach = np.linalg.norm((figure.joints - figure.joints[:, :1])[at][..., [0, 2]], axis=-1).max()
  gap = max(0.42 * tall, 1.25 * reach)
  travel = way[-1] - way[0]
  far = np.linalg.norm(travel)
  if spread is None:
    along = np.diff((way[at] @ travel) / max(far, 1e-9)) if len(at) > 1 else np.zeros(1)
    spread = bool(far < 0.62 * gap * max(len(at) - 1, 1) or along.min() < 0.2 * gap)
  if spread:
    angle = _azimuth(figure, 0 if azimuth is None else azimuth, 28 if azimuth is None else 0)
    right = np.array([np.cos(angle), 0, -np.sin(angle)])
    places = right * (np.arange(len(at)) - (len(at) - 1) / 2)[:, None] * gap
    lines = []
  else:
    side = np.cross([0, 1, 0], travel / far)
    angle = np.arctan2(-side[0], -side[2]) if azimuth is None else _azimuth(figure, azimuth, 0)
    right = np.array([np.cos(angle), 0, -np.sin(angle)])
    places = way[at] - way.mean(0)
    lines = [(_thin(way) - way.mean(0) + [0, figure.floor, 0], _PATH, 0.022, 0.6)]
  moves = places - way[at]
  bodies = [body_at(figure, t, tints[t], move) for t, move in zip(at, moves)]
  balls = [(a + move, b + move, *rest) for t, move in zip(at, moves) for frame, (a, b, *rest) in marks.bodies
           if frame == t and len(a) == 1]
  across, depth, elevation = places @ right, places @ [np.sin(angle), 0, np.cos(angle)], np.radians(9)
  middle = (across.max() + across.min()) / 2
  # Far away with a long lens: the bodies at the edges and those of a way that leads up to the camera look like those in
  # the middle. The nearer ones stand lower in the picture.
  top, deep = max(b[0][:, 1].max() for b in bodies) - figure.floor, float(np.ptp(depth))
  tallest = max(top, 0.9 * tall) * 1.4
  scene = tallest + 1.2 * deep * np.sin(elevation)
  distance = 6.0 * max(scene, deep)
  width = int(round((across.max() - across.min() + 2.4 * max(reach, 0.3 * tall)) / scene * height / 2)) * 2
  target = right * middle + [0, figure.floor + tallest * 0.385, 0]
  target = target + np.array([np.sin(angle), 0, np.cos(angle)]) * (depth.max() + depth.min()) / 2
  camera = render.look_at(target, angle, elevation, distance, distance / scene)

  def draw(width):
    size = (width, height)
    image = Image.fromarray(render.draw(camera, size, figure.floor, [*bodies, *balls], lines))
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(max(10, height // 26))
    for t, place in zip(at, places):
      x, y = render.project(camera, place + [0, figure.floor, 0], size)[0][:2]
      pen.text((x, min(y + height * 0.064, height * 0.965)), f"{t / clip.fps:.1f} s", INK, font, anchor="mm")
    text = _caption(clip) if caption is None else caption
    if text:
      font = ImageFont.load_default(max(11, height // 22))
      pen.text((height * 0.03, height * 0.03), _fit_text(text, font, size[0] - height * 0.06), INK, font)
    return np.asarray(image)

  return max(width, height // 2), draw


def _tints(figure, colors):
  usual = np.broadcast_to(default_colors(figure), (len(figure.joints), len(figure.parts), 3))
  if colors is None:
    return usual
  colors = np.asarray(colors, np.float64)
  try:
    colors = np.broadcast_to(colors[:, None] if colors.ndim == 2 else colors, usual.shape)
  except ValueError:
    raise ValueError(f"got colors of shape {colors.shape}, expected (3,), ({usual.shape[0]}, 3) or "
                     f"{usual.shape}") from None
  return np.where(np.isnan(colors), usual, colors)


def _caption(clip, t=None):
  """The caption of a clip at frame t, or of the whole clip; captions with times follow one another."""
  timed = [caption for caption in clip.captions if caption.start or caption.end]
  if t is None and len(timed) > 1:
    return " | ".join(caption.text for caption in timed)
  if t is not None:
    timed = [caption for caption in timed if caption.start <= t / clip.fps < caption.end]
  shown = timed or clip.captions
  return shown[0].text if shown else ""


def _thin(points):
  """Leaves out points of a way that are nearer than a centimetre to the last one kept."""
  keep = [0]
  for i in range(1, len(points)):
    if np.abs(points[i] - points[keep[-1]]).max() > 0.01:
      keep.append(i)
  return points[keep]


def _height(figure):
  """Standing height of the person, metres, from the bones of one leg, the spine and the head, whatever the pose."""
  lengths = np.linalg.norm(figure.pose.offsets, axis=-1)
  return max(0.3, float(2.05 * lengths.max() * 2))


def _azimuth(figure, azimuth, default):
  """Compass angle, radians, of the camera: azimuth degrees from the body's front (its first, where it turns about)."""
  ahead = figure.ahead.mean(0)
  if np.linalg.norm(ahead) < 0.6:
    ahead = figure.ahead[0]
  return np.arctan2(ahead[0], ahead[2]) + np.radians(default if azimuth is None else azimuth)


def _cameras(figure, fps, size, mode, azimuth):
  """One camera per frame."""
  view, elevation = VIEWS.get(mode, (35, 13))
  mode = "auto" if mode in VIEWS else mode
  joints, num_frames = np.concatenate([figure.joints, figure.a, figure.b], axis=1), len(figure.joints)
  root, tall = joints[:, 0], _height(figure)
  low, high = joints.min((0, 1)), joints.max((0, 1))
  if mode == "auto":
    mode = "follow" if np.linalg.norm((root.max(0) - root.min(0))[[0, 2]]) > 2.2 else "fixed"
  angle, elevation, focal = _azimuth(figure, azimuth, view), np.radians(elevation), 1.75
  if mode == "fixed":
    target = (low + high) / 2
    around = joints.reshape(-1, 3)
  else:
    target = gaussian_filter1d(root, 0.6 * fps, axis=0, mode="nearest")
    around = (joints - target[:, None]).reshape(-1, 3)
    target = target * [1, 0, 1] + [0, (low[1] + high[1]) / 2, 0]
    around = around * [1, 0, 1] + joints.reshape(-1, 3) * [0, 1, 0]
  middle = target if mode == "fixed" else np.array([0, (low[1] + high[1]) / 2, 0])
  middle = np.where([False, True, False], max(middle[1], figure.floor + 0.45 * tall), middle)
  # The nearest distance at which every joint, with some room for flesh and text, is inside the picture.
  camera = render.look_at(middle, angle, elevation, 0, focal)
  x, y, ahead = (around - middle) @ camera.right, (around - middle) @ camera.up, (around - middle) @ camera.back
  room = 0.065 * tall
  distance = max(((np.abs(y) + room) * 2 * focal * 1.06 + ahead).max(),
                 ((np.abs(x) + room) * 2 * focal * size[1] / size[0] + ahead).max(), 2.1 * tall)
  target = np.broadcast_to(target, (num_frames, 3)) * [1, 0, 1] + [0, middle[1] - 0.02 * tall, 0]
  return [render.look_at(at, angle, elevation, distance, focal) for at in target]


def _fit_text(text, font, width):
  letters = unicodedata.normalize("NFKD", text)  # Pillow's own font has the letters of English only
  text = " ".join("".join(letter for letter in letters if not unicodedata.combining(letter)).split())
  chars = max(8, int(0.97 * width / max(font.getlength(text) / max(len(text), 1), 1)))
  return "\n".join(textwrap.wrap(text, chars, max_lines=2, placeholder=" …"))


def _write_text(image, caption, clock, ink=INK):
  height, width = image.shape[:2]
  picture = Image.fromarray(image)
  pen, font = ImageDraw.Draw(picture), ImageFont.load_default(max(11, height // 25))
  if caption:
    text = _fit_text(caption, font, width * 0.92)
    pen.multiline_text((width / 2, height * 0.965), text, ink, font, anchor="md", align="center")
  pen.text((width * 0.975, height * 0.03), clock, ink, ImageFont.load_default(max(10, height // 32)), anchor="ra")
  return np.asarray(picture)


def find_ffmpeg() -> str:
  """The path of an ffmpeg program; EncoderError with what to do where there is none."""
  program = shutil.which("ffmpeg")
  if program:
    return program
  try:
    import imageio_ffmpeg
    return imageio_ffmpeg.get_ffmpeg_exe()
  except (ImportError, RuntimeError):
    raise EncoderError(f"no mp4 encoder here: install one with {pip_install('video')}, or write a .gif or "
                       "an .html page instead, which need none") from None


def _write_mp4(path, images, size, fps, program):
  command = [program, "-y", "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}",
             "-r", f"{fps:.6g}", "-i", "-", "-an", "-c:v", "libx264", "-preset", "veryfast", "-crf", "18",
             "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(path)]
  with (subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as process,
        stopping.undone_by(lambda: (process.kill(), process.wait()))):
    try:
      with contextlib.suppress(BrokenPipeError):  # ffmpeg gave up: its own words follow
        for image in images:
          process.stdin.write(image.tobytes())
      _, message = process.communicate()
    except BaseException:
      process.kill()
      raise
  if process.returncode:
    raise EncoderError(f"{program} failed: {message.decode(errors='replace').strip()[-300:]}; try a .gif instead")


def _write_gif(path, images, size, fps, palette):
  gif.write(path, images, fps, palette)
