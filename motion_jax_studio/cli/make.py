"""motion-jax generate, multi-prompt, extend and edit: the commands that generate motion."""
import functools
import math
import pathlib
import time

from motion_jax.utils import progress, timing
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import MOTIONS, real, whole
from motion_jax_studio import step_names
from motion_jax_studio.cli import control, shared
from motion_jax_studio.cli import generation_flags as flags
from motion_jax_studio.cli.prompts import read_prompts, read_sequences

_PRINTED = 20           # prompts of which a command prints the plan
BATCH_FRAMES = 16_000  # frames of all motions in one batch, and
_MOST_FRAMES = 400_000  # of all motions of one run
_SECONDS = real(above=0, high=3600, unit="seconds")
_PARTS = "legs, torso, left_arm, right_arm, head, with commas"


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  generate = commands.add_parser("generate", help="generate motion from a text prompt")
  generate.add_argument("prompt", help="a sentence, or a file of prompts: .txt with one prompt per line (MoMask's "
                        "text#80 sets a length in frames at 20 fps), or .csv with the columns prompt,length in frames")
  length = generate.add_mutually_exclusive_group()
  length.add_argument("--seconds", type=_SECONDS, help="length in seconds (default: that of similar training clips)")
  length.add_argument("--num-frames", type=whole(1, 72_000), help="length in frames")
  flags.add_planning(generate)
  flags.add_attempts(generate, "a motion", "its prompt, such as the number of jumps")
  flags.add_steps(generate, step_names.GENERATE)
  control.add_to(generate)
  flags.add_common(generate, "generate", "motion.html")
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
  flags.add_planning(several)
  flags.add_steps(several, step_names.MULTI_PROMPT)
  several.add_argument("--ease", action="store_true", help="spread sudden speed changes between prompts over 0.4 s")
  flags.add_common(several, "multi-prompt", "multi_prompt.html")
  several.set_defaults(run=_multi_prompt)

  extend = commands.add_parser("extend", help="continue a motion file from a prompt")
  extend.add_argument("file", help=f"motion to continue: {shared.MOTION_HELP}")
  extend.add_argument("--prompt", required=True, help="what happens next; several prompts as for multi-prompt")
  extend.add_argument("--seconds", type=_SECONDS, help="length of the new part in seconds, for a single prompt")
  extend.add_argument("--past-prompt", help="what the file shows (default: its caption, else the new prompt)")
  extend.add_argument("--way", choices=("stream", "chain"),
                      help="stream (default): the past stays clean in the cache; chain: one past latent is noised "
                           "again in each step, as in the released code")
  flags.add_planning(extend)
  flags.add_steps(extend, step_names.EXTEND)
  shared.add_reading(extend)
  flags.add_common(extend, "extend", "extended.html")
  extend.set_defaults(run=_extend)

  edit = commands.add_parser("edit", help="regenerate selected frames or body parts of a motion file")
  edit.add_argument("file", help=f"motion to edit: {shared.MOTION_HELP}")
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
  flags.add_attempts(edit, "new frames", "the prompt")
  flags.add_steps(edit, step_names.EDIT)
  shared.add_reading(edit)
  flags.add_common(edit, "edit", "edited.html")
  edit.set_defaults(run=_edit, model="cdamd-small")


def _generate(args):
  outputs, rows = shared.outputs_of(args), read_prompts(args.prompt)
  _check_count(len(rows), args)
  start, pipeline = time.time(), _load_pipeline(args)
  model = pipeline.model
  rows = [row for row in read_prompts(args.prompt, model.fps) for _ in range(args.num_samples)]
  seeds = [args.seed + i % args.num_samples for i in range(len(rows))]
  if args.seconds is not None or args.num_frames is not None:
    length = args.num_frames if args.num_frames is not None else args.seconds * model.fps
    rows = [(prompt, length) for prompt, _ in rows]
  constraints, without = control.constraints_of(args, model), flags.without_of(args)
  plain = "plan" in without
  with timing.part("text"), progress.part("reading the prompts"):
    plans = {prompt: prompt if plain else pipeline.plan(prompt, postures=not constraints)
             for prompt, _ in dict.fromkeys(rows)}
    if "warn" not in without:
      pipeline.warn(plans.values(), plan=False, postures=not constraints)
    schedules = {row: pipeline.schedule(plans[row[0]], row[1], constraints) for row in dict.fromkeys(rows)}
    frames = [sum(schedules[row][1]) for row in rows]
  for plan, _ in list(schedules.values())[:_PRINTED]:
    if plan is not None and not plan.is_plain:  # the length of each segment is printed once it is sampled
      print(f"understood as: {' | '.join(segment.words for segment in plan.segments)}")
  shortest, longest = (f"{count / model.fps:.1f}" for count in (min(frames), max(frames)))
  _print_model(model, args, f"{_counted(len(rows), 'motion')} of "
                            f"{shortest if shortest == longest else f'{shortest} to {longest}'} s")
  motions = []
  for batch in progress.each(_batches(frames, model), "generating motions", unit="batch"):
    motions += pipeline([plans[prompt] for prompt, _ in rows[batch]], frames[batch], seeds=seeds[batch],
                        without=without, max_attempts=args.max_attempts, control=constraints or None,
                        exact=not args.no_cleanup, **flags.sampling_of(args, model))
  segments = dict.fromkeys(motion.meta["understood"] for motion in motions if "understood" in motion.meta)
  for text in list(segments)[:_PRINTED]:
    print(f"generated as: {text}")
  for motion in motions[:_PRINTED]:
    if "velocity" in motion.meta:
      left, _, ahead = (round(part, 2) + 0.0 for part in motion.meta["velocity"])
      print(f"in place: move the character at {math.hypot(left, ahead):.2f} m/s ({ahead:.2f} ahead, {left:.2f} to its "
            "left)")
  signals = control.drawn(constraints, motions) if constraints else None
  _write(args, model, motions, outputs, start, signals=signals, constraints=constraints)


def _multi_prompt(args):
  outputs = shared.outputs_of(args)
  start, pipeline = time.time(), _load_pipeline(args, "multi_prompt")
  model = pipeline.model
  lists = read_sequences(args.prompts, model.fps)
  _check_count(len(lists), args)
  count = len(lists) * args.num_samples
  _print_model(model, args, f"{_counted(count, 'motion')} of {_counted(len(lists[0]), 'prompt')}")
  lists = [one for one in lists for _ in range(args.num_samples)]
  seeds = [args.seed + i % args.num_samples for i in range(len(lists))]
  motions = []
  for batch in progress.each(_batches([_length(pipeline, one) for one in lists], model), "generating motions",
                             unit="batch"):
    motions += pipeline.multi_prompts(lists[batch], way=args.way, without=flags.without_of(args), seeds=seeds[batch],
                                      rest=args.rest, hold_until_done=args.hold_until_done, ease=args.ease,
                                      **flags.sampling_of(args, model))
  for caption in motions[0].captions if len(lists) == args.num_samples else ():
    print(f"{caption.start:6.1f} to {caption.end:5.1f} s  {caption.text}")
  _write(args, model, motions, outputs, start)


def _extend(args):
  outputs, clip = shared.outputs_of(args), shared.read_motion(args.file, args)
  start, pipeline = time.time(), _load_pipeline(args, "extend")
  model = pipeline.model
  segments = read_sequences(args.prompt, model.fps)[0]
  if args.seconds is not None:
    if len(segments) > 1:
      raise InputError("got --seconds for several prompts; write lengths after colons, as in \"walks:4 | sits:3\"")
    segments = [(segments[0][0], args.seconds)]
  _batches([clip.seconds * model.fps + _length(pipeline, segments)] * args.num_samples, model)  # checks the length
  _print_model(model, args, f"{clip.seconds:.1f} s of {args.file} to continue")
  more = {name: value for name in ("past_prompt", "way") if (value := getattr(args, name)) is not None}
  if more and not model.ways:
    raise InputError(f"got --{min(more).replace('_', '-')} for the model {model.id}, which has no such choice")
  more |= flags.sampling_of(args, model)
  motions = [pipeline.extend(clip, segments, seed=args.seed + i, without=flags.without_of(args), **more)
             for i in progress.each(range(args.num_samples), "generating motions", unit="motion")]
  _write(args, model, motions, outputs, start)


def _edit(args):
  from motion_jax.models.results import colors_of
  from motion_jax.models.shared.spans import spans_of
  outputs, clip = shared.outputs_of(args), shared.read_motion(args.file, args)
  if not (args.task or args.change or args.keep or args.keep_parts):
    raise InputError("got nothing to regenerate; give --task, --change, --keep or --keep-parts")
  start, pipeline = time.time(), _load_pipeline(args, None if args.keep_parts else "edit")
  model = pipeline.model
  if args.keep_parts:
    motions = control.regenerate_parts(args, clip, pipeline, flags.sampling_of(args, model))
    return _write(args, model, motions, outputs, start)
  _print_model(model, args, f"{clip.seconds:.1f} s of {args.file} edited")
  frames = round(clip.seconds * model.fps)
  _batches([frames] * args.num_samples, model)  # checks the length
  flag, texts = ("--keep", args.keep) if args.keep else ("--change", args.change or [])
  with shared.value_of(flag, " ".join(texts)):
    spans = spans_of(texts, frames, model.fps) or None
  keep, change = (spans, None) if args.keep else (None, spans)
  if args.no_paste and args.without:
    raise InputError("got --without with --no-paste, which is one pass of the network without those steps; use "
                     "--no-cleanup to leave out the cleanup")
  edit = functools.partial(model.edit, cleanup=not args.no_cleanup) if args.no_paste else functools.partial(
      pipeline.edit, max_attempts=args.max_attempts, without=flags.without_of(args))
  motions = [edit(clip, args.prompt, args.task, keep=keep, change=change, seed=args.seed + i,
                  **flags.sampling_of(args, model))
             for i in progress.each(range(args.num_samples), "generating motions", unit="motion")]
  for first, past in motions[0].meta["made"]:
    print(f"new frames: {first / model.fps:.1f} to {past / model.fps:.1f} s")
  return _write(args, model, motions, outputs, start, colors=colors_of(motions[0]))


def _check_count(rows, args):
  """Raises InputError for more motions than one run generates, before lists of them are built."""
  if rows * args.num_samples > MOTIONS[1]:
    raise InputError(f"got {rows:,} prompts with --num-samples {args.num_samples:,}, {rows * args.num_samples:,} "
                     f"motions; expected at most {MOTIONS[1]:,} in one run")


def _batches(frames, model):
  """Slices of motions with these lengths that fit in one batch, so that memory does not grow with their number.

  Raises InputError for more frames than one run generates.
  """
  total = float(sum(frames))
  if not total <= _MOST_FRAMES:
    raise InputError(f"got {_counted(len(frames), 'motion')} of {total / model.fps / 3600:.3g} hours together, "
                     f"expected at most {_MOST_FRAMES / model.fps / 3600:.1f} in one run; use several runs with other "
                     "--seed")
  size = max(1, int(BATCH_FRAMES // max(frames)))
  return [slice(first, first + size) for first in range(0, len(frames), size)]


def _length(pipeline, segments):
  """The approximate number of frames of segments [(prompt, seconds or None)]."""
  planner = pipeline.planner
  return sum(planner.natural_frames(prompt) if seconds is None else seconds * planner.fps
             for prompt, seconds in segments)


def _load_pipeline(args, ability=None):
  """The pipeline of --model, without its Warn step: each prompt is warned about once, not once per sample.

  Raises InputError for a model without the ability.
  """
  if args.timings:
    timing.start()
  with timing.part("imports"), progress.part("starting JAX"):
    shared.cache_compiled_code()
    from motion_jax import loading
    from motion_jax.models.abilities import cannot
    from motion_jax_studio import pipeline
    from motion_jax_studio.steps import Warn
  with timing.part("model"), progress.part(f"reading the model {args.model}"):
    model = loading.load(args.model)
  if ability and not model.can(ability):
    raise InputError(cannot(model.id, ability))
  return pipeline.Pipeline(model, [step for step in pipeline.STEPS if not isinstance(step, Warn)])


def _counted(number, noun):
  return f"{number:,} {noun}{'s' * (number != 1)}"


def _print_model(model, args, what):
  import jax
  print(f"{model.id}: {model.num_params / 1e6:.1f} M parameters on {jax.default_backend()}; {what}, guidance "
        f"{model.sampling(**flags.sampling_of(args, model)).guidance_scale:g}, seed {args.seed}")


def _write(args, model, motions, outputs, start, colors=None, signals=None, constraints=()):
  """Writes the motions to the outputs; with --explain prints what was done to them. colors (T, 3) of the body, and
  constraints and their signals, are for pictures.
  """
  from motion_jax.motion.step_records import lines
  print(f"generated in {time.time() - start:.1f} s")
  for number, motion in enumerate(motions[:_PRINTED] if args.explain else (), 1):
    print(*(f"motion {number}: " * (len(motions) > 1) + line for line in lines(motion.meta)), sep="\n")
  clips = [motion.replace(id=f"{pathlib.Path(outputs[0]).stem}_{i}") for i, motion in enumerate(motions)]
  with timing.part("files"), progress.part("writing files"):
    written = [path for out in outputs for path in _write_one(args, clips, out, colors, signals, constraints)]
  shared.print_rig_error(args, clips, outputs)
  shared.print_files(written)
  for text in filter(None, (model.limits, model.license)):
    print(text)
  if args.timings:
    print(timing.report())


def _write_one(args, clips, out, colors, signals, constraints):
  from motion_jax import export
  options = shared.file_options(args, out)
  if pathlib.Path(out).suffix.lower() in shared.PICTURES:
    spans = [shared.span_of(args, clip) for clip in clips]
    if colors is not None:
      options["colors"] = colors[spans[0]]
    if signals is not None:
      shown = [signal.slice_frames(span.start, span.stop) for signal, span in zip(signals, spans)]
      options |= control.drawn_options(out, shown, constraints)
    clips = [shared.trimmed(args, clip) for clip in clips]
  return export.save(clips, out, **options)
