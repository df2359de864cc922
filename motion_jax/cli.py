"""motion-jax: words to moving bodies, from the command line. One function per sub-command."""
import argparse
import csv
import os
import pathlib
import sys
import time
import warnings

from motion_jax import cli_convert

KNOWN_ERRORS = (ValueError, OSError, FloatingPointError, RuntimeError)  # RuntimeError: no encoder for mp4


def main(argv=None):
  """Runs a sub-command; returns the exit status. An error that the user can mend is one line, not a traceback."""
  parser = _parser()
  args = parser.parse_args(argv)
  said = set()  # each once, however often it is met on the way

  def tell(message, *_, **__):
    if str(message) not in said:
      said.add(str(message))
      print(f"note: {message}", file=sys.stderr)

  warnings.showwarning = tell
  try:
    return args.run(args) or 0
  except KNOWN_ERRORS as error:
    print(f"motion-jax {args.command}: {error}", file=sys.stderr)
    return 1
  except KeyboardInterrupt:
    print("stopped; nothing half-written is left", file=sys.stderr)
    return 130


def _parser():
  parser = argparse.ArgumentParser(prog="motion-jax", description="Make people move from words.")
  commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

  generate = commands.add_parser("generate", help="a sentence in, a moving body out")
  generate.add_argument("prompt",
                        help="a sentence, or a .txt (one prompt a line) or .csv (prompt,length in frames) file")
  length = generate.add_mutually_exclusive_group()
  length.add_argument("--seconds", type=float, help="length; without one, that of similar training clips")
  length.add_argument("--frames", type=int, help="length in frames")
  _making(generate, "motion.html")
  generate.set_defaults(run=_generate)

  story = commands.add_parser("story", help="several sentences in a row, one motion out")
  story.add_argument("story", help="\"a person walks:4 | a person waves | ...\", with or without seconds behind "
                                   "colons; a .csv (prompt,length in frames), a .txt (a prompt a line, as above) or a "
                                   ".txt of timelines (caption # start # end # body parts)")
  story.add_argument("--way", choices=("stream", "chain"), default="stream",
                     help="words change within one run, or one run per sentence as in the released code")
  _making(story, "story.html")
  story.set_defaults(run=_story)

  extend = commands.add_parser("extend", help="a motion in, the same motion going on as the words say out")
  extend.add_argument("file", help="an .npz, .npy or .bvh file")
  extend.add_argument("--text", required=True, help="what happens next; several sentences as for story")
  extend.add_argument("--seconds", type=float, help="length of what is new, of a single sentence")
  extend.add_argument("--past-text", help="what the file shows; its own caption, else the new text")
  extend.add_argument("--way", choices=("stream", "chain"), default="stream",
                      help="the past kept clean in the cache, or one latent of it noised anew as in the released code")
  extend.add_argument("--fps", type=float, help="frame rate of an .npy file, which does not say it (20)")
  _making(extend, "extended.html")
  extend.set_defaults(run=_extend)

  edit = commands.add_parser("edit", help="a motion in, the same one with parts of it made anew out (CDAMD models)")
  edit.add_argument("file", help="an .npz, .npy or .bvh file")
  edit.add_argument("--text", required=True, help="what the person does now")
  part = edit.add_mutually_exclusive_group(required=True)
  part.add_argument("--task", choices=("inpainting", "outpainting", "prefix", "suffix"),
                    help="keep first and last quarter, the middle half, the first half, the second half")
  part.add_argument("--edit", action="append", metavar="A:B",
                    help="make this span anew: seconds (1.5s:3s), shares (25%%:0.5) or frames (30:60); may be repeated")
  part.add_argument("--keep", action="append", metavar="A:B", help="keep this span, and make all else anew")
  edit.add_argument("--no-paste", action="store_true", help="kept frames as the autoencoder gives them back, not as "
                                                            "they came")
  edit.add_argument("--fps", type=float, help="frame rate of an .npy file, which does not say it (20)")
  _making(edit, "edited.html")
  edit.set_defaults(run=_edit, model="cdamd-small")

  render = commands.add_parser("render", help="show any npz, npy or bvh file as mp4, gif, html, png, glb or bvh")
  render.add_argument("file")
  render.add_argument("--out", help="file to write (FILE with .html)")
  render.add_argument("--fps", type=float, help="frame rate of an .npy file, which does not say it (20)")
  render.set_defaults(run=_render)

  data = commands.add_parser("data", help="make and check training data").add_subparsers(
      dest="data_command", required=True, metavar="COMMAND")
  build = data.add_parser("build", help="an archive or a folder of BVH or ASF/AMC files -> a HumanML3D-layout folder")
  build.add_argument("source")
  build.add_argument("out")
  build.add_argument("--captions", help="CSV, TSV or JSONL: file, caption[, start, end, split]")
  build.add_argument("--mapping", help="JSON: {our joint: their joint or a list of them}")
  build.add_argument("--mode", choices=("corrected", "benchmark"), default="corrected")
  build.add_argument("--fps", type=float, help="frame rate to resample to (20)")
  build.add_argument("--no-mirror", action="store_true", help="leave mirrored copies out")
  build.add_argument("--overwrite", action="store_true")
  build.set_defaults(run=_build)
  doctor = data.add_parser("doctor", help="what is wrong with a data folder, and what to do")
  doctor.add_argument("folder")
  doctor.set_defaults(run=_doctor)

  cli_convert.add_to(commands)

  retrieve = commands.add_parser("retrieve", help="the clips nearest to a sentence, the captions nearest to a motion")
  retrieve.add_argument("query", nargs="?", help="a sentence, or an .npz, .npy or .bvh file; without one, how often "
                                                 "the right clip is found among all (recall) is printed")
  retrieve.add_argument("--data", required=True, metavar="DIR", help="an archive or a HumanML3D-layout folder")
  retrieve.add_argument("--split", help="train, val or test; all if left out")
  retrieve.add_argument("--num", type=int, default=5, help="how many to show (5)")
  retrieve.add_argument("--teacher", default="part-tmr-small", help="a run folder or the name of one that ships")
  retrieve.add_argument("--fps", type=float, help="frame rate of an .npy file, which does not say it (20)")
  retrieve.add_argument("--out", help="file to write the nearest clip to, such as nearest.html")
  retrieve.set_defaults(run=_retrieve)

  models = commands.add_parser("models", help="the models that ship")
  models.set_defaults(run=_models)
  return parser


def _making(parser, out):
  """Options of all commands that make motion."""
  parser.add_argument("--num", type=int, default=1, help="motions of each, with seeds SEED, SEED + 1, ...")
  parser.add_argument("--seed", type=int, default=0)
  parser.add_argument("--guidance", type=float, help="how strictly the words are followed (3)")
  parser.add_argument("--steps", type=int, help="sampling steps K (50); of CDAMD, the solver's in each round (10)")
  parser.add_argument("--solver", help="euler (CMDM's) or heun; of CDAMD also midpoint (its own), rk4 and dopri5")
  cmdm = parser.add_argument_group("CMDM models")
  cmdm.add_argument("--schedule", choices=("fss", "ar", "full"),
                    help="frame-wise sampling (fss), block after block, or all at once")
  cmdm.add_argument("--lag", type=int, help="steps between the starts of two blocks, of schedule fss (2)")
  cmdm.add_argument("--context", type=int, help="latents (4 frames each) looked back on; the training length (48)")
  cdamd = parser.add_argument_group("CDAMD models")
  cdamd.add_argument("--rounds", type=int, help="rounds in which latents are made (10)")
  cdamd.add_argument("--order", choices=("random", "left_to_right"), help="which latents are made first")
  cdamd.add_argument("--mask", choices=("causal", "dccm", "bcm", "bidirectional"), help="what latents may look at")
  parser.add_argument("--raw", action="store_true", help="as the network made it: feet not planted, nothing smoothed")
  parser.add_argument("--model", default="cmdm-small", help="a run folder or the name of a model that ships")
  parser.add_argument("--out", default=out,
                      help="file to write: .npz .npy .bvh .glb .mp4 .gif .html .png; repeat kinds with commas, as in "
                           "wave.mp4,wave.bvh")


def _sampling(args, model):
  """The choices given, for the kind of model that it is; a choice that is none of its kind's is an error."""
  from motion_jax.cdamd_model import CdamdModel
  ours, others = dict(schedule=args.schedule, lag=args.lag, context=args.context), dict(
      rounds=args.rounds, order=args.order, mask=args.mask)
  if isinstance(model, CdamdModel):
    ours, others = others, ours
  strange = [f"--{name}" for name, value in others.items() if value is not None]
  if strange:
    raise ValueError(f"got {', '.join(strange)} for the model {model.id}, which has no such choice")
  given = dict(num_steps=args.steps, solver=args.solver, guidance_scale=args.guidance, **ours)
  return {name: value for name, value in given.items() if value is not None}


def _cache_compiled_code():
  """Compiled functions stay on disk, so that the second run of a command does not wait for the compiler."""
  import jax
  folder = os.environ.get("JAX_COMPILATION_CACHE_DIR") or os.path.join(
      os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "motion_jax", "jax")
  try:
    os.makedirs(folder, exist_ok=True)
  except OSError:
    return  # a read-only home costs time, not the motion
  jax.config.update("jax_compilation_cache_dir", folder)
  jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)


def read_prompts(text):
  """[(prompt, frames or None)] from a sentence, a .txt file with one a line, or a .csv file of prompt and length."""
  path = pathlib.Path(text)
  if path.suffix.lower() not in (".txt", ".csv"):
    return [(text, None)]
  if not path.is_file():
    raise FileNotFoundError(f"there is no prompt file {text}; a sentence is given in quotes")
  lines = path.read_text(encoding="utf-8-sig").splitlines()
  if path.suffix.lower() == ".txt":
    rows = [(line.strip(), None) for line in lines if line.strip()]
  else:
    rows = []
    for number, row in enumerate(csv.reader(lines), 1):
      is_header = number == 1 and row and row[0].strip().lower() in ("prompt", "text", "caption")
      if is_header or not any(cell.strip() for cell in row):
        continue
      length = row[1].strip() if len(row) > 1 else ""
      if length and not length.isdigit():
        raise ValueError(f"{path} line {number}: got length {length!r}, expected a number of frames; a comma inside a "
                         "prompt needs quotes around it")
      rows.append((row[0].strip(), int(length) if length else None))
  if not rows:
    raise ValueError(f"{path} holds no prompt")
  return rows


def read_stories(text, fps=20.0):
  """[[(prompt, seconds or None)]]: stories from prompts parted by |, or from a file, see `motion-jax story --help`."""
  from motion_jax.data import timelines
  path = pathlib.Path(text)
  if path.suffix.lower() == ".txt" and path.is_file() and timelines.is_timeline(path.read_text(encoding="utf-8-sig")):
    return [timelines.single_track(timeline) for timeline in timelines.read_timelines(path)]
  if path.suffix.lower() == ".csv":
    return [[(prompt, None if frames is None else frames / fps) for prompt, frames in read_prompts(text)]]
  rows = [prompt for prompt, _ in read_prompts(text)]
  parts = rows if len(rows) > 1 else rows[0].split("|")
  return [[_prompt_and_seconds(part) for part in parts]]


def _prompt_and_seconds(part):
  """("a person walks", 4.0) from "a person walks:4"."""
  prompt, colon, seconds = part.strip().rpartition(":")
  try:
    return (prompt.strip(), float(seconds.strip().removesuffix("s"))) if colon else (part.strip(), None)
  except ValueError:
    return part.strip(), None  # a colon of the sentence's own


def _outputs(args):
  """The files to write, checked before minutes of work."""
  from motion_jax.export import check_output
  if args.num < 1:
    raise ValueError(f"got --num {args.num}, expected 1 or more")
  return [check_output(part) for part in args.out.split(",")]


def _load_model(args):
  _cache_compiled_code()
  from motion_jax import model as model_lib
  return model_lib.load(args.model)


def _tell_model(model, args, what):
  import jax
  print(f"{model.id}: {model.num_params / 1e6:.1f} M parameters on {jax.default_backend()}; {what}, guidance "
        f"{args.guidance or model.config.sampler.guidance_scale:g}, seed {args.seed}")


def _able(model, name):
  """Raises ValueError unless this kind of model has a method of that name."""
  if not hasattr(model, name):
    raise ValueError(f"{model.id} has no {name!r}; give another kind of model by --model")


def _write(model, motions, outputs, start, colors=None):
  """colors (T, 3) of the bodies, where a file is a picture."""
  from motion_jax import export
  print(f"made in {time.time() - start:.1f} s")
  clips = [motion.replace(id=f"{pathlib.Path(outputs[0]).stem}_{i}") for i, motion in enumerate(motions)]
  pictures = (".mp4", ".gif", ".png", ".jpg", ".html")
  shown = lambda out: {"colors": colors} if colors is not None and out.lower().endswith(pictures) else {}
  clips = clips if len(clips) > 1 else clips[0]
  _tell_files([path for out in outputs for path in export.save(clips, out, **shown(out))])
  if model.license:
    print(model.license)


def _generate(args):
  outputs, rows = _outputs(args), read_prompts(args.prompt)
  start, model = time.time(), _load_model(args)
  prompts = [prompt for prompt, _ in rows for _ in range(args.num)]
  seeds = [args.seed + i for _ in rows for i in range(args.num)]
  given = [frames for _, frames in rows for _ in range(args.num)]
  if args.seconds is not None or args.frames is not None:
    given = [args.frames if args.frames is not None else args.seconds * model.fps] * len(prompts)
  model.check_words(list(dict.fromkeys(prompts)))
  frames = [count if count is not None else model.natural_frames(prompt) for prompt, count in zip(prompts, given)]
  _tell_model(model, args, f"{len(prompts)} motion(s) of {min(frames) / model.fps:.1f} to "
                           f"{max(frames) / model.fps:.1f} s")
  motions = model.generate(prompts, frames, seeds=seeds, polish=not args.raw, **_sampling(args, model))
  _write(model, motions, outputs, start)


def _story(args):
  outputs = _outputs(args)
  start, model = time.time(), _load_model(args)
  _able(model, "stories")
  tales = read_stories(args.story, model.fps)
  _tell_model(model, args, f"{len(tales) * args.num} motion(s) of {len(tales[0])} prompt(s) each")
  motions = model.stories([tale for tale in tales for _ in range(args.num)], way=args.way, polish=not args.raw,
                          seeds=[args.seed + i for _ in tales for i in range(args.num)], **_sampling(args, model))
  for caption in motions[0].captions if len(tales) == 1 else ():
    print(f"{caption.start:6.1f} to {caption.end:5.1f} s  {caption.text}")
  _write(model, motions, outputs, start)


def _extend(args):
  from motion_jax import export
  outputs, clip = _outputs(args), export.load(args.file, fps=args.fps)
  start, model = time.time(), _load_model(args)
  _able(model, "extend")
  tale = read_stories(args.text, model.fps)[0]
  if args.seconds is not None:
    if len(tale) > 1:
      raise ValueError("got --seconds for several sentences; write them behind colons, as in \"walks:4 | sits:3\"")
    tale = [(tale[0][0], args.seconds)]
  _tell_model(model, args, f"{clip.seconds:.1f} s of {args.file} go on")
  motions = [model.extend(clip, tale, past_prompt=args.past_text, seed=args.seed + i, way=args.way,
                          polish=not args.raw, **_sampling(args, model)) for i in range(args.num)]
  _write(model, motions, outputs, start)


def _edit(args):
  from motion_jax import export
  from motion_jax.cdamd_model import colors_of, spans_of
  outputs, clip = _outputs(args), export.load(args.file, fps=args.fps)
  start, model = time.time(), _load_model(args)
  _able(model, "edit")
  _tell_model(model, args, f"{clip.seconds:.1f} s of {args.file} edited")
  frames = round(clip.seconds * model.fps)
  keep, change = (spans and spans_of(spans, frames, model.fps) for spans in (args.keep, args.edit))
  motions = [model.edit(clip, args.text, args.task, keep=keep, change=change, seed=args.seed + i,
                        paste=not args.no_paste, polish=False, **_sampling(args, model)) for i in range(args.num)]
  for first, past in motions[0].meta["made"]:
    print(f"made anew: {first / model.fps:.1f} to {past / model.fps:.1f} s")
  _write(model, motions, outputs, start, colors=colors_of(motions[0]))


def _tell_files(written):
  print("wrote " + ", ".join(map(str, written)))
  first = str(written[0])
  if first.endswith(".html"):
    print(f"open {first} in a browser; no network is needed")
  elif first.endswith((".npz", ".npy", ".bvh")):
    print(f"see it: motion-jax render {first}")


def _render(args):
  from motion_jax import export
  out = args.out or str(pathlib.Path(args.file).with_suffix(".html"))
  export.check_output(out)
  clip = export.load(args.file, fps=args.fps)
  print(f"{args.file}: {clip.num_frames} frames, {clip.seconds:.1f} s at {clip.fps:g} frames a second")
  _tell_files(export.save(clip, out))


def _build(args):
  from motion_jax.data import build
  print(build.build(args.source, args.out, captions=args.captions, mapping=args.mapping, mode=args.mode,
                    mirror=not args.no_mirror, fps=args.fps, overwrite=args.overwrite))
  print(f"check it: motion-jax data doctor {args.out}")


def _doctor(args):
  from motion_jax.data import doctor
  report = doctor.examine(args.folder)
  print(doctor.format_report(report))
  return 0 if report.ok else 1


def _retrieve(args):
  from motion_jax import export
  if args.out:
    export.check_output(args.out)
  if args.num < 1:
    raise ValueError(f"got --num {args.num}, expected 1 or more")
  is_file = args.query is not None and args.query.lower().endswith((".npz", ".npy", ".bvh"))
  asked = export.load(args.query, fps=args.fps) if is_file else None  # before minutes of work
  if args.out and (asked is not None or args.query is None):
    raise ValueError("--out writes the clip nearest to a sentence; give a sentence")
  _cache_compiled_code()
  from motion_jax import retrieval
  retriever = retrieval.load(args.teacher)
  collection = retrieval.read_collection(retriever, args.data, args.split)
  print(f"{len(collection)} clips of {args.data}" + (f", split {args.split}" if args.split else ""))
  if args.query is None:
    count, scores = collection.scores(retriever)
    print(f"recall among {count} clips, one of each caption")
    for way, prefix in (("text to motion", ""), ("motion to text", "back_")):
      tell = [f"at {k} {100 * scores[f'{prefix}r{k}']:.1f} %" for k in (1, 2, 3, 5, 10)]
      print(f"{way}: {', '.join(tell)}; median rank {scores[f'{prefix}median_rank']:g}")
  elif asked is not None:
    vector = retriever.embed_motion([retriever.features_of(asked)])[0]
    for similarity, caption in collection.nearest_captions(vector, retriever, args.num):
      print(f"{similarity:6.3f}  {caption}")
  else:
    if not args.query.strip():
      raise ValueError("got an empty sentence; say what the person does, such as 'a person walks'")
    found = collection.nearest_clips(retriever.embed_text([args.query])[0], args.num)
    for similarity, i in found:
      print(f"{similarity:6.3f}  {collection.ids[i]:24s} {collection.seconds[i]:5.1f} s  {collection.captions[i][0]}")
    if args.out:
      clips = retrieval.read_clips(args.data, args.split)
      _tell_files(export.save(clips[found[0][1]], args.out))


def _models(args):
  from motion_jax import model as model_lib
  for name in model_lib.pretrained_names():
    print(f"{name}\t{model_lib.PRETRAINED / name / 'README.md'}")


if __name__ == "__main__":
  sys.exit(main())
