"""The known methods. A further one is a package with these files, and one line here or an entry point of the group
`motion_jax.methods` (docs/adding.md):

  setup.py     SETUPS {stage: function(config) -> TrainingSetup}
               Where a config takes over fields from the runs of its frozen parts, RESOLVED {stage: function(config) ->
               {field: value}}
               Where latents can be made once and kept, STORES {stage: function(config, folder) -> str}
  model.py     MODELS {stage: class}, subclasses of `models.base.TextToMotionModel` that runs of these stages become
               Where it has a tokenizer, TOKENIZERS {stage: function(fields, config) -> `RoundTrip`}, of its own
               stage and of the generators whose runs hold it (`runs.TOKENIZERS`)
  options.py   OPTIONS, its `SamplingOptions`, in a file that imports no jax: the command line reads it for --help

Stages are called "METHOD.PART", as "cmdm.denoiser": so a run's config says which folder knows it.
"""
import importlib
from typing import Any

from motion_jax.utils.plugins import Registry

METHODS: Registry[str] = Registry("motion_jax.methods", {
    "cmdm": "motion_jax.models.cmdm",
    "cdamd": "motion_jax.models.cdamd",
    "momask": "motion_jax.models.momask",
    "t2m_gpt": "motion_jax.models.t2m_gpt",
    "mdm": "motion_jax.models.mdm",
    "mld": "motion_jax.models.mld",
    "motionstreamer": "motion_jax.models.motionstreamer",
}, read=lambda entry: entry.value)

# Motion-language teachers: trained like a method, but they generate no motion.
TEACHERS = {"tmr": "motion_jax.models.tmr"}


def model_of(stage: str) -> Any:
  """The model class of runs of this stage; None for a stage that does not generate motion from text."""
  method = str(stage).partition(".")[0]
  return _of(method, "model").MODELS.get(stage) if method in METHODS else None


def model_stages(ability: str = "generate") -> list[str]:
  """The stages whose models have an ability of `abilities.ABILITIES`."""
  return [stage for method in METHODS for stage, model in _of(method, "model").MODELS.items()
          if ability in model.abilities]


def guided_stages() -> list[str]:
  """The stages whose models can be guided by constraints."""
  return [stage for stage in model_stages() if model_of(stage).takes_control]


def setups() -> dict:
  """{stage: function(config) -> TrainingSetup} of all methods."""
  return {stage: setup for method in (*METHODS, *TEACHERS) for stage, setup in _of(method, "setup").SETUPS.items()}


def resolved() -> dict:
  """{stage: function(config) -> {field: value}} of all methods: config fields that are copied from the runs of frozen
  parts."""
  return {stage: fields for method in (*METHODS, *TEACHERS)
          for stage, fields in getattr(_of(method, "setup"), "RESOLVED", {}).items()}


def stores() -> dict:
  """{stage: function(config, folder) -> a line of summary} of all methods: what `motion-jax data encode` calls."""
  return {stage: make for method in METHODS for stage, make in getattr(_of(method, "setup"), "STORES", {}).items()}


def tokenizers() -> dict:
  """{stage: function(fields, config) -> `round_trips.RoundTrip`} of all methods."""
  return {stage: make for method in METHODS for stage, make in getattr(_of(method, "model"), "TOKENIZERS", {}).items()}


def options() -> dict:
  """{method: its class of `SamplingOptions`}; imports no jax."""
  return {method: _of(method, "options").OPTIONS for method in METHODS}


def missing(stage: Any) -> str:
  """How to add the method of a stage that is called METHOD.PART, as the end of an error; "" for one that is known."""
  method, dot, _ = str(stage).partition(".")
  return "" if not dot or method in (*METHODS, *TEACHERS, "evaluator") else (
      f"; install the package that adds the method {method!r}, or import its module first (docs/adding.md)")


def _of(method, part):
  return importlib.import_module(f"{TEACHERS[method] if method in TEACHERS else METHODS[method]}.{part}")
