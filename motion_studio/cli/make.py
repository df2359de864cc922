"""motion-jax generate, multi-prompt, extend and edit: the commands that make motion."""
import functools
import json
import pathlib
import time

import motion_jax
from motion_jax.models import registry
from motion_jax.models.options import TRIES, flag_of
from motion_jax.utils import progress, timing
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import MOTIONS, SEEDS, real, whole
from motion_studio.cli import control, shared
from motion_studio.cli.prompts import read_prompts, read_sequences

_TOLD = 20             # sentences of several actions of which a command says how it understood them
_AT_ONCE = 16_000      # frames, of all motions that are made in one batch, and
_MOST_FRAMES = 400_000  # of all that one run makes
_LITERAL = "give every sentence to the model as it is, also one that names several actions"
LENGTH = real(above=0, high=3600, unit="seconds")


def add_to(commands):
  """Adds these sub-commands to those of `motion-jax`."""
  generate = commands.add_parser("generate", help="a sentence in, a moving body out")
  generate.add_argument("prompt",
                        help="a sentence, or a .txt (one prompt a line, which may end in a length in frames at 20 a "
                        "second, as MoMask's: text#80, text#NA) or .csv (prompt,length in frames) file")
  length = generate.add_mutually_exclusive_group()
  length.add_argument("--seconds", type=LENGTH, help="length in seconds; by default that of similar training clips")
  length.add_argument("--frames", type=whole(1, 72_000), help="length in frames")
  generate.add_argument("--literal", action="store_true", help="say every sentence to the model as it is; without it "
                        "\"walks, then waves\" and \"waves while walking\" are done action by action")
  generate.add_argument("--tries", type=whole(1, 100), default=TRIES, help="how often at the most a motion is made in "
                        "which kicks, jumps, waves, turns and the like of its sentence are not to be seen, or not as "
                        f"many as it says ({TRIES})")
  control.add_to(generate)
  _making(generate, "motion.html")
  generate.set_defaults(run=_generate)

  several = commands.add_parser("multi-prompt", help="several sentences in a row, one motion out")
  several.add_argument("prompts", help="\"a person walks:4 | a person waves | ...\", with or without seconds behind "
                       "colons; a .csv (prompt,length in frames), a .txt (a prompt a line, as above) or a .txt of "
                       "timelines (caption # start # end # body parts)")
  several.add_argument("--way", choices=("stream", "chain", "joined"), default="stream",
                       help="stream (default): the words change within one run; chain: one run per sentence, as in the "
                            "released code; joined: each sentence by itself, joined where poses meet")
  several.add_argument("--rest", action="store_true", help="an action that is over before its seconds are, such as a "
                       "bow, ends in standing still; without it, it goes on or is done again")
  several.add_argument("--hold-until-done", action="store_true", help="no action that is done once, such as a kick, "
                       "has fewer seconds than clips of it in training")
  several.add_argument("--literal", action="store_true", help=_LITERAL)
  several.add_argument("--ease", action="store_true", help="spread over 0.4 s what hastens where the words change")
  _making(several, "multi_prompt.html")
  several.set_defaults(run=_multi_prompt)

  extend = commands.add_parser("extend", help="a motion in, the same motion going on as the words say out")
  extend.add_argument("file", help="an .npz, .npy, .bvh or .amc file")
  extend.add_argument("--text", required=True, help="what happens next; several sentences as for multi-prompt")
  extend.add_argument("--seconds", type=LENGTH, help="length of the new part in seconds, where --text is one sentence")
  extend.add_argument("--past-text", help="what the file shows; by default its own caption, else the new text")
  extend.add_argument("--way", choices=("stream", "chain"), default="stream",
                      help="stream (default): the past is kept clean in the cache; chain: one latent of it is noised "
                           "anew in each step, as in the released code")
  extend.add_argument("--literal", action="store_true", help=_LITERAL)
  shared.add_reading(extend)
  _making(extend, "extended.html")
  extend.set_defaults(run=_extend)

  edit = commands.add_parser("edit", help="new frames or body parts in a motion that exists (CDAMD models)")
  edit.add_argument("file", help="an .npz, .npy, .bvh or .amc file")
  edit.add_argument("--text", required=True, help="what the person does now")
  part = edit.add_mutually_exclusive_group()
  part.add_argument("--task", choices=("inpainting", "outpainting", "prefix", "suffix"),
                    help="keep first and last quarter, the middle half, the first half, the second half")
  part.add_argument("--edit", action="append", metavar="A:B",
                    help="replace this span: seconds (1.5s:3s), shares (25%%:0.5) or frames (30:60); may be repeated")
  part.add_argument("--keep", action="append", metavar="A:B", help="keep this span, and replace all else")
  edit.add_argument("--keep-parts", metavar="PARTS", help="keep these parts of the body (legs, torso, left_arm, "
                    "right_arm, head, with commas), and replace the others: in the spans of --edit, or everywhere; any "
                    "model")
  edit.add_argument("--no-paste", action="store_true", help="the network's own motion: kept frames as the autoencoder "
                    "decodes them, not as the file has them")
  edit.add_argument("--tries", type=whole(1, 100), default=TRIES, help="most attempts at new frames that do not show "
                    f"what --text requires ({TRIES})")
  shared.add_reading(edit)
  _making(edit, "edited.html")
  edit.set_defaults(run=_edit, model="cdamd-small")


def _making(parser, out):
  """Options of all commands that make motion."""
  parser.add_argument("--num", type=whole(*MOTIONS), default=1,
                      help="number of motions per prompt; motion i uses seed SEED + i (1)")
  parser.add_argument("--seed", type=whole(*SEEDS), default=0,
                      help="seed of the random draws: the same seed gives the same motion (0)")
  for flag, methods in _choices().items():
    _, known = next(iter(methods.values()))
    said = list(dict.fromkeys(one.help for _, one in methods.values()))
    told = said[0] if len(said) == 1 else "; ".join(
        f"{method.upper()}: {one.help}" for method, (_, one) in methods.items())
    told += _defaults(methods)
    here = _group(parser, next(iter(methods))) if len(methods) == 1 < len(registry.METHODS) else parser
    here.add_argument(f"--{flag}", type=None if known.read is str else known.read, choices=known.choices, help=told)
  parser.add_argument("--no-cleanup", action="store_true",
                      help="without foot-skate cleanup and smoothing, and not brought to what is asked exactly: "
                           "as the network made it")
  parser.add_argument("--model", default="cmdm-small",
                      help="a run folder, or a model that ships; motion-jax models lists them (%(default)s)")
  shared.add_out(parser, out, "wave.mp4,wave.bvh")
  shared.add_rig(parser)
  shared.add_film(parser, "in films and pictures")
  parser.add_argument("--timings", action="store_true", help="say at the end where the time went")


def _defaults(methods):
  """How the models that ship are sampled where nothing is given, by a choice of these methods: for its help."""
  found = {}
  for name, method, sampler in _samplers():
    if method in methods:
      field, known = methods[method]
      value = sampler.get(known.key or field, known.usual)
      if value is not None:
        found.setdefault(f"{value:g}" if isinstance(value, float) else str(value).lower(), []).append(name)
  said = "; ".join(value if len(found) == 1 else f"{value} for {', '.join(names)}" for value, names in found.items())
  return f" (the model's own: {said})" if said else ""


@functools.cache
def _samplers():
  """[(name, method, how it is sampled)] of the models that ship; their configs alone are read."""
  found = []
  for path in sorted((pathlib.Path(motion_jax.__file__).parent / "pretrained").glob("*/config.json")):
    config = json.loads(path.read_text(encoding="utf-8"))
    if "sampler" in config:
      found.append((path.parent.name, config["stage"].partition(".")[0], config["sampler"]))
  return found


def _choices():
  """{flag: {method: (field, what is known of it)}} of all choices of sampling that a command line may make."""
  found = {}
  for method, options in registry.options().items():
    for name, known in options.described().items():
      found.setdefault(flag_of(name, known), {})[method] = name, known
  return found


def _group(parser, method):
  title = f"{method.upper()} models"
  return next((group for group in parser._action_groups if group.title == title), None) or (
      parser.add_argument_group(title))


def _generate(args):
  outputs, rows = shared.outputs_of(args), read_prompts(args.prompt)
  _check_count(len(rows), args)
  start, model = time.time(), _load_model(args)
  from motion_studio.planning import sequencing as composed
  rows = read_prompts(args.prompt, model.fps)
  prompts = [prompt for prompt, _ in rows for _ in range(args.num)]
  seeds = [args.seed + i for _ in rows for i in range(args.num)]
  given = [frames for _, frames in rows for _ in range(args.num)]
  if args.seconds is not None or args.frames is not None:
    given = [args.frames if args.frames is not None else args.seconds * model.fps] * len(prompts)
  wanted = control.constraints_of(args, model)
  literal = args.literal or not model.can("understand")
  if wanted and given[0] is None:
    from motion_studio import controlled
    sentences = {prompt: None if literal else model.understand(prompt) for prompt in prompts}
    counts = {prompt: controlled.usual_frames(model, wanted, sentence) for prompt, sentence in sentences.items()}
    given = [counts[prompt] for prompt in prompts]
    for prompt, sentence in sentences.items():
      if sentence is not None and counts[prompt] is not None:
        controlled.tell_if_hasty(model, sentence, counts[prompt])
  with timing.part("text"), progress.part("reading the prompts"):
    model.check_words(list(dict.fromkeys(prompts)), literal)
    asked = list(dict.fromkeys(zip(prompts, given)))
    understood = {(prompt, count): composed.with_endings(
        model, [prompt], [None if literal else model.understand(prompt)], count, None)[0] for prompt, count in asked}
    lengths = {key: composed.lengths_of(model, [key[0]], [understood[key]], key[1], None)[0] for key in asked}
    frames = [sum(lengths[key]) for key in zip(prompts, given)]
  for sentence in [understood[key] for key in lengths][:_TOLD]:
    if sentence is not None and not sentence.is_plain:  # how long each is, is said of the motion once it is made
      print(f"understood as: {' | '.join(segment.words for segment in sentence.segments)}")
  shortest, longest = (f"{count / model.fps:.1f}" for count in (min(frames), max(frames)))
  _tell_model(model, args, f"{len(prompts)} motion{'s' * (len(prompts) > 1)} of "
                           f"{shortest if shortest == longest else f'{shortest} to {longest}'} s")
  motions = []
  for piece in progress.each(_pieces(frames, model), "making motions", unit="batch"):
    motions += model.generate(prompts[piece], frames[piece], seeds=seeds[piece], cleanup=not args.no_cleanup,
                              **(dict(literal=literal, tries=args.tries) if model.can("understand") else {}),
                              **(dict(control=wanted, project=not args.no_cleanup) if wanted else {}),
                              **_sampling(args, model))
  made_as = [motion.meta["understood"] for motion in motions if "understood" in motion.meta]
  for said in list(dict.fromkeys(made_as))[:_TOLD]:
    print(f"made as: {said}")
  _write(args, model, motions, outputs, start, asked=control.drawn(wanted, motions) if wanted else None,
         constraints=wanted)


def _multi_prompt(args):
  outputs = shared.outputs_of(args)
  start, model = time.time(), _load_model(args)
  _able(model, "multi_prompt")
  sequences = read_sequences(args.prompts, model.fps)
  _check_count(len(sequences), args)
  model.check_words(list(dict.fromkeys(prompt for one in sequences for prompt, _ in one)), args.literal)
  _tell_model(model, args, f"{len(sequences) * args.num} motion(s) of {len(sequences[0])} prompt(s) each")
  sequences = [one for one in sequences for _ in range(args.num)]
  seeds = [args.seed + i for _ in range(len(sequences) // args.num) for i in range(args.num)]
  motions = []
  for piece in progress.each(_pieces([_length(model, one) for one in sequences], model), "making motions",
                             unit="batch"):
    motions += model.multi_prompts(sequences[piece], way=args.way, cleanup=not args.no_cleanup, seeds=seeds[piece],
                                   rest=args.rest, hold_until_done=args.hold_until_done, ease=args.ease,
                                   literal=args.literal, **_sampling(args, model))
  for caption in motions[0].captions if len(sequences) == args.num else ():
    print(f"{caption.start:6.1f} to {caption.end:5.1f} s  {caption.text}")
  _write(args, model, motions, outputs, start)


def _extend(args):
  outputs, clip = shared.outputs_of(args), shared.read_motion(args.file, args)
  start, model = time.time(), _load_model(args)
  _able(model, "extend")
  segments = read_sequences(args.text, model.fps)[0]
  if args.seconds is not None:
    if len(segments) > 1:
      raise InputError("got --seconds for several sentences; write them behind colons, as in \"walks:4 | sits:3\"")
    segments = [(segments[0][0], args.seconds)]
  model.check_words([prompt for prompt, _ in segments], args.literal)
  _pieces([clip.seconds * model.fps + _length(model, segments)] * args.num, model)
  _tell_model(model, args, f"{clip.seconds:.1f} s of {args.file} go on")
  motions = [model.extend(clip, segments, past_prompt=args.past_text, seed=args.seed + i, way=args.way,
                          cleanup=not args.no_cleanup, literal=args.literal, **_sampling(args, model))
             for i in progress.each(range(args.num), "making motions", unit="motion")]
  _write(args, model, motions, outputs, start)


def _edit(args):
  from motion_jax.models.results import colors_of
  from motion_jax.utils.spans import spans_of
  outputs, clip = shared.outputs_of(args), shared.read_motion(args.file, args)
  if not (args.task or args.edit or args.keep or args.keep_parts):
    raise InputError("got nothing to replace; give --task, --edit, --keep or --keep-parts")
  start, model = time.time(), _load_model(args)
  if args.keep_parts:
    _write(args, model, control.anew(args, clip, model, _sampling(args, model)), outputs, start)
    return
  _able(model, "edit")
  _tell_model(model, args, f"{clip.seconds:.1f} s of {args.file} edited")
  frames = round(clip.seconds * model.fps)
  _pieces([frames] * args.num, model)
  keep, change = (spans and spans_of(spans, frames, model.fps) for spans in (args.keep, args.edit))
  motions = [model.edit(clip, args.text, args.task, keep=keep, change=change, seed=args.seed + i,
                        paste=not args.no_paste, cleanup=not args.no_cleanup, tries=args.tries,
                        **_sampling(args, model))
             for i in progress.each(range(args.num), "making motions", unit="motion")]
  for first, past in motions[0].meta["made"]:
    print(f"new frames: {first / model.fps:.1f} to {past / model.fps:.1f} s")
  _write(args, model, motions, outputs, start, colors=colors_of(motions[0]))


def _check_count(rows, args):
  """Raises ValueError for more motions than one command makes, before lists of them are written."""
  if rows * args.num > MOTIONS[1]:
    raise InputError(f"got {rows:,} prompts with --num {args.num:,}, {rows * args.num:,} motions; expected at most "
                     f"{MOTIONS[1]:,} in one run")


def _pieces(frames, model):
  """Slices of motions of so many frames each that are made at once: memory does not grow with their number.

  Raises ValueError where all together are more than one run holds.
  """
  total = float(sum(frames))
  if not total <= _MOST_FRAMES:
    raise InputError(f"got {len(frames):,} motion(s) of {total / model.fps / 3600:.3g} hours together, expected at "
                     f"most {_MOST_FRAMES / model.fps / 3600:.1f} in one run; make fewer, then more by --seed")
  size = max(1, int(_AT_ONCE // max(frames)))
  return [slice(first, first + size) for first in range(0, len(frames), size)]


def _length(model, segments):
  """Frames of segments [(prompt, seconds or None)], about."""
  return sum(model.natural_frames(prompt) if seconds is None else seconds * model.fps for prompt, seconds in segments)


def _sampling(args, model):
  """The choices given, by the names that the model knows; a choice that is none of its method's is an error."""
  given = {flag: getattr(args, flag.replace("-", "_")) for flag in _choices()}
  given = {flag: value for flag, value in given.items() if value is not None}
  ours = {flag_of(name, known): name for name, known in model.options.described().items()}
  strange = [f"--{flag}" for flag in given if flag not in ours]
  if strange:
    raise InputError(f"got {', '.join(strange)} for the model {model.id}, which has no such choice")
  return {ours[flag]: value for flag, value in given.items()}


def _load_model(args):
  if args.timings:
    timing.start()
  with timing.part("imports"), progress.part("starting JAX"):
    shared.cache_compiled_code()
    from motion_jax import loading
  with timing.part("model"), progress.part(f"reading the model {args.model}"):
    model = loading.load(args.model)
  shared.import_ahead("scipy.ndimage", "scipy.linalg")  # for cleanup and files: while the program is being read
  return model


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
  shared.tell_rig_error(args, clips, outputs)
  shared.tell_files(written)
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
