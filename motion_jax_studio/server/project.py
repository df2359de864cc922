"""Project files: JSON that records how a motion was generated, so that the page or `motion-jax make` can repeat it."""
import pathlib
from collections.abc import Callable
from typing import Any

import msgspec

from motion_jax.control import files
from motion_jax.control.constraints import Constraint
from motion_jax.utils.errors import InputError
from motion_jax.utils.format_versions import check_version
from motion_jax.utils.input_files import parse_json
from motion_jax.utils.text_files import read_text
from motion_jax_studio.server import fields, serialization
from motion_jax_studio.server.library import Library
from motion_jax_studio.server.limits import Limits
from motion_jax_studio.server.request_types import types_of
from motion_jax_studio.server.requests import RequestHandler, make_edit
from motion_jax_studio.step_names import EDIT, EXTEND

FORMAT, VERSION = "motion_jax project", 1


def validate(value: Any, limits: Limits) -> dict[str, Any]:
  """A project with all of its fields (`Project`), each checked. Raises InputError for a project that is not valid."""
  if not isinstance(value, dict) or value.get("format") != FORMAT:
    raise InputError("this is no project of motion_jax; one is saved by the studio's page")
  check_version(value.get("version"), "this project", VERSION)
  body = {name: part for name, part in value.items() if name not in ("format", "version")}
  project = fields.parse(types_of(limits).project, body, limits)
  if project.chosen >= len(project.seeds):
    raise InputError(f"got chosen {project.chosen}, expected a whole number from 0 to {len(project.seeds) - 1}, the "
                     "place of one of the seeds")
  return {"format": FORMAT, "version": VERSION} | msgspec.to_builtins(msgspec.structs.asdict(project) | {
      "past": value.get("past"), "without": [name for name in EDIT if name in project.without],
      "control": _as_json(project.control), "edits": [msgspec.structs.asdict(edit) | {"control": _as_json(edit.control)}
                                                      for edit in project.edits]})


def read(path: str | pathlib.Path, limits: Limits) -> dict[str, Any]:
  """The project in a file. Raises FileNotFoundError, or InputError for a damaged file or another version."""
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}")
  if path.stat().st_size > limits.body_bytes:
    raise InputError(f"{path} is larger than a project can be ({limits.body_bytes >> 20} MiB)")
  value = parse_json(read_text(path), path, "it may be incomplete: save it again, or use a copy")
  try:
    return validate(value, limits)
  except InputError as error:
    raise InputError(f"{path}: {error}") from None


def generate(project: dict[str, Any], library: Library, limits: Limits, take: int | None = None,
         notify: Callable[[str], None] = lambda note: None) -> Any:
  """The Motion of a checked project, with its chosen seed or the seed at index `take`.

  notify(note) is called if the model has other weights than the one in the project.
  """
  handler = RequestHandler(library, limits)
  take = project["chosen"] if take is None else take
  if not 0 <= take < len(project["seeds"]):
    raise InputError(f"got the take {take}, this project has {len(project['seeds'])}, counted from 0")
  pipeline = _with_warning(library.pipeline(project["model"]["name"], "multi_prompt"), project["model"], notify)
  out = frozenset(project["without"])
  rows = [(block["prompt"], block["seconds"]) for block in project["blocks"]]
  past = project["past"] and serialization.from_json(project["past"], limits.frames)
  motion, _, _ = handler.make_multi_prompt(pipeline, rows, project["seeds"][take], project["cleanup"],
                                             project["sampling"], past, control_of(project), out & {*EXTEND})
  for edit in project["edits"]:
    if edit["take"] == take:
      editor = _with_warning(library.pipeline(edit["model"]["name"], "edit"), edit["model"], notify)
      motion = make_edit(editor, motion, edit["prompt"], edit["change"], None, edit["seed"], edit["sampling"],
                         out, control_of(edit))
  return motion


def control_of(project: dict[str, Any]) -> list[Constraint]:
  """The constraints of a checked project, or of one of its edits."""
  return files.from_json(project["control"]) if project["control"] else []


def _as_json(control):
  return files.to_json(control) if control else None


def models_of(project: dict[str, Any]) -> list[str]:
  """The names of the models that a project needs."""
  return list(dict.fromkeys([project["model"]["name"], *(edit["model"]["name"] for edit in project["edits"])]))


def _with_warning(pipeline, saved, notify):
  if saved["id"] and saved["id"] != pipeline.model.id:
    notify(f"the project was made with {saved['id']}, this is {pipeline.model.id}: the motion may be another one")
  return pipeline
