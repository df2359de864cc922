"""Write GIF films frame by frame, so that memory does not grow with their length.

`Image.save` keeps all frames in memory until the last is there; its encoder of single frames writes one after the other
(GIF89a, https://www.w3.org/Graphics/GIF/spec-gif89a.txt). Pixels that hardly change from one frame to the next are left
transparent, which reduces the file to a third.
"""
import struct

import numpy as np

from motion_jax.utils.lazy import LazyModule

GifImagePlugin, Image = (LazyModule(f"PIL.{name}") for name in ("GifImagePlugin", "Image"))

_COLORS, _PLAIN = 64, 6  # colours, and those of the ground; more make files larger and look the same
_TOLERANCE = 8           # of 255: a pixel is rewritten only if it differs by more from the one shown
_CLEAR = 255             # the colour number of transparent pixels


def common_palette(images) -> "Image.Image":
  """A palette of 64 colours for a whole film, from some of its images (H, W, 3) uint8."""
  pixels = np.concatenate([image.reshape(-1, 3) for image in images])
  # A few colours weighted by frequency, for the ground; for the others each tone counts once.
  tones = np.unique(pixels & 0xFC, axis=0) + 2
  cut = lambda points, num: Image.fromarray(points[None]).quantize(num, method=Image.Quantize.MEDIANCUT).getpalette()
  colors = cut(pixels[::7], _PLAIN)[:3 * _PLAIN] + cut(tones, _COLORS - _PLAIN)[:3 * (_COLORS - _PLAIN)]
  colors += colors[:3] * (_COLORS - len(colors) // 3)
  palette = Image.new("P", (1, 1))
  palette.putpalette((colors + colors[:3] * 256)[:768])  # the first colour fills the rest
  return palette


def write(path, images, fps, palette, tolerance=_TOLERANCE):
  """Writes images (H, W, 3) uint8, an iterable, as a film that repeats forever.

  A gif counts hundredths of a second; rounding the sums keeps the total length right. After the first image only pixels
  are written that differ by more than the tolerance, 0..255, from those shown.
  """
  colors = np.array(palette.getpalette(), np.int16).reshape(256, 3)
  shown, ended = None, 0
  with open(path, "wb") as file:
    for number, image in enumerate(images, 1):
      now = np.asarray(Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE))
      now = np.where(now < _COLORS, now, 0).astype(np.uint8)
      if shown is None:
        height, width = now.shape
        file.write(b"GIF89a" + struct.pack("<HHBBB", width, height, 0xF7, 0, 0) + colors.astype(np.uint8).tobytes())
        file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00")
        box, shown = (0, 0, width, height), colors[now]
      else:
        keeps = (colors[now] == shown).all(-1) | (np.abs(image - shown).max(-1) <= tolerance)
        shown = np.where(keeps[..., None], shown, colors[now])
        now = np.where(keeps, np.uint8(_CLEAR), now)
        box = _changed(~keeps)
      left, top, right, bottom = box
      picture = Image.fromarray(np.ascontiguousarray(now[top:bottom, left:right]))
      end = round(number / fps * 100)
      options = dict(duration=10 * max(end - ended, 2), disposal=1)  # milliseconds; 1: the frame stays under the next
      if number > 1:
        options["transparency"] = _CLEAR
      file.writelines(GifImagePlugin.getdata(picture, (left, top), **options))
      ended = end
    file.write(b"\x3b")


def _changed(differs):
  """The box (left, top, right, bottom) around True pixels (H, W); one pixel if there are none."""
  rows, columns = np.flatnonzero(differs.any(1)), np.flatnonzero(differs.any(0))
  if not len(rows):
    return 0, 0, 1, 1
  return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1
