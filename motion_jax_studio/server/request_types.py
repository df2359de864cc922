"""The types of requests, stream messages and project files (docs/protocol.md), within the limits of a studio."""
import functools
from types import SimpleNamespace
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from motion_jax.utils.numerals import SEEDS
from motion_jax_studio import step_names
from motion_jax_studio.server import exporting
from motion_jax_studio.server.fields import Control, MotionField, Prompt, Request, Sampling, Spans, number
from motion_jax_studio.server.limits import Limits

_AHEAD = 3         # blocks that are sent before the page has acknowledged the first of them: 1.8 s
MOST_EDITS = 100   # of a project
_BASE64 = {"pattern": "^([A-Za-z0-9+/]{4})*([A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=)?$"}


def _text(longest: int = 200) -> Any:
  return Annotated[str, Meta(max_length=longest)]


def _optional(kind: Any, default: Any = None, about: str = "") -> tuple[Any, Any]:
  """(type, default) of a field that may be missing or null. about: its description."""
  kind = kind | None
  return Annotated[kind, Meta(description=about)] if about else kind, (
      msgspec.field(default_factory=lambda: type(default)(default)) if isinstance(default, list | dict) else default)


def _type(name: str, /, **fields: Any) -> type[Request]:
  """The type of a JSON object. fields: types of those that are required, and what `_optional` returns."""
  return msgspec.defstruct(name, [(field, *kind) if isinstance(kind, tuple) else (field, kind)
                                  for field, kind in fields.items()], bases=(Request,), kw_only=True)


@functools.cache
def types_of(limits: Limits) -> SimpleNamespace:
  """The types of requests by their names, of projects, and `messages` {type: type} of a stream."""
  model = _optional(_text(), about="a name of /v1/models; null: the first that can")
  seconds = _optional(number(0.2, limits.seconds), about="null: the length of similar training clips")
  seed, random_seed = (_optional(number(*SEEDS, whole=True), default, "random seed") for default in (0, None))
  sampling = _optional(Sampling, {}, "sampling choices; /v1/models lists those of each model")
  control = _optional(Control, [], "constraints, docs/control.md")
  cleanup = _optional(bool, True, "foot-skate cleanup, smoothing and exact constraints")
  yes, no = _optional(bool, True), _optional(bool, False)
  without = lambda names: _optional(list[Literal[names]], [], "steps to leave out")
  take = _optional(number(0, limits.takes, whole=True), 0)

  segments = Annotated[list[_type("Segment", prompt=Prompt, seconds=seconds)], Meta(
      min_length=1, max_length=limits.blocks, examples=[[{"prompt": "a person walks", "seconds": 4}]])]
  generate = _type(
      "Generate", prompt=Prompt, model=model, seconds=seconds, seed=seed,
      num_samples=_optional(number(1, limits.takes, whole=True), 1, "sample i uses seed + i"), cleanup=cleanup,
      plan=_optional(bool, True, "false: the prompt is passed to the model unchanged"), sampling=sampling,
      control=control, without=without(step_names.GENERATE))
  multi_prompt = _type(
      "MultiPrompt", segments=segments, model=model, seed=seed, cleanup=cleanup, sampling=sampling,
      past=_optional(MotionField, about="the motion to continue"), control=control,
      without=without(step_names.EXTEND))
  edit = _type(
      "Edit", motion=MotionField, prompt=Prompt,
      change=_optional(Spans, about="spans [first, past] in frames to regenerate; either change or keep"),
      keep=_optional(Spans, about="spans [first, past] in frames to keep"), model=model, seed=seed, sampling=sampling,
      control=_optional(Control, [], "keys in the new frames: constraints with times, docs/control.md"),
      without=without(step_names.EDIT))
  export = _type(
      "Export", motion=MotionField, format=Literal[tuple(exporting.formats())],
      name=_optional(_text(1000), about="of the file"),
      trim=_optional(Spans, about="one span [first, past] in frames"), in_place=no, loop=no, control=control,
      rig=_optional(_text(60), about="a rig of /v1/export-choices, for the formats that take one"),
      fps=_optional(number(1, 240), about="frame rate of the file; null: the motion's"),
      t_pose=_optional(bool, False, "a T-pose before the motion"), character=_optional(
          Annotated[bytes, Meta(extra_json_schema=_BASE64)],
          about="a rigged .glb or .vrm: the file is this character with the motion"))

  saved_model = _type("SavedModel", name=_text(), id=_optional(_text(), ""))
  saved_edit = _type("SavedEdit", take=take, prompt=Prompt, change=Spans, seed=seed, sampling=sampling,
                     model=saved_model, control=control)
  project = _type(
      "Project", model=saved_model, blocks=segments, seeds=_optional(Annotated[list[number(*SEEDS, whole=True)], Meta(
          min_length=1, max_length=limits.takes, examples=[[0, 1]])], [0]),
      chosen=take, sampling=sampling, cleanup=cleanup, past=_optional(MotionField), control=control,
      without=without(step_names.EDIT), edits=_optional(Annotated[list[saved_edit], Meta(
          max_length=MOST_EDITS, examples=[[{"take": 0, "prompt": "a person waves"}]])], []))

  empty = _type("Empty")
  messages = {
      "start": _type(
          "Start", model=model, prompt=Prompt, seed=random_seed, cleanup=yes,
          without=without(step_names.EXTEND), sampling=sampling,
          frames=_optional(number(4, limits.frames, whole=True)), speed=_optional(number(0, 8), 1.0), keep_going=yes,
          ahead=_optional(number(1, 32, whole=True), _AHEAD),
          pose=_optional(_text(), about="robot:g1 or rig:NAME: also send poses, 50 a second")),
      "prompt": _type("ChangePrompt", prompt=Prompt, after=_optional(number(0, 3600))),
      "control": _type("ChangeControl", at=_optional(number(0, 1e6)), control=control),
      "pause": empty, "resume": empty, "stop": empty,
      "restart": _type("Restart", prompt=_optional(Prompt), seed=random_seed),
      "speed": _type("Speed", value=number(0, 8)), "keep_going": _type("KeepGoing", on=yes),
      "ack": _type("Acknowledge", sequence=number(0, 2**32 - 1, whole=True))}
  return SimpleNamespace(generate=generate, multi_prompt=multi_prompt, edit=edit, export=export, project=project,
                         messages=messages)
