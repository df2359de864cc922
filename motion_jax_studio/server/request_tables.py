"""The fields of all requests, of stream messages and of project files (docs/protocol.md)."""
from motion_jax_studio import step_names
from motion_jax_studio.server import export_choices
from motion_jax_studio.server.fields import (
  Bytes,
  Choice,
  Control,
  Listed,
  MotionField,
  Number,
  Prompt,
  Record,
  Sampling,
  Spans,
  Steps,
  Switch,
  Text,
  seed,
)

DEFAULT_AHEAD = 3  # blocks that are sent before the page has acknowledged the first of them: 1.8 s
MOST_EDITS = 100   # of a project

_MODEL = Text(default=None, about="a name of /v1/models; null: the first that can")
_SECONDS = Number(0.2, "seconds", default=None, about="null: the length of similar training clips")
_SAMPLING = Sampling(default={}, about="sampling choices; /v1/models lists those of each model")
_CONTROL = Control(default=(), about="constraints, docs/control.md")
_CLEANUP = Switch(default=True, about="foot-skate cleanup, smoothing and exact constraints")


def _without(names):
  return Steps(names, default=(), about="steps to leave out")


SEGMENT = {"prompt": Prompt(), "seconds": _SECONDS}
_SEGMENTS = Listed(Record(SEGMENT), "blocks", '[{"prompt": "a person walks", "seconds": 4}]')

GENERATE = {
    "prompt": Prompt(), "model": _MODEL, "seconds": _SECONDS, "seed": seed(),
    "num_samples": Number(1, "takes", whole=True, default=1, about="sample i uses seed + i"),
    "cleanup": _CLEANUP, "plan": Switch(default=True, about="false: the prompt is passed to the model unchanged"),
    "sampling": _SAMPLING, "control": _CONTROL, "without": _without(step_names.GENERATE)}
MULTI_PROMPT = {
    "segments": _SEGMENTS, "model": _MODEL, "seed": seed(), "cleanup": _CLEANUP, "sampling": _SAMPLING,
    "past": MotionField(default=None, about="the motion to continue"), "control": _CONTROL,
    "without": _without(step_names.EXTEND)}
EDIT = {
    "motion": MotionField(), "prompt": Prompt(),
    "change": Spans(default=None, about="spans [first, past] in frames to regenerate; either change or keep"),
    "keep": Spans(default=None, about="spans [first, past] in frames to keep"),
    "model": _MODEL, "seed": seed(), "sampling": _SAMPLING, "without": _without(step_names.EDIT)}
EXPORT = {
    "motion": MotionField(), "format": Choice(tuple(export_choices.formats())),
    "name": Text(1000, default=None, about="of the file"),
    "trim": Spans(default=None, about="one span [first, past] in frames"), "in_place": Switch(default=False),
    "loop": Switch(default=False), "control": _CONTROL,
    "rig": Text(60, default=None, about="a rig of /v1/export-choices, for the formats that take one"),
    "fps": Number(1, 240, default=None, about="frame rate of the file; null: the motion's"),
    "t_pose": Switch(default=False, about="a T-pose before the motion"),
    "character": Bytes(default=None, about="a rigged .glb or .vrm: the file is this character with the motion")}

_PROJECT_MODEL = Record({"name": Text(), "id": Text(default="")})
PROJECT = {
    "model": _PROJECT_MODEL, "blocks": _SEGMENTS, "seeds": Listed(seed(), "takes", "[0, 1]", default=(0,)),
    "chosen": Number(0, "takes", whole=True, default=0), "sampling": _SAMPLING, "cleanup": _CLEANUP,
    "past": MotionField(default=None), "control": _CONTROL, "without": _without(step_names.EDIT),
    "edits": Listed(Record({
        "take": Number(0, "takes", whole=True, default=0), "prompt": Prompt(), "change": Spans(), "seed": seed(),
        "sampling": _SAMPLING, "model": _PROJECT_MODEL}), MOST_EDITS, "[{\"take\": 0, ...}]", shortest=0, default=())}

MESSAGES = {  # of a stream, by type
    "start": {
        "model": _MODEL, "prompt": Prompt(), "seed": seed(None), "cleanup": Switch(default=True),
        "without": _without(step_names.EXTEND), "sampling": _SAMPLING,
        "frames": Number(4, "frames", whole=True, default=None),
        "speed": Number(0, 8, default=1.0), "keep_going": Switch(default=True),
        "ahead": Number(1, 32, whole=True, default=DEFAULT_AHEAD),
        "pose": Text(default=None, about="robot:g1 or rig:NAME: poses, 50 a second, beside the joints")},
    "prompt": {"prompt": Prompt(), "after": Number(0, 3600, default=None)},
    "control": {"at": Number(0, 1e6, default=None), "control": _CONTROL},
    "pause": {}, "resume": {}, "stop": {},
    "restart": {"prompt": Prompt(default=None), "seed": seed(None)},
    "speed": {"value": Number(0, 8)},
    "keep_going": {"on": Switch(default=True)},
    "ack": {"sequence": Number(0, 2**32 - 1, whole=True)}}
