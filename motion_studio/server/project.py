"""A project: one JSON file that says how a motion was made, so that it can be made again, by the page or without it."""
import pathlib
from collections.abc import Callable
from typing import Any

from motion_jax.control import files
from motion_jax.control.constraints import Constraint
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import parse_json
from motion_jax.utils.text_files import read_text
from motion_studio.server import serialization
from motion_studio.server.library import Library
from motion_studio.server.limits import Fields, Limits
from motion_studio.server.requests import RequestHandler, make_edit, segment_rows

FORMAT, VERSION = "motion_jax project", 1


def checked(value: Any, limits: Limits) -> dict[str, Any]:
  """A project with every field that it may have, each checked. Raises InputError with what is wrong.

  {format, version, model: {name, id}, blocks: [{prompt, seconds}], seeds, chosen, sampling, cleanup, past, control,
  edits}
  """
  if not isinstance(value, dict) or value.get("format") != FORMAT:
    raise InputError("this is no project of motion_jax; one is saved by the studio's page")
  if value.get("version") != VERSION:
    raise InputError(f"this project is of version {str(value.get('version'))[:20]}, this program reads version "
                     f"{VERSION}; open it with the version of motion_jax that saved it")
  fields = Fields({key: item for key, item in value.items() if key not in ("format", "version")}, limits)
  model, blocks = _model(fields.any("model"), limits), fields.any("blocks")
  rows = segment_rows(blocks, limits)
  seeds, sampling, past = fields.any("seeds", [0]), fields.choices(), fields.any("past")
  if not isinstance(seeds, list) or not 1 <= len(seeds) <= limits.takes:
    raise InputError(f"got the seeds {str(seeds)[:40]}, expected a list of 1 to {limits.takes} whole numbers")
  seeds = [Fields({"seed": seed}, limits).seed() for seed in seeds]
  chosen = fields.number("chosen", 0, len(seeds) - 1, 0, whole=True)
  cleanup, edits, control = fields.switch("cleanup", True), fields.any("edits", []), fields.control()
  fields.done()
  if past is not None:
    serialization.from_json(past, limits.frames)
  if not isinstance(edits, list) or len(edits) > 100:
    raise InputError(f"got the edits {str(edits)[:40]}, expected a list of at most 100")
  return {"format": FORMAT, "version": VERSION, "model": model,
          "blocks": [{"prompt": prompt, "seconds": seconds} for prompt, seconds in rows], "seeds": seeds,
          "chosen": chosen, "sampling": sampling, "cleanup": cleanup, "past": past,
          "control": files.to_json(control) if control else None,
          "edits": [_edit(edit, limits) for edit in edits]}


def read(path: str | pathlib.Path, limits: Limits) -> dict[str, Any]:
  """The project in a file. Raises FileNotFoundError, or InputError for one that is cut or of another version."""
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}")
  if path.stat().st_size > limits.body_bytes:
    raise InputError(f"{path} is larger than a project can be ({limits.body_bytes >> 20} MiB)")
  value = parse_json(read_text(path), path, "it may have been cut: save it again, or take a copy")
  try:
    return checked(value, limits)
  except InputError as error:
    raise InputError(f"{path}: {error}") from None


def made(project: dict[str, Any], library: Library, limits: Limits, take: int | None = None,
         tell: Callable[[str], None] = lambda note: None) -> Any:
  """The Motion that a checked project describes, of its chosen seed or that of number `take`.

  tell(note): a model whose weights are others makes another motion.
  """
  handler = RequestHandler(library, limits)
  take = project["chosen"] if take is None else take
  if not 0 <= take < len(project["seeds"]):
    raise InputError(f"got the take {take}, this project has {len(project['seeds'])}, counted from 0")
  model = _same(library.model(project["model"]["name"], "multi_prompt"), project["model"], tell)
  rows = [(block["prompt"], block["seconds"]) for block in project["blocks"]]
  past = project["past"] and serialization.from_json(project["past"], limits.frames)
  motion, _, _ = handler.make_multi_prompt(model, rows, project["seeds"][take], project["cleanup"],
                                             project["sampling"], past, control_of(project))
  for edit in project["edits"]:
    if edit["take"] == take:
      editor = _same(library.model(edit["model"]["name"], "edit"), edit["model"], tell)
      motion = make_edit(editor, motion, edit["prompt"], edit["change"], None, edit["seed"], edit["sampling"])
  return motion


def control_of(project: dict[str, Any]) -> list[Constraint]:
  """The constraints of a checked project."""
  return files.from_json(project["control"]) if project["control"] else []


def models_of(project: dict[str, Any]) -> list[str]:
  """The names of the models that a project needs."""
  return list(dict.fromkeys([project["model"]["name"], *(edit["model"]["name"] for edit in project["edits"])]))


def _model(value, limits):
  fields = Fields(value, limits)
  found = {"name": fields.text("name"), "id": fields.text("id", "")}
  fields.done()
  return found


def _edit(value, limits):
  fields = Fields(value, limits)
  found = {"take": fields.number("take", 0, limits.takes - 1, 0, whole=True), "prompt": fields.prompt(),
           "change": fields.spans("change"), "seed": fields.seed(), "sampling": fields.choices(),
           "model": _model(fields.any("model"), limits)}
  fields.done()
  if found["change"] is None:
    raise InputError("an edit lacks change, the frames that it makes anew")
  return found


def _same(model, told, tell):
  if told["id"] and told["id"] != model.id:
    tell(f"the project was made with {told['id']}, this is {model.id}: the motion may be another one")
  return model
