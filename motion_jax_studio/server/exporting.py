"""/v1/export: a motion as the bytes of a file, optionally trimmed, in place or looped."""
import re
import tempfile
from pathlib import Path
from typing import Any

from motion_jax import export
from motion_jax.control.compiling import compile
from motion_jax.export import scene
from motion_jax.models.results import colors_of
from motion_jax.motion.looping import in_place, looped, velocity
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
from motion_jax_studio.server import export_choices, fields
from motion_jax_studio.server.limits import Limits
from motion_jax_studio.server.request_types import types_of

_FILM_SECONDS = 60.0  # of a rendered film


def exported(body: Any, limits: Limits) -> tuple[bytes, str, str]:
  """(bytes, media type, file name) of a request with the fields of `Export`."""
  request = fields.parse(types_of(limits).export, body, limits)
  clip, kind = request.motion, request.format
  given = export_choices.options_of(kind, {name: getattr(request, name) for name in export_choices.OPTIONS})
  if request.rig and request.character is not None:
    raise InputError("got a rig and a character, which keeps its own bones; give one of them")
  if kind == "vrm" and request.character is None:
    raise InputError("got the format vrm without a character; give one, or choose vrma for the motion alone")
  name = request.name or (clip.captions[0].text if clip.captions else clip.id)
  shown = variant(clip, request.trim, request.in_place, request.loop)
  draws = request.control and kind in export_choices.RENDERED and not request.in_place and not request.loop
  options = _constraint_options(request.control, clip, request.trim, kind) if draws else {}
  return written(shown, kind, **options, **given), export_choices.media(kind), f"{file_name(name)}.{kind}"


def _constraint_options(control, clip, trim, kind):
  """The options of `export.save` that draw the constraints of a clip."""
  if clip.skeleton is not HUMANML3D:
    raise InputError(f"got control of the skeleton {clip.skeleton.name!r}; control knows {HUMANML3D.name}")
  signal = compile(control, clip.num_frames, clip.fps, clip.joints)
  if trim is not None:
    signal = signal.slice_frames(*trim[0])
  return {"control": signal} | ({"way_points": scene.way_points(control)} if kind == "html" else {})


def variant(clip: Any, trim: Any = None, still: bool = False, loop: bool = False) -> Any:
  """A clip trimmed to one span of frames, looped, with the root kept in place."""
  if trim is not None:
    if len(trim) != 1 or trim[0][1] > clip.num_frames:
      raise InputError(f"got trim {str(trim)[:40]}, expected one span of the {clip.num_frames} frames of the motion")
    frames, clip = clip.num_frames, clip.cut(*trim[0])
    if _are_spans(new_spans := clip.meta.get("made"), frames):
      first, past = trim[0]
      new_spans = [[max(a, first) - first, min(b, past) - first] for a, b in new_spans if a < past and b > first]
      clip = clip.replace(meta=clip.meta | {"made": new_spans})
  if loop:
    clip = clip.replace(joints=looped(clip.joints, clip.fps, clip.skeleton), features=None)
  if still:
    meta = clip.meta | {"velocity": velocity(clip.joints, clip.fps, clip.skeleton).tolist()}
    clip = clip.replace(joints=in_place(clip.joints), features=None, meta=meta)
  return clip


def written(clip: Any, kind: str, character: bytes | None = None, **options: Any) -> bytes:
  """The bytes of the file that `export.save` writes with these options; character: those of a rigged .glb or .vrm."""
  if kind in export_choices.RENDERED:
    if kind in ("mp4", "gif") and clip.seconds > _FILM_SECONDS:
      raise InputError(f"got a motion of {clip.seconds:.0f} s for a film, expected at most {_FILM_SECONDS:g} s; "
                       "trim it")
    if _are_spans(clip.meta.get("made"), clip.num_frames):
      options["colors"] = colors_of(clip)
  with tempfile.TemporaryDirectory() as folder:
    path, file = Path(folder) / f"motion.{kind}", Path(folder) / "character.glb"
    if character is not None:
      file.write_bytes(character)
      options["file"] = file
    try:
      export.save(clip, path, **options)
    except (ValueError, OSError, RuntimeError) as error:
      raise InputError(str(error).splitlines()[0].replace(str(path), f"the .{kind} file").replace(
          str(file), "the character")) from None
    return path.read_bytes()


def file_name(text: str) -> str:
  """A file name of letters, digits and dashes from any text."""
  return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:60] or "motion"


def _are_spans(value, frames):
  return isinstance(value, list) and bool(value) and all(
      isinstance(span, list | tuple) and len(span) == 2 and all(type(frame) is int for frame in span)
      and 0 <= span[0] < span[1] <= frames for span in value)
