"""motion-jax generate, multi-prompt, extend and edit: the commands that generate motion."""
import functools
import itertools

from motion_jax.utils import progress
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import real, whole
from motion_jax_studio import step_names
from motion_jax_studio.cli import control
from motion_jax_studio.cli import generation_flags as flags
from motion_jax_studio.cli.parser import typed
from motion_jax_studio.cli.prompts import check_count, read_lines, read_sequences
from motion_jax_studio.cli.reading import MOTION_HELP, add_reading, read_motion, value_of
from motion_jax_studio.cli.session import Session, counted, print_sampled

_SECONDS = real(above=0, high=3600, unit="seconds")


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  _add_generate(commands)
  _add_multi_prompt(commands)
  _add_extend(commands)
  _add_edit(commands)


def _add_generate(commands):
  generate = commands.add_parser("generate", help="generate motion from a text prompt")
  generate.add_argument("prompt", help="a sentence, or a file of prompts: .txt with one prompt per line (MoMask's "
                        "text#80 sets a length in frames at 20 fps), or .csv with the columns prompt,length in frames")
  length = generate.add_mutually_exclusive_group()
  length.add_argument("--seconds", type=_SECONDS, help="length in seconds (default: that of similar training clips)")
  length.add_argument("--num-frames", type=whole(1, 72_000), help="length in frames")
  flags.add_planning(generate)
  flags.add_attempts(generate)
  flags.add_steps(generate, step_names.GENERATE)
  control.add_to(generate)
  flags.add_common(generate, "generate", "motion.html", ("seconds", "max_attempts", "control", "path"))
  generate.set_defaults(run=_generate)


def _add_multi_prompt(commands):
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
  several.add_argument("--hold-until-done", action="store_true", help="give an action that ends by itself, such as a "
                       "kick, at least the length of similar training clips")
  flags.add_planning(several)
  flags.add_steps(several, step_names.MULTI_PROMPT)
  several.add_argument("--ease", action="store_true", help="spread sudden speed changes between prompts over 0.4 s")
  flags.add_common(several, "multi-prompt", "multi_prompt.html", ("way",))
  several.set_defaults(run=_multi_prompt)


def _add_extend(commands):
  extend = commands.add_parser("extend", help="continue a motion file from a prompt")
  extend.add_argument("file", help=f"motion to continue: {MOTION_HELP}")
  extend.add_argument("--prompt", required=True, help="what happens next; several prompts as for multi-prompt")
  extend.add_argument("--seconds", type=_SECONDS, help="length of the new part in seconds, for a single prompt")
  extend.add_argument("--past-prompt", help="prompt of the motion in the file (default: its caption, else the new one)")
  extend.add_argument("--way", choices=("stream", "chain"),
                      help="stream (default): the past stays clean in the cache; chain: one past latent is noised "
                           "again in each step, as in the released code")
  flags.add_planning(extend)
  flags.add_steps(extend, step_names.EXTEND)
  add_reading(extend)
  flags.add_common(extend, "extend", "extended.html", ("prompt", "seconds"))
  extend.set_defaults(run=_extend)


def _add_edit(commands):
  edit = commands.add_parser("edit", help="regenerate selected frames or body parts of a motion file")
  edit.add_argument("file", help=f"motion to edit: {MOTION_HELP}")
  edit.add_argument("--prompt", required=True, help="what the person does in the new frames")
  part = edit.add_mutually_exclusive_group()
  part.add_argument("--task", choices=("inpainting", "outpainting", "prefix", "suffix"),
                    help="frames to keep: the first and last quarter (inpainting), the middle half (outpainting), the "
                         "first half (prefix), the second half (suffix)")
  part.add_argument("--change", action="append", metavar="A:B",
                    help="regenerate this span and keep the rest: seconds (1.5s:3s), shares (25%%:0.5) or frames "
                         "(30:60); repeatable")
  part.add_argument("--keep", action="append", metavar="A:B", help="keep this span and regenerate the rest; repeatable")
  edit.add_argument("--keep-parts", metavar="PARTS", type=typed(control.parts_of), help="keep these body parts (legs, "
                    "torso, left_arm, right_arm, head, with commas) and regenerate the others, within --change or "
                    "everywhere; works with any model")
  edit.add_argument("--control", metavar="FILE.json", help="keys that the new frames meet: poses and targets with "
                    "times (docs/control.md)")
  edit.add_argument("--no-paste", action="store_true", help="return kept frames as the autoencoder decodes them, "
                    "not as they are in the file")
  flags.add_attempts(edit)
  flags.add_steps(edit, step_names.EDIT)
  add_reading(edit)
  flags.add_common(edit, "edit", "edited.html", ("prompt", "task", "change", "keep", "keep_parts", "control",
                                                 "max_attempts"))
  edit.set_defaults(run=_edit, model="cdamd-small")


def _generate(args):
  lines = read_lines(args.prompt)
  check_count(len(lines), args.num_samples)
  session = Session(args)
  constraints = control.constraints_of(args, session.model)
  run = session.pipeline.run(_requests(args, lines, session.model.fps), control=constraints or None,
                             exact=not args.no_cleanup, without=session.without, max_attempts=args.max_attempts,
                             **session.sampling)
  session.print_plans(next(run))
  motions = [*itertools.chain.from_iterable(run)]
  print_sampled(motions)
  session.write(motions, constraints=constraints)


def _requests(args, lines, fps):
  """The requests of `generate`: --num-samples of each line."""
  from motion_jax_studio.batches import Request
  given = args.num_frames if args.seconds is None else args.seconds * fps
  return [Request(line.prompt, line.frames(fps) if given is None else given, args.seed + i)
          for line in lines for i in range(args.num_samples)]


def _multi_prompt(args):
  from motion_jax_studio.batches import batches
  session = Session(args, "multi_prompt")
  lists = read_sequences(args.prompts, session.model.fps)
  check_count(len(lists), args.num_samples)
  session.print_model(f"{counted(len(lists) * args.num_samples, 'motion')} of {counted(len(lists[0]), 'prompt')}")
  rows = [(segments, seed) for segments in lists for seed in session.seeds]
  motions = []
  for batch in progress.each(batches([_length(session.pipeline, segments) for segments, _ in rows], session.model.fps),
                             "generating motions", unit="batch"):
    segments, seeds = zip(*rows[batch])
    motions += session.pipeline.multi_prompts(segments, way=args.way, without=session.without, seeds=seeds,
                                              rest=args.rest, hold_until_done=args.hold_until_done, ease=args.ease,
                                              **session.sampling)
  for caption in motions[0].captions if len(lists) == 1 else ():
    print(f"{caption.start:6.1f} to {caption.end:5.1f} s  {caption.text}")
  session.write(motions)


def _extend(args):
  clip = read_motion(args.file, args)
  session = Session(args, "extend")
  segments = _segments(args, session.model.fps)
  session.print_model(f"{clip.seconds:.1f} s of {args.file} to continue")
  more = {name: value for name in ("past_prompt", "way") if (value := getattr(args, name)) is not None}
  if more and not session.model.ways:
    raise InputError(f"got --{min(more).replace('_', '-')} for the model {session.model.id}, which has no such choice")
  extend = functools.partial(session.pipeline.extend, clip, segments, without=session.without, **more,
                             **session.sampling)
  session.write(session.each_seed(extend, clip.seconds * session.model.fps + _length(session.pipeline, segments)))


def _segments(args, fps):
  """[(prompt, seconds)] with which `extend` continues a motion."""
  segments, *others = read_sequences(args.prompt, fps)
  if others:
    raise InputError(f"got {1 + len(others)} lists of prompts in {args.prompt}, expected one to continue a motion with")
  if args.seconds is not None and len(segments) > 1:
    raise InputError("got --seconds for several prompts; write lengths after colons, as in \"walks:4 | sits:3\"")
  return segments if args.seconds is None else [(segments[0][0], args.seconds)]


def _edit(args):
  from motion_jax.models.results import colors_of
  clip = read_motion(args.file, args)
  if not (args.task or args.change or args.keep or args.keep_parts):
    raise InputError("got nothing to regenerate; give --task, --change, --keep or --keep-parts")
  session = Session(args, None if args.keep_parts else "edit")
  if args.keep_parts:
    return session.write(_regenerate_parts(args, clip, session))
  fps = session.model.fps
  session.print_model(f"{clip.seconds:.1f} s of {args.file} edited")
  frames = round(clip.seconds * fps)
  spans = {name: _spans(f"--{name}", getattr(args, name), frames, fps) for name in ("keep", "change")}
  motions = session.each_seed(functools.partial(_editor(args, session), clip, args.prompt, args.task, **spans,
                                                **session.sampling), frames)
  for first, past in motions[0].meta["made"]:
    print(f"new frames: {first / fps:.1f} to {past / fps:.1f} s")
  return session.write(motions, colors=colors_of(motions[0]))


def _regenerate_parts(args, clip, session):
  """The motions of `edit --keep-parts`: body parts of the clip are kept, the prompt controls the others."""
  from motion_jax.control.constraints import KeepParts
  from motion_jax.models.shared.known_motion import at_rate
  if args.task or args.keep:
    raise InputError("got --keep-parts with --task or --keep; use --change for the span in which the other "
                     "parts are regenerated")
  fps = session.model.fps
  joints = at_rate(clip, fps, session.model.stats.layout.skeleton)
  spans = [[first / fps, past / fps] for first, past in _spans("--change", args.change, len(joints), fps) or ()] or None
  return session.pipeline([args.prompt] * args.num_samples, seeds=session.seeds, without=session.without,
                          control=[KeepParts(joints, args.keep_parts, fps, spans)], **session.sampling)


def _spans(flag, texts, frames, fps):
  """The spans of frames that a flag names, or None."""
  from motion_jax.models.shared.spans import spans_of
  with value_of(flag, " ".join(texts or ())):
    return spans_of(texts or [], frames, fps) or None


def _editor(args, session):
  """The function that edits: the pipeline's, or with --no-paste the model's."""
  if not args.no_paste:
    keys = {"control": control.read_file(args, session.model)} if args.control else {}
    return functools.partial(session.pipeline.edit, max_attempts=args.max_attempts, without=session.without, **keys)
  if args.control:
    raise InputError("got --control with --no-paste; keys are met in the clip itself, so leave out --no-paste")
  if args.without:
    raise InputError("got --without with --no-paste, which is one pass of the network without those steps; use "
                     "--no-cleanup to leave out the cleanup")
  return functools.partial(session.model.edit, cleanup=not args.no_cleanup)


def _length(pipeline, segments):
  """The approximate number of frames of segments [(prompt, seconds or None)]."""
  planner = pipeline.planner
  return sum(planner.natural_frames(prompt) if seconds is None else seconds * planner.fps
             for prompt, seconds in segments)
