"""A motion as the bytes of a file, trimmed, held in its place or made a loop before."""
import re
import tempfile
from pathlib import Path
from typing import Any

from motion_jax import export
from motion_jax.control.compiling import compile
from motion_jax.export import scene
from motion_jax.models.results import colors_of
from motion_jax.motion.looping import in_place, looped
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
from motion_studio.server import serialization
from motion_studio.server.limits import Fields, Limits

KINDS = {"bvh": "text/plain; charset=utf-8", "glb": "model/gltf-binary", "npz": "application/octet-stream",
         "npy": "application/octet-stream", "mp4": "video/mp4", "gif": "image/gif", "html": "text/html; charset=utf-8",
         "png": "image/png"}
_DRAWN = ("mp4", "gif", "png", "html")
_FILM_SECONDS = 60.0  # of a film that is drawn


def exported(body: Any, limits: Limits) -> tuple[bytes, str, str]:
  """(bytes, media type, name of the file) of {motion, format, trim, in_place, loop, name, control}."""
  fields = Fields(body, limits)
  clip = serialization.from_json(fields.any("motion"), limits.frames)
  kind, name = fields.text("format"), fields.text("name", clip.captions[0].text if clip.captions else clip.id, 1000)
  trim, still, loop = fields.spans("trim"), fields.switch("in_place", False), fields.switch("loop", False)
  control = fields.control()
  fields.done()
  if kind not in KINDS:
    raise InputError(f"got the format {kind[:20]!r}, expected one of {', '.join(KINDS)}")
  shown = variant(clip, trim, still, loop)
  drawn = {} if still or loop or not control or kind not in _DRAWN else _drawn(control, clip, trim, kind)
  return written(shown, kind, **drawn), KINDS[kind], f"{file_name(name)}.{kind}"


def _drawn(control, clip, trim, kind):
  """The options of `export.save` by which what was asked of a clip is seen."""
  if clip.skeleton is not HUMANML3D:
    raise InputError(f"got control of the skeleton {clip.skeleton.name!r}; control knows {HUMANML3D.name}")
  asked = compile(control, clip.num_frames, clip.fps, clip.joints)
  if trim is not None:
    asked = asked.slice_frames(*trim[0])
  return {"asked": asked} | ({"way_points": scene.way_points(control)} if kind == "html" else {})


def variant(clip: Any, trim: Any = None, still: bool = False, loop: bool = False) -> Any:
  """A clip cut to one span of frames, made a loop, held in its place."""
  if trim is not None:
    if len(trim) != 1 or trim[0][1] > clip.num_frames:
      raise InputError(f"got trim {str(trim)[:40]}, expected one span of the {clip.num_frames} frames that there are")
    frames, clip = clip.num_frames, clip.cut(*trim[0])
    if _are_spans(made := clip.meta.get("made"), frames):
      first, past = trim[0]
      made = [[max(a, first) - first, min(b, past) - first] for a, b in made if a < past and b > first]
      clip = clip.replace(meta=clip.meta | {"made": made})
  if loop:
    clip = clip.replace(joints=looped(clip.joints, clip.fps, clip.skeleton), features=None)
  if still:
    clip = clip.replace(joints=in_place(clip.joints), features=None)
  return clip


def written(clip: Any, kind: str, **options: Any) -> bytes:
  """The bytes that `export.save` writes with these options."""
  if kind in _DRAWN:
    if kind in ("mp4", "gif") and clip.seconds > _FILM_SECONDS:
      raise InputError(f"got a motion of {clip.seconds:.0f} s for a film, expected at most {_FILM_SECONDS:g} s; "
                       "trim it")
    if _are_spans(clip.meta.get("made"), clip.num_frames):
      options["colors"] = colors_of(clip)
  with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / f"motion.{kind}"
    try:
      export.save(clip, path, **options)
    except (ValueError, OSError, RuntimeError) as error:
      raise InputError(str(error).splitlines()[0].replace(str(path), f"the .{kind} file")) from None
    return path.read_bytes()


def file_name(text: str) -> str:
  """A name for a downloaded file of what somebody wrote: letters, digits and dashes."""
  return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:60] or "motion"


def _are_spans(value, frames):
  return isinstance(value, list) and bool(value) and all(
      isinstance(span, list | tuple) and len(span) == 2 and all(type(frame) is int for frame in span)
      and 0 <= span[0] < span[1] <= frames for span in value)
