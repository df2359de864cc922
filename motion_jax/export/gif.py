"""GIF films, written frame by frame: memory does not grow with their length.

Pillow holds all frames until the last is there. Here it compresses one picture after the other; header, colour table
and times are written around them (GIF89a, https://www.w3.org/Graphics/GIF/spec-gif89a.txt). What hardly changes from
one picture to the next stays as it was (transparent), which makes files a third of the size.
"""
import io
import struct

import numpy as np
from PIL import Image

_COLORS, _PLAIN = 64, 6  # more of them hardly show in a figure on a plain ground, but add to the size
_TOLERANCE = 8           # of 255, by which a pixel may differ from what is shown before it is written again
_CLEAR = 255             # the colour number that leaves a pixel as it was


def common_palette(images) -> Image.Image:
  """A palette of 64 colours for a whole film, from some of its images (H, W, 3) uint8."""
  pixels = np.concatenate([image.reshape(-1, 3) for image in images])
  # A few colours by how often they occur, which are the ground's; for the others each tone counts once.
  tones = np.unique(pixels & 0xFC, axis=0) + 2
  cut = lambda points, num: Image.fromarray(points[None]).quantize(num, method=Image.Quantize.MEDIANCUT).getpalette()
  colors = cut(pixels[::7], _PLAIN)[:3 * _PLAIN] + cut(tones, _COLORS - _PLAIN)[:3 * (_COLORS - _PLAIN)]
  colors += colors[:3] * (_COLORS - len(colors) // 3)
  palette = Image.new("P", (1, 1))
  palette.putpalette((colors + colors[:3] * 256)[:768])  # behind the last colour the first one again
  return palette


def write(path, images, fps, palette, tolerance=_TOLERANCE):
  """Writes images (H, W, 3) uint8, an iterable, as a film that repeats for ever.

  A gif counts hundredths of a second; rounding the sums keeps the whole at its right length. After the first image only
  pixels are written that differ by more than the tolerance, 0..255, from what is shown.
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
      end = round(number / fps * 100)
      clear = (1 << 2 | (number > 1), max(end - ended, 2), _CLEAR)  # pictures stay; one colour is transparent
      file.write(b"\x21\xf9\x04" + struct.pack("<BHBx", *clear))
      file.write(b"\x2c" + struct.pack("<HHHHB", left, top, right - left, bottom - top, 0))
      file.write(_compressed(now[top:bottom, left:right]))
      ended = end
    file.write(b"\x3b")


def _changed(differs):
  """The box (left, top, right, bottom) of what differs (H, W); a pixel where nothing does."""
  rows, columns = np.flatnonzero(differs.any(1)), np.flatnonzero(differs.any(0))
  if not len(rows):
    return 0, 0, 1, 1
  return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _compressed(numbers):
  """The LZW blocks of colour numbers (H, W), cut out of Pillow's GIF of them."""
  buffer, picture = io.BytesIO(), Image.fromarray(np.ascontiguousarray(numbers))
  picture.putpalette(bytes(np.arange(256, dtype=np.uint8).repeat(3)))
  picture.save(buffer, "GIF", optimize=False, interlace=False)
  data, at = buffer.getvalue(), 13
  if data[10] & 0x80:  # its colour table
    at += 3 << ((data[10] & 7) + 1)
  while data[at] == 0x21:  # extensions: blocks of a length each, until one of length 0
    at += 2
    while data[at]:
      at += data[at] + 1
    at += 1
  flags = data[at + 9]
  at += 10 + (3 << ((flags & 7) + 1) if flags & 0x80 else 0)
  return data[at:data.rindex(b"\x3b")]
