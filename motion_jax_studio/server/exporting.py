"""/v1/export: a motion as the bytes of a file, optionally trimmed, in place or looped; and the formats and rigs that
/v1/export-choices lists, from the library's own tables."""
import functools
import inspect
import mimetypes
import re
import tempfile
from pathlib import Path
from typing import Any

from motion_jax import export
from motion_jax.export import scene
from motion_jax.models.results import colors_of
from motion_jax.motion.looping import in_place, looped, velocity
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.rigs.rig import all_rigs
from motion_jax.utils.errors import InputError, reason

_FILM_SECONDS = 60.0  # of a rendered film
_RENDERED = ("mp4", "gif", "png", "jpg", "html")  # pictures and pages: the body is drawn
_OPTIONS = ("rig", "t_pose", "fps", "character")
_MEDIA = {"glb": "model/gltf-binary", "html": "text/html; charset=utf-8", "bvh": "text/plain; charset=utf-8"}


@functools.cache
def formats() -> dict[str, tuple[str, ...]]:
  """{format: those of rig, t_pose, fps and character that its writer takes} of all writers."""
  options = {}
  for ending, write in export.WRITERS.items():
    takes, kind = inspect.signature(write).parameters, ending[1:]
    options[kind] = tuple(option for option in _OPTIONS if option in takes or option == "fps" and kind not in _RENDERED
                          or option == "character" and kind in ("glb", "vrm"))
  return options


def choices() -> dict[str, Any]:
  """{formats: [{name, options, missing: what to install, or null}], rigs: [{name, title}]}."""
  return {"formats": [{"name": kind, "options": list(options), "missing": _missing(kind)}
                      for kind, options in formats().items()],
          "rigs": [{"name": name, "title": rig.title} for name, rig in all_rigs().items()]}


def _missing(kind):
  with tempfile.TemporaryDirectory() as folder:
    try:
      export.check_output(Path(folder) / f"motion.{kind}")
    except (ValueError, OSError, RuntimeError, ImportError) as error:
      return reason(error, 300)
  return None


def export_file(request: Any) -> tuple[bytes, str, str]:
  """(bytes, media type, file name) of an `Export` request."""
  clip, kind = request.motion, request.format
  options = {name: value for name in _OPTIONS if (value := getattr(request, name)) not in (None, False)}
  for name in options:
    if name not in formats()[kind]:
      able = [other for other, names in formats().items() if name in names]
      raise InputError(f"got {name} for the format {kind}, expected one of {', '.join(able)}")
  if request.rig and request.character is not None:
    raise InputError("got a rig and a character, which keeps its own bones; give one of them")
  if kind == "vrm" and request.character is None:
    raise InputError("got the format vrm without a character; give one, or choose vrma for the motion alone")
  name = request.name or (clip.captions[0].text if clip.captions else clip.id)
  shown = _variant(clip, request.trim, request.in_place, request.loop)
  if request.control and kind in _RENDERED and not request.in_place and not request.loop:
    if clip.skeleton is not HUMANML3D:
      raise InputError(f"got control of the skeleton {clip.skeleton.name!r}; control knows {HUMANML3D.name}")
    span = slice(*request.trim[0]) if request.trim else slice(0, clip.num_frames)
    options |= scene.drawn_constraints(request.control, [clip], [span], kind)
  media = _MEDIA.get(kind, mimetypes.guess_type(f"motion.{kind}")[0] or "application/octet-stream")
  return _written(shown, kind, **options), media, f"{_file_name(name)}.{kind}"


def _variant(clip, trim, still, loop):
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


def _written(clip, kind, character=None, **options):
  """The bytes of the file that `export.save` writes with these options; character: those of a rigged .glb or .vrm."""
  if kind in _RENDERED:
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


def _file_name(text):
  """A file name of letters, digits and dashes from any text."""
  return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:60] or "motion"


def _are_spans(value, frames):
  return isinstance(value, list) and bool(value) and all(
      isinstance(span, list | tuple) and len(span) == 2 and all(type(frame) is int for frame in span)
      and 0 <= span[0] < span[1] <= frames for span in value)
