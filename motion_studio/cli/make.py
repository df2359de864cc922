"""motion-jax generate, multi-prompt, extend and edit: the commands that generate motion."""
import functools
import json
import pathlib
import time

import motion_jax
from motion_jax.models import registry
from motion_jax.utils import progress, timing
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import MOTIONS, SEEDS, real, whole
from motion_studio.checks import MAX_ATTEMPTS
from motion_studio.cli import control, shared
from motion_studio.cli.prompts import read_prompts, read_sequences

_PRINTED = 20           # prompts of which a command prints the plan
_BATCH_FRAMES = 16_000  # frames of all motions in one batch, and
_MOST_FRAMES = 400_000  # of all motions of one run
_SECONDS = real(above=0, high=3600, unit="seconds")
_PARTS = "legs, torso, left_arm, right_arm, head, with commas"
# Methods whose models cannot run a command.
WITHOUT = {"multi-prompt": ("cdamd",), "extend": ("cdamd",), "edit": ("cmdm",)}


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  generate = commands.add_parser("generate", help="generate motion from a text prompt")
  generate.add_argument("prompt", help="a sentence, or a file of prompts: .txt with one prompt per line (MoMask's "
                        "text#80 sets a length in frames at 20 fps), or .csv with the columns prompt,length in frames")
  length = generate.add_mutually_exclusive_group()
  length.add_argument("--seconds", type=_SECONDS, help="length in seconds (default: that of similar training clips)")
  length.add_argument("--num-frames", type=whole(1, 72_000), help="length in frames")
  _add_planning(generate)
  _add_attempts(generate, "a motion", "its prompt, such as the number of jumps")
  control.add_to(generate)
  _add_common(generate, "generate", "motion.html")
  generate.set_defaults(run=_generate)

  several = commands.add_parser("multi-prompt", help="generate one motion from several prompts in sequence")
  several.add_argument("prompts", help="prompts separated by |, each with an optional length in seconds: "
                       "\"a person walks:4 | a person waves\"; or a file: .csv (prompt,length in frames), .txt (one "
                       "prompt per line) or a .txt of timelines (caption # start # end # body parts)")
  several.add_argument("--way", choices=("stream", "chain", "joined"), default="stream",
                       help="stream (default): the prompt changes within one sampling run; chain: one run per prompt, "
                            "as in the released code; joined: prompts are sampled independently and joined where "
                            "poses match")
  several.add_argument("--rest", action="store_true", help="fill the remaining time of a short action, such as a bow, "
                       "with standing still; default: the action continues or repeats")
  several.add_argument("--hold-until-done", action="store_true", help="give single actions, such as a kick, at least "
                       "the length of training clips of them")
  _add_planning(several)
  several.add_argument("--ease", action="store_true", help="spread sudden speed changes between prompts over 0.4 s")
  _add_common(several, "multi-prompt", "multi_prompt.html")
  several.set_defaults(run=_multi_prompt)

  extend = commands.add_parser("extend", help="continue a motion file from a prompt")
  extend.add_argument("file", help="motion to continue: .npz, .npy, .bvh or .amc")
  extend.add_argument("--prompt", required=True, help="what happens next; several prompts as for multi-prompt")
  extend.add_argument("--seconds", type=_SECONDS, help="length of the new part in seconds, for a single prompt")
  extend.add_argument("--past-prompt", help="what the file shows (default: its caption, else the new prompt)")
  extend.add_argument("--way", choices=("stream", "chain"), default="stream",
                      help="stream (default): the past stays clean in the cache; chain: one past latent is noised "
                           "again in each step, as in the released code")
  _add_planning(extend)
  shared.add_reading(extend)
  _add_common(extend, "extend", "extended.html")
  extend.set_defaults(run=_extend)

  edit = commands.add_parser("edit", help="regenerate selected frames or body parts of a motion file")
  edit.add_argument("file", help="motion to edit: .npz, .npy, .bvh or .amc")
  edit.add_argument("--prompt", required=True, help="what the person does in the new frames")
  part = edit.add_mutually_exclusive_group()
  part.add_argument("--task", choices=("inpainting", "outpainting", "prefix", "suffix"),
                    help="what is kept: the first and last quarter, the middle half, the first half, the second half")
  part.add_argument("--change", action="append", metavar="A:B",
                    help="regenerate this span and keep the rest: seconds (1.5s:3s), shares (25%%:0.5) or frames "
                         "(30:60); repeatable")
  part.add_argument("--keep", action="append", metavar="A:B", help="keep this span and regenerate the rest; repeatable")
  edit.add_argument("--keep-parts", metavar="PARTS", help=f"keep these body parts ({_PARTS}) and regenerate the "
                    "others, within --change or everywhere; works with any model")
  edit.add_argument("--no-paste", action="store_true", help="return kept frames as the autoencoder decodes them, "
                    "not as they are in the file")
  _add_attempts(edit, "new frames", "the prompt")
  shared.add_reading(edit)
  _add_common(edit, "edit", "edited.html")
  edit.set_defaults(run=_edit, model="cdamd-small")


def _add_planning(parser):
  parser.add_argument("--no-plan", action="store_true", help="pass each prompt to the model unchanged; default: "
                      "prompts with several actions, such as \"walks, then waves\", are planned action by action")


def _add_attempts(parser, what, checks):
  parser.add_argument("--max-attempts", type=whole(1, 100), default=MAX_ATTEMPTS, help=f"how many times to "
                      f"sample {what} at most, until the checks of {checks} pass ({MAX_ATTEMPTS})")


def _add_common(parser, command, out):
  """Flags of all commands that generate motion."""
  parser.add_argument("--num-samples", type=whole(*MOTIONS), default=1,
                      help="number of samples per prompt; sample i uses seed SEED + i (1)")
  parser.add_argument("--seed", type=whole(*SEEDS), default=0,
                      help="random seed; the same seed gives the same motion (0)")
  for name, methods in _choices(command).items():
    known = next(iter(methods.values()))
    texts = list(dict.fromkeys(one.help for one in methods.values()))
    text = texts[0] if len(texts) == 1 else "; ".join(f"{method.upper()}: {one.help}"
                                                     for method, one in methods.items())
    only_one = len(methods) == 1 < len(_methods(command))
    group = _group(parser, next(iter(methods))) if only_one else parser
    group.add_argument(f"--{name.replace('_', '-')}", type=None if known.read is str else known.read,
                       choices=known.choices, help=text + _defaults(name, methods))
  parser.add_argument("--no-cleanup", action="store_true",
                      help="return the network's output: no foot-skate cleanup, smoothing or exact constraints")
  parser.add_argument("--model", default="cmdm-small",
                      help="a run folder or a shipped model; see motion-jax models (%(default)s)")
  shared.add_out(parser, out, "wave.mp4,wave.bvh")
  shared.add_rig(parser)
  shared.add_film(parser, "in films and pictures")
  parser.add_argument("--timings", action="store_true", help="print where the time went")


def _defaults(name, methods):
  """The values of a sampling choice in the shipped models of these methods, for its help text."""
  found = {}
  for model, method, sampler in _samplers():
    if method in methods:
      value = sampler.get(methods[method].key or name, methods[method].usual)
      if value is not None:
        found.setdefault(f"{value:g}" if isinstance(value, float) else str(value).lower(), []).append(model)
  values = "; ".join(value if len(found) == 1 else f"{value} for {', '.join(names)}" for value, names in found.items())
  return f" (shipped models: {values})" if values else ""


@functools.cache
def _samplers():
  """[(name, method, config.sampler)] of the shipped models; only their configs are read."""
  found = []
  for path in sorted((pathlib.Path(motion_jax.__file__).parent / "pretrained").glob("*/config.json")):
    config = json.loads(path.read_text(encoding="utf-8"))
    if "sampler" in config:
      found.append((path.parent.name, config["stage"].partition(".")[0], config["sampler"]))
  return found


def _methods(command):
  """The methods with models that can run a command."""
  return [method for method in registry.METHODS if method not in WITHOUT.get(command, ())]


def _choices(command):
  """{name: {method: Description}} of the sampling choices that a command accepts."""
  found, options = {}, registry.options()
  for method in _methods(command):
    for name, known in options[method].described().items():
      found.setdefault(name, {})[method] = known
  return found


def _group(parser, method):
  title = f"{method.upper()} models"
  return next((group for group in parser._action_groups if group.title == title), None) or (
      parser.add_argument_group(title))


def _generate(args):
  outputs, rows = shared.outputs_of(args), read_prompts(args.prompt)
  _check_count(len(rows), args)
  start, pipeline = time.time(), _load_pipeline(args)
  model = pipeline.model
  rows = read_prompts(args.prompt, model.fps)
  prompts = [prompt for prompt, _ in rows for _ in range(args.num_samples)]
  seeds = [args.seed + i for _ in rows for i in range(args.num_samples)]
  given = [frames for _, frames in rows for _ in range(args.num_samples)]
  if args.seconds is not None or args.num_frames is not None:
    given = [args.num_frames if args.num_frames is not None else args.seconds * model.fps] * len(prompts)
  wanted = control.constraints_of(args, model)
  with timing.part("text"), progress.part("reading the prompts"):
    texts = {prompt: prompt if args.no_plan else pipeline.plan(prompt) for prompt in dict.fromkeys(prompts)}
    pipeline.warn(texts.values(), plan=False)
    schedules = {key: pipeline.schedule(texts[key[0]], key[1], wanted) for key in dict.fromkeys(zip(prompts, given))}
    frames = [sum(schedules[key][1]) for key in zip(prompts, given)]
  for plan, _ in list(schedules.values())[:_PRINTED]:
    if plan is not None and not plan.is_plain:  # the length of each segment is printed once it is sampled
      print(f"understood as: {' | '.join(segment.words for segment in plan.segments)}")
  shortest, longest = (f"{count / model.fps:.1f}" for count in (min(frames), max(frames)))
  _tell_model(model, args, f"{len(prompts)} motion{'s' * (len(prompts) > 1)} of "
                           f"{shortest if shortest == longest else f'{shortest} to {longest}'} s")
  motions = []
  for piece in progress.each(_pieces(frames, model), "making motions", unit="batch"):
    motions += pipeline([texts[prompt] for prompt in prompts[piece]], frames[piece], seeds=seeds[piece],
                        cleanup=not args.no_cleanup, max_attempts=args.max_attempts, control=wanted or None,
                        exact=not args.no_cleanup, plan=not args.no_plan, **_sampling(args, model))
  made_as = [motion.meta["understood"] for motion in motions if "understood" in motion.meta]
  for said in list(dict.fromkeys(made_as))[:_PRINTED]:
    print(f"made as: {said}")
  _write(args, model, motions, outputs, start, asked=control.drawn(wanted, motions) if wanted else None,
         constraints=wanted)


def _multi_prompt(args):
  outputs = shared.outputs_of(args)
  start, pipeline = time.time(), _load_pipeline(args)
  model = pipeline.model
  _able(model, "multi_prompt")
  sequences = read_sequences(args.prompts, model.fps)
  _check_count(len(sequences), args)
  _tell_model(model, args, f"{len(sequences) * args.num_samples} motion(s) of {len(sequences[0])} prompt(s) each")
  sequences = [one for one in sequences for _ in range(args.num_samples)]
  seeds = [args.seed + i for _ in range(len(sequences) // args.num_samples) for i in range(args.num_samples)]
  motions = []
  for piece in progress.each(_pieces([_length(pipeline, one) for one in sequences], model), "making motions",
                             unit="batch"):
    motions += pipeline.multi_prompts(sequences[piece], way=args.way, cleanup=not args.no_cleanup, seeds=seeds[piece],
                                      rest=args.rest, hold_until_done=args.hold_until_done, ease=args.ease,
                                      plan=not args.no_plan, **_sampling(args, model))
  for caption in motions[0].captions if len(sequences) == args.num_samples else ():
    print(f"{caption.start:6.1f} to {caption.end:5.1f} s  {caption.text}")
  _write(args, model, motions, outputs, start)


def _extend(args):
  outputs, clip = shared.outputs_of(args), shared.read_motion(args.file, args)
  start, pipeline = time.time(), _load_pipeline(args)
  model = pipeline.model
  _able(model, "extend")
  segments = read_sequences(args.prompt, model.fps)[0]
  if args.seconds is not None:
    if len(segments) > 1:
      raise InputError("got --seconds for several sentences; write them behind colons, as in \"walks:4 | sits:3\"")
    segments = [(segments[0][0], args.seconds)]
  _pieces([clip.seconds * model.fps + _length(pipeline, segments)] * args.num_samples, model)
  _tell_model(model, args, f"{clip.seconds:.1f} s of {args.file} go on")
  motions = [pipeline.extend(clip, segments, past_prompt=args.past_prompt, seed=args.seed + i, way=args.way,
                             cleanup=not args.no_cleanup, plan=not args.no_plan, **_sampling(args, model))
             for i in progress.each(range(args.num_samples), "making motions", unit="motion")]
  _write(args, model, motions, outputs, start)


def _edit(args):
  from motion_jax.models.results import colors_of
  from motion_jax.utils.spans import spans_of
  outputs, clip = shared.outputs_of(args), shared.read_motion(args.file, args)
  if not (args.task or args.change or args.keep or args.keep_parts):
    raise InputError("got nothing to replace; give --task, --change, --keep or --keep-parts")
  start, pipeline = time.time(), _load_pipeline(args)
  model = pipeline.model
  if args.keep_parts:
    _write(args, model, control.regenerate_parts(args, clip, pipeline, _sampling(args, model)), outputs, start)
    return
  _able(model, "edit")
  _tell_model(model, args, f"{clip.seconds:.1f} s of {args.file} edited")
  frames = round(clip.seconds * model.fps)
  _pieces([frames] * args.num_samples, model)
  keep, change = (spans and spans_of(spans, frames, model.fps) for spans in (args.keep, args.change))
  edit = model.edit if args.no_paste else functools.partial(pipeline.edit, max_attempts=args.max_attempts)
  motions = [edit(clip, args.prompt, args.task, keep=keep, change=change, seed=args.seed + i,
                  cleanup=not args.no_cleanup, **_sampling(args, model))
             for i in progress.each(range(args.num_samples), "making motions", unit="motion")]
  for first, past in motions[0].meta["made"]:
    print(f"new frames: {first / model.fps:.1f} to {past / model.fps:.1f} s")
  _write(args, model, motions, outputs, start, colors=colors_of(motions[0]))


def _check_count(rows, args):
  """Raises ValueError for more motions than one command makes, before lists of them are written."""
  if rows * args.num_samples > MOTIONS[1]:
    raise InputError(f"got {rows:,} prompts with --num-samples {args.num_samples:,}, {rows * args.num_samples:,} "
                     f"motions; expected at most {MOTIONS[1]:,} in one run")


def _pieces(frames, model):
  """Slices of motions of so many frames each that are made at once: memory does not grow with their number.

  Raises ValueError where all together are more than one run holds.
  """
  total = float(sum(frames))
  if not total <= _MOST_FRAMES:
    raise InputError(f"got {len(frames):,} motion(s) of {total / model.fps / 3600:.3g} hours together, expected at "
                     f"most {_MOST_FRAMES / model.fps / 3600:.1f} in one run; make fewer, then more by --seed")
  size = max(1, int(_BATCH_FRAMES // max(frames)))
  return [slice(first, first + size) for first in range(0, len(frames), size)]


def _length(pipeline, segments):
  """Frames of segments [(prompt, seconds or None)], about."""
  planner = pipeline.planner
  return sum(planner.natural_frames(prompt) if seconds is None else seconds * planner.fps
             for prompt, seconds in segments)


def _sampling(args, model):
  """The sampling choices on the command line; refuses those that the model's method does not have."""
  given = {name: getattr(args, name) for name in _choices(args.command) if getattr(args, name) is not None}
  unknown = [f"--{name.replace('_', '-')}" for name in given if name not in model.options.described()]
  if unknown:
    raise InputError(f"got {', '.join(unknown)} for the model {model.id}, which has no such choice")
  return given


def _load_pipeline(args):
  """The steps of the application for the model that a command names; a command warns of prompts by itself."""
  if args.timings:
    timing.start()
  with timing.part("imports"), progress.part("starting JAX"):
    shared.cache_compiled_code()
    from motion_jax import loading
    from motion_studio import pipeline
    from motion_studio.steps import Warn
  with timing.part("model"), progress.part(f"reading the model {args.model}"):
    model = loading.load(args.model)
  shared.import_ahead("scipy.ndimage", "scipy.linalg")  # for cleanup and files: while the program is being read
  return pipeline.Pipeline(model, [step for step in pipeline.STEPS if not isinstance(step, Warn)])


def _tell_model(model, args, what):
  import jax
  print(f"{model.id}: {model.num_params / 1e6:.1f} M parameters on {jax.default_backend()}; {what}, guidance "
        f"{model.sampling(**_sampling(args, model)).guidance_scale:g}, seed {args.seed}")


def _able(model, name):
  """Raises ValueError unless this kind of model can do it."""
  if not model.can(name):
    from motion_jax.models.base import cannot
    raise InputError(cannot(model.id, name))


def _write(args, model, motions, outputs, start, colors=None, asked=None, constraints=()):
  """colors (T, 3) of the bodies, and what each motion was asked to do, as a signal and as constraints, where a file is
  a picture."""
  print(f"made in {time.time() - start:.1f} s")
  clips = [motion.replace(id=f"{pathlib.Path(outputs[0]).stem}_{i}") for i, motion in enumerate(motions)]
  with timing.part("files"), progress.part("writing files"):
    written = [path for out in outputs for path in _write_one(args, clips, out, colors, asked, constraints)]
  shared.print_rig_error(args, clips, outputs)
  shared.print_files(written)
  for said in (model.limits, model.license):
    if said:
      print(said)
  if args.timings:
    print(timing.report())


def _write_one(args, clips, out, colors, asked, constraints):
  from motion_jax import export
  options = shared.file_options(args, out)
  if pathlib.Path(out).suffix.lower() in shared.PICTURES:
    if colors is not None:
      options["colors"] = colors[shared.span_of(args, clips[0])]
    if asked is not None:
      spans = [shared.span_of(args, clip) for clip in clips]
      shown = [signal.slice_frames(span.start, span.stop) for signal, span in zip(asked, spans)]
      options |= control.drawn_options(out, shown, constraints)
    clips = [shared.trimmed(args, clip) for clip in clips]
  return export.save(clips, out, **options)
