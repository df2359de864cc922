"""The description of a robot: which bodies follow which human parts, its upright pose, its joints that keep still."""
import collections
import json
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import named

SIDES = ("left", "right")
PARTS = ("pelvis", "torso", *(f"{side}_{part}" for side in SIDES for part in (
    "hip", "knee", "ankle", "shoulder", "elbow", "wrist")))
_KEYS = {"bodies": dict, "stand": dict, "posture": dict, "apart": list, "fixed": dict, "orders": dict, "name": str,
         "title": str, "model": str, "licence": str}


def read(path: pathlib.Path, mapping: str | pathlib.Path | Mapping[str, Any] | None) -> dict[str, Any]:
  """The description of the robot file `path`: {"bodies": ..., ...}, from a JSON file or as it is given.

  Raises InputError for a missing one, unknown keys, values of another kind, and a name that stands in it twice.
  """
  if mapping is None:
    template = ", ".join(f'"{part}": "..."' for part in PARTS)
    raise InputError(f"{path}: a robot of your own needs a mapping file {{{template}}} with its bodies; give it by "
                     "--robot-mapping FILE.json (mapping=)")
  if not isinstance(mapping, Mapping):
    mapping = _read_json(pathlib.Path(mapping))
  about = dict(mapping) if "bodies" in mapping else {"bodies": dict(mapping)}
  unknown = [key for key in about if key not in _KEYS]
  if unknown:
    raise InputError(f"{path}: the description has the keys {named(unknown)}, expected {', '.join(_KEYS)}")
  for key, value in about.items():
    if not isinstance(value, _KEYS[key]):
      raise InputError(f"{path}: {key} of the description is {str(value)[:60]}, expected "
                       f"{'an object' if _KEYS[key] is dict else 'a list' if _KEYS[key] is list else 'text'}")
  for key in ("stand", "posture"):
    for joint, value in about.get(key, {}).items():
      if type(value) not in (int, float) or not abs(value) < 1e3:
        raise InputError(f"{path}: {key} of the description gives {joint} the value {str(value)[:60]}, expected a "
                         f"number{' of radians' if key == 'stand' else ''}")
  for key in ("fixed", "orders"):
    for name, value in about.get(key, {}).items():
      if not isinstance(value, list | tuple) or not all(isinstance(joint, str) for joint in value):
        raise InputError(f"{path}: {key} of the description gives {name} the value {str(value)[:60]}, expected a list "
                         "of joints")
  return about


def _read_json(path):
  from motion_jax.utils.input_files import parse_json
  from motion_jax.utils.text_files import read_text
  text = read_text(path)
  if not isinstance(parse_json(text, str(path)), dict):
    raise InputError(f"{path}: got a mapping that is no object, expected {{human part: body}}")

  def once(pairs):
    twice = [name for name, count in collections.Counter(name for name, _ in pairs).items() if count > 1]
    if twice:
      raise InputError(f"{path}: {named(twice)} stands twice in one object of the mapping; keep one of them")
    return dict(pairs)
  return json.loads(text, object_pairs_hook=once)


def body_and_point(path: pathlib.Path, part: str, value: Any) -> tuple[str, np.ndarray]:
  """(body, point (3,) in its frame) of a human part. Raises InputError for another value."""
  body, point = (value, (0, 0, 0)) if isinstance(value, str) else (
      value if isinstance(value, (list, tuple)) and len(value) == 2 else (None, None))
  numbers = isinstance(point, (list, tuple)) and all(type(x) in (int, float) and abs(x) < 1e3 for x in point)
  if not isinstance(body, str) or not numbers or len(point) != 3:
    raise InputError(f"{path}: the mapping gives {part} the value {str(value)[:60]}, expected a body, or [body, [x, y, "
                     "z]] for a point in its frame")
  return body, np.asarray(point, np.float64)


def check_bodies(path: pathlib.Path, parts: Mapping[str, tuple[str, np.ndarray]], names: set[str]) -> None:
  """Raises InputError unless all PARTS have bodies of the robot, each a place of its own."""
  names = names - {"", "world"}
  missing, foreign = [part for part in PARTS if part not in parts], [part for part in parts if part not in PARTS]
  absent = sorted({body for body, _ in parts.values()} - names)
  if foreign:
    raise InputError(f"{path}: the mapping names {named(foreign)}, expected the parts {', '.join(PARTS)}")
  if missing:
    raise InputError(f"{path}: the mapping lacks {named(missing)}; the robot has the bodies {named(sorted(names))}")
  if absent:
    raise InputError(f"{path}: the mapping names the bodies {named(absent)}; the robot has {named(sorted(names))}")
  points = {part: (body, *point) for part, (body, point) in parts.items() if part != "torso"}
  shared = [part for part in points if list(points.values()).count(points[part]) > 1]
  if shared:
    raise InputError(f"{path}: the mapping gives {named(shared)} one point of {parts[shared[0]][0]}; each part needs a "
                     "body or a point of its own, such as [\"body\", [0.1, 0, 0]]")


def check_names(path: pathlib.Path, about: Mapping[str, Any], joints: list[str], bodies: list[str]) -> None:
  """Raises InputError for joints or bodies of the description that the robot does not have."""
  for key, listed, known in (
      ("stand", about.get("stand", {}), joints), ("posture", about.get("posture", {}), joints),
      ("fixed", [name for names in about.get("fixed", {}).values() for name in names], joints),
      ("apart", [name for pair in about.get("apart", ()) for name in _bodies_apart(path, pair)], bodies)):
    unknown = [name for name in listed if name not in known]
    if unknown:
      raise InputError(f"{path}: {key} of the description names {named(unknown)}; the robot has {named(known)}")


def _bodies_apart(path, pair):
  lists = isinstance(pair, (list, tuple)) and len(pair) == 2 and all(isinstance(side, (list, tuple)) for side in pair)
  if not lists or not all(isinstance(name, str) for side in pair for name in side):
    raise InputError(f"{path}: apart of the description holds {str(pair)[:60]}, expected pairs of lists of bodies")
  return [*pair[0], *pair[1]]
