"""What /v1/export can write, from the library's own tables: formats with their options, rigs."""
import functools
import inspect
import mimetypes
import tempfile
from pathlib import Path
from typing import Any

from motion_jax import export
from motion_jax.rigs.rig import all_rigs
from motion_jax.utils.errors import InputError, reason

RENDERED = ("mp4", "gif", "png", "jpg", "html")  # pictures and pages: the body is drawn
OF_CHARACTERS = ("glb", "vrm")
OPTIONS = ("rig", "t_pose", "fps", "character")


@functools.cache
def formats() -> dict[str, tuple[str, ...]]:
  """{format: those of OPTIONS that its writer takes} of all writers."""
  taken = {}
  for ending, write in export.WRITERS.items():
    takes, kind = inspect.signature(write).parameters, ending[1:]
    taken[kind] = tuple(option for option in OPTIONS if option in takes or option == "fps" and kind not in RENDERED
                        or option == "character" and kind in OF_CHARACTERS)
  return taken


def media(kind: str) -> str:
  """The media type of a format."""
  return {"glb": "model/gltf-binary", "html": "text/html; charset=utf-8", "bvh": "text/plain; charset=utf-8"}.get(
      kind, mimetypes.guess_type(f"motion.{kind}")[0] or "application/octet-stream")


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


def options_of(kind: str, given: dict[str, Any]) -> dict[str, Any]:
  """The options of a request that are set. Raises InputError for one that the format does not take."""
  chosen = {name: value for name, value in given.items() if value not in (None, False)}
  for name in chosen:
    if name not in formats()[kind]:
      able = [other for other, options in formats().items() if name in options]
      raise InputError(f"got {name} for the format {kind}, expected one of {', '.join(able)}")
  return chosen
