"""Flags of the commands that generate motion; sampling choices of all methods come from their `SamplingOptions`."""
import functools
import json
import pathlib

import motion_jax
from motion_jax.models import registry
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import MOTIONS, SEEDS, whole
from motion_jax_studio.checks import MAX_ATTEMPTS
from motion_jax_studio.cli.parser import HelpAll, typed
from motion_jax_studio.cli.writing import add_film, add_out, add_rig
from motion_jax_studio.step_names import left_out

_SHOWN = ("without", "explain", "num_samples", "seed", "model", "out")  # flags that --help of all commands shows
_MODEL = "cmdm-small"
_PRETRAINED = pathlib.Path(motion_jax.__file__).parent / "pretrained"
# Methods whose models cannot run a command.
_WHOLE = ("cdamd", "mld", "momask", "t2m_gpt")
WITHOUT = {"multi-prompt": _WHOLE, "extend": _WHOLE, "edit": ("cmdm", "mld", "motionstreamer", "t2m_gpt")}


def add_planning(parser):
  parser.add_argument("--no-plan", action="store_true", help="pass each prompt to the model unchanged; default: "
                      "prompts with several actions, such as \"walks, then waves\", are planned action by action")


def add_steps(parser, names):
  """Add --without and --explain, for the steps before and after sampling."""
  parser.add_argument("--without", metavar="STEPS", type=typed(functools.partial(left_out, names=names)),
                      default=frozenset(), help=f"steps to leave out, separated by commas: {', '.join(names)}")
  parser.add_argument("--explain", action="store_true", help="print what each step did, in which frames and by how "
                      "much")


def add_attempts(parser):
  parser.add_argument("--max-attempts", type=whole(1, 100), default=MAX_ATTEMPTS, metavar="N",
                      help="maximum samples per motion: resample until the prompt checks, such as the number of jumps, "
                      f"pass; the best-scoring sample is kept ({MAX_ATTEMPTS})")


def add_common(parser, command, out, shown):
  """Add the flags of all commands that generate motion. shown: further flags that --help shows for this command."""
  parser.shown = functools.partial(_shown, parser, command, (*shown, *_SHOWN))
  parser.add_argument("--help-all", action=HelpAll, nargs=0,
                      help="show all flags, also those for other models, constraints, characters, files and films")
  parser.add_argument("--num-samples", type=whole(*MOTIONS), default=1,
                      help="number of samples per prompt; sample i uses seed SEED + i (1)")
  parser.add_argument("--seed", type=whole(*SEEDS), default=0,
                      help="random seed; the same seed gives the same motion (0)")
  for name, methods in _choices(command).items():
    known = next(iter(methods.values()))
    texts = list(dict.fromkeys(description.help for description in methods.values()))
    text = texts[0] if len(texts) == 1 else "; ".join(f"{_title(method)}: {description.help}"
                                                     for method, description in methods.items())
    only_one = len(methods) == 1 < len(_methods(command))
    group = _group(parser, next(iter(methods))) if only_one else parser
    group.add_argument(f"--{name.replace('_', '-')}", type=None if known.read is str else known.read,
                       choices=known.choices, help=text + _defaults(name, methods))
  parser.add_argument("--no-cleanup", action="store_true",
                      help="return the network's output: no foot-skate cleanup, smoothing or exact constraints")
  parser.add_argument("--model", default=_MODEL,
                      help="a run folder or a shipped model; see motion-jax models (%(default)s)")
  add_out(parser, out, "wave.mp4,wave.bvh")
  add_rig(parser)
  add_film(parser, "in films and pictures")
  parser.add_argument("--timings", action="store_true", help="print where the time went")


def _shown(parser, command, names, arguments):
  """{dest: help text} of the flags `names` and of the sampling choices of the model on the command line."""
  model = next((value for flag, value in _values(arguments) if flag == "--model"), parser.get_default("model"))
  method = _method_of(model)
  texts = {action.dest: action.help for action in parser._actions if action.dest in names}
  for name, methods in _choices(command).items():
    if method in methods:
      texts[name] = methods[method].help + _defaults(name, {method: methods[method]}, model)
  return texts


def _values(arguments):
  """Yields (flag, value) of --flag VALUE and --flag=VALUE."""
  for argument, then in zip(arguments, [*arguments[1:], ""]):
    flag, equals, value = argument.partition("=")
    yield flag, value if equals else then


def _method_of(model):
  """The method of a shipped model or of a run folder; "" where there is none."""
  for folder in (pathlib.Path(model), _PRETRAINED / model):
    try:
      return json.loads((folder / "config.json").read_text(encoding="utf-8"))["stage"].partition(".")[0]
    except (OSError, ValueError, KeyError, AttributeError, TypeError):
      continue
  return ""


def _defaults(name, methods, only=None):
  """Help text with the values of a sampling choice in the shipped models of these methods, or only in one model."""
  models = {}
  for model, method, sampler in _samplers():
    if method in methods and only in (None, model):
      value = sampler.get(methods[method].key or name, methods[method].usual)
      if value is not None:
        models.setdefault(f"{value:g}" if isinstance(value, float) else str(value).lower(), []).append(model)
  values = "; ".join(value if len(models) == 1 else f"{value} for {', '.join(names)}"
                     for value, names in models.items())
  return f" ({'shipped models: ' * (only is None)}{values})" if values else ""


@functools.cache
def _samplers():
  """[(name, method, config.sampler)] of the shipped models; only their configs are read."""
  samplers = []
  for path in sorted(_PRETRAINED.glob("*/config.json")):
    config = json.loads(path.read_text(encoding="utf-8"))
    if "sampler" in config:
      samplers.append((path.parent.name, config["stage"].partition(".")[0], config["sampler"]))
  return samplers


def _methods(command):
  """The methods with models that can run a command."""
  return [method for method in registry.METHODS if method not in WITHOUT.get(command, ())]


def _choices(command):
  """{name: {method: Description}} of the sampling choices that a command accepts."""
  choices, options = {}, registry.options()
  for method in _methods(command):
    for name, known in options[method].described().items():
      choices.setdefault(name, {})[method] = known
  return choices


def _title(method):
  """A method as its paper writes it."""
  written = {"momask": "MoMask", "motionstreamer": "MotionStreamer", "t2m_gpt": "T2M-GPT"}
  return written.get(method, method.upper())


def _group(parser, method):
  title = f"{_title(method)} models"
  return next((group for group in parser._action_groups if group.title == title), None) or (
      parser.add_argument_group(title))


def choices_of(args, model):
  """(steps that --without, --no-plan and --no-cleanup leave out, sampling choices) of the command line.

  Raises InputError for sampling choices that the model's method does not have.
  """
  without = args.without | {name for name in ("plan", "cleanup") if getattr(args, f"no_{name}", False)}
  given = {name: getattr(args, name) for name in _choices(args.command) if getattr(args, name) is not None}
  unknown = [f"--{name.replace('_', '-')}" for name in given if name not in model.options.described()]
  if unknown:
    raise InputError(f"got {', '.join(unknown)} for the model {model.id}, which has no such choice")
  return without, given
