"""motion-jax: words to moving bodies, from the command line. One function per sub-command."""
import argparse
import csv
import os
import pathlib
import sys
import time
import warnings

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
  generate.add_argument("--num", type=int, default=1, help="motions per prompt, with seeds SEED, SEED + 1, ...")
  generate.add_argument("--seed", type=int, default=0)
  generate.add_argument("--guidance", type=float, help="how strictly the words are followed (3)")
  generate.add_argument("--schedule", choices=("fss", "ar", "full"), default="fss",
                        help="frame-wise sampling, block after block, or all at once")
  generate.add_argument("--steps", type=int, help="sampling steps K (50)")
  generate.add_argument("--raw", action="store_true", help="as the network made it: feet not planted, nothing smoothed")
  generate.add_argument("--model", default="cmdm-small", help="a run folder or the name of a model that ships")
  generate.add_argument("--out", default="motion.html",
                        help="file to write: .npz .npy .bvh .glb .mp4 .gif .html .png; repeat kinds with commas, "
                             "as in wave.mp4,wave.bvh")
  generate.set_defaults(run=_generate)

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

  models = commands.add_parser("models", help="the models that ship")
  models.set_defaults(run=_models)
  return parser


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


def _generate(args):
  from motion_jax.export import check_output
  outputs = [check_output(part) for part in args.out.split(",")]  # before minutes of work
  if args.num < 1:
    raise ValueError(f"got --num {args.num}, expected 1 or more")
  rows = read_prompts(args.prompt)
  import jax
  _cache_compiled_code()
  from motion_jax import model as model_lib
  start = time.time()
  model = model_lib.load(args.model)
  prompts = [prompt for prompt, _ in rows for _ in range(args.num)]
  seeds = [args.seed + i for _ in rows for i in range(args.num)]
  given = [frames for _, frames in rows for _ in range(args.num)]
  if args.seconds is not None or args.frames is not None:
    given = [args.frames if args.frames is not None else args.seconds * model.fps] * len(prompts)
  model.check_words(list(dict.fromkeys(prompts)))
  frames = [count if count is not None else model.natural_frames(prompt) for prompt, count in zip(prompts, given)]
  print(f"{model.id}: {model.num_params / 1e6:.1f} M parameters on {jax.default_backend()}; {len(prompts)} motion(s) "
        f"of {min(frames) / model.fps:.1f} to {max(frames) / model.fps:.1f} s, schedule {args.schedule}, "
        f"guidance {args.guidance or model.config.sampler.guidance_scale:g}, seed {args.seed}")
  motions = model.generate(prompts, frames, seeds=seeds, guidance_scale=args.guidance, schedule=args.schedule,
                           num_steps=args.steps, polish=not args.raw)
  print(f"made in {time.time() - start:.1f} s")
  from motion_jax import export
  clips = [motion.replace(id=f"{pathlib.Path(outputs[0]).stem}_{i}") for i, motion in enumerate(motions)]
  written = [path for out in outputs for path in export.save(clips if len(clips) > 1 else clips[0], out)]
  _tell_files(written)
  if model.license:
    print(model.license)


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


def _models(args):
  from motion_jax import model as model_lib
  for name in model_lib.pretrained_names():
    print(f"{name}\t{model_lib.PRETRAINED / name / 'README.md'}")


if __name__ == "__main__":
  sys.exit(main())
