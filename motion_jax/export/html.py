"""One HTML file that shows motions in any browser, offline: a three.js viewer with the motion inside.

The viewer (assets/viewer.js) is built from tools/viewer; the page loads nothing from anywhere.
"""
import base64
import html as html_lib
import json
import pathlib
import re

import numpy as np

from motion_jax.data.clip import Clip, atomic_path
from motion_jax.export.body import COLORS, GROUPS, make_figure

_ASSETS = pathlib.Path(__file__).parent / "assets"


def html(clip, path, title=None) -> pathlib.Path:
  """Writes a page that plays one clip, or a list of clips side by side with a selector."""
  path = pathlib.Path(path)
  clips = [clip] if isinstance(clip, Clip) else list(clip)
  data = {"clips": [_describe(one) for one in clips]}
  title = title or (clips[0].captions[0].text if clips[0].captions else clips[0].id)
  page = (_ASSETS / "viewer.html").read_text(encoding="utf-8")
  # A "<" in a caption must not end the script element: in JSON it may be written as \\u003c.
  values = {"@TITLE@": html_lib.escape(title), "@DATA@": json.dumps(data, ensure_ascii=False).replace("<", "\\u003c"),
            "@VIEWER@": (_ASSETS / "viewer.js").read_text(encoding="utf-8")}
  text = re.sub("|".join(values), lambda found: values[found[0]], page)  # one pass: values are not searched again
  with atomic_path(path) as temporary:
    temporary.write_text(text, encoding="utf-8")
  return path


def _describe(clip):
  """A clip as JSON for the viewer: joints float32 and rotations int16 in base64, the parts of the body, metres."""
  figure = make_figure(clip)
  joints = figure.joints.astype("<f4")
  turned = np.round(figure.pose.turned * 32767).astype("<i2")
  captions = clip.captions or ()
  parts = [{"a": part.a, "b": part.b, "frame": part.frame, "aOffset": _round(part.a_offset),
            "bOffset": _round(part.b_offset), "aRadius": round(part.a_radius, 5), "bRadius": round(part.b_radius, 5),
            "color": GROUPS.index(part.group)} for part in figure.parts]
  return {"name": captions[0].text if captions else clip.id, "fps": clip.fps, "frames": clip.num_frames,
          "numJoints": joints.shape[1], "floor": round(figure.floor, 5),
          "captions": [{"text": c.text, "start": c.start, "end": c.end} for c in captions],
          "joints": _base64(joints), "turned": _base64(turned), "parts": parts, "colors": list(COLORS.values()),
          "low": _round(joints.min((0, 1))), "high": _round(joints.max((0, 1))), "start": _round(joints[0, 0, [0, 2]]),
          "ahead": _round(figure.ahead.mean(0)[[0, 2]] if clip.num_frames else (0, 1))}


def _round(values):
  return [round(float(value), 5) for value in values]


def _base64(array):
  return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
