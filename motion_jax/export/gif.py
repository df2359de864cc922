"""GIF films, written frame by frame: memory does not grow with their length.

Pillow holds all frames until the last is there. Here it compresses one picture after the other; header, colour table
and times are written around them (GIF89a, https://www.w3.org/Graphics/GIF/spec-gif89a.txt).
"""
import io
import struct

import numpy as np
from PIL import Image


def common_palette(images) -> Image.Image:
  """A palette of 255 colours for a whole film, from some of its images (H, W, 3) uint8."""
  height, width = images[0].shape[:2]
  sample = Image.new("RGB", (width, height * len(images)))
  for row, image in enumerate(images):
    sample.paste(Image.fromarray(image), (0, height * row))
  return sample.quantize(255, method=Image.Quantize.MEDIANCUT)


def write(path, images, fps, palette):
  """Writes images (H, W, 3) uint8, an iterable, as a film that repeats for ever.

  A gif counts hundredths of a second; rounding the sums keeps the whole at its right length. After the first image only
  the part that has changed is written.
  """
  colors = bytes(palette.getpalette()).ljust(768, b"\0")[:768]
  before, ended = None, 0
  with open(path, "wb") as file:
    for number, image in enumerate(images, 1):
      picture = Image.fromarray(image).quantize(palette=palette, dither=Image.Dither.NONE)
      now = np.asarray(picture)
      if before is None:
        height, width = now.shape
        file.write(b"GIF89a" + struct.pack("<HHBBB", width, height, 0xF7, 0, 0) + colors)
        file.write(b"\x21\xff\x0bNETSCAPE2.0\x03\x01\x00\x00\x00")
        box = (0, 0, width, height)
      else:
        box = _changed(before, now)
      end = round(number / fps * 100)
      file.write(b"\x21\xf9\x04" + struct.pack("<BHBx", 1 << 2, max(end - ended, 2), 0))
      file.write(b"\x2c" + struct.pack("<HHHHB", *box[:2], box[2] - box[0], box[3] - box[1], 0))
      file.write(_compressed(picture.crop(box)))
      before, ended = now, end
    file.write(b"\x3b")


def _changed(before, now):
  """The box (left, top, right, bottom) of what differs between two (H, W); a pixel where nothing does."""
  differs = before != now
  rows, columns = np.flatnonzero(differs.any(1)), np.flatnonzero(differs.any(0))
  if not len(rows):
    return 0, 0, 1, 1
  return int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1


def _compressed(picture):
  """The LZW blocks of an image with a palette, cut out of Pillow's GIF of it."""
  buffer = io.BytesIO()
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
