"""motion-jax data: build, encode and check training data."""
import pathlib
import shlex
import sys

from motion_jax.utils.install import pip_install
from motion_jax.utils.numerals import FRAME_RATES, real, whole
from motion_jax_studio.cli.configs import add_config, config_of
from motion_jax_studio.cli.reading import add_mapping


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  data = commands.add_parser("data", help="build and check training data").add_subparsers(
      dest="data_command", required=True, metavar="COMMAND")
  build = data.add_parser("build", help="convert an archive or a folder of BVH or ASF/AMC files to HumanML3D's layout")
  build.add_argument("source", help="folder to read: an archive, or BVH or ASF/AMC files, also in sub-folders")
  build.add_argument("out", help="folder to write")
  build.add_argument("--captions", help="CSV, TSV or JSONL: file, caption[, start, end, split]")
  add_mapping(build)
  build.add_argument("--mode", choices=("corrected", "benchmark"), default="corrected",
                     help="corrected features, or with the errors of the published benchmark")
  build.add_argument("--fps", type=real(*FRAME_RATES), metavar="F",
                     help="frame rate of the capture files, overrides the one in the files (.amc has none: 120)")
  build.add_argument("--resample", type=real(*FRAME_RATES), metavar="F", help="frame rate of the new folder (20)")
  build.add_argument("--no-mirror", action="store_true", help="do not add mirrored copies")
  build.add_argument("--overwrite", action="store_true", help="replace an existing folder")
  build.set_defaults(run=_build)
  records = data.add_parser("records", help="convert a data folder to array_record files, for data larger than memory",
                            description="Writes the features of a data folder as array_record files, which training "
                            f"reads one clip at a time; requires {pip_install('data')}.")
  records.add_argument("folder", nargs="+", help="data folders of any supported data set")
  records.add_argument("--out", required=True, metavar="FOLDER", help="folder to write")
  records.add_argument("--layout", default="full", help="feature layout: full, essential, coordinates, ... (full)")
  records.add_argument("--mode", choices=("corrected", "benchmark"), default="corrected",
                       help="corrected features, or with the errors of the published benchmark")
  records.add_argument("--no-mirror", action="store_true", help="do not add mirrored copies")
  records.add_argument("--overwrite", action="store_true", help="replace an existing folder")
  records.set_defaults(run=_records)
  encode = data.add_parser("encode", help="encode training data to latents and text embeddings once",
                           description="Writes a store of a config's training inputs: the latents of every cut and "
                           "the text embeddings of every caption. Training with "
                           "--config.data.store=FOLDER does not run these encoders.")
  add_config(encode)
  encode.add_argument("--out", required=True, metavar="FOLDER", help="folder to write the store to")
  encode.set_defaults(run=_encode)
  describe = data.add_parser("describe", help="write captions of motions from their kinematics",
                             description="Describes each motion of a folder, measured on joints: walking direction, "
                             "angle of turns, the foot that kicks, the hand that waves, repetitions. Uncertain "
                             "actions are left out, so that a motion may have no caption.")
  describe.add_argument("folder", help="BVH or ASF/AMC files, also in sub-folders, a single file, or a data folder")
  describe.add_argument("--out", metavar="FILE.csv", help="write the table that `data build --captions` reads")
  describe.add_argument("--fps", type=real(*FRAME_RATES), metavar="F",
                        help="frame rate of the capture files, overrides the one in the files (.amc has none: 120)")
  add_mapping(describe)
  describe.set_defaults(run=_describe)
  split = data.add_parser("split", help="make a test split that training has not seen",
                          description="Writes copies of archives with another split. By captions, test rows keep the "
                          "sentences that no train row has, mirrored or with another subject; by subjects, whole "
                          "subjects (or actors, styles, clips) are assigned to splits first, for models that are "
                          "trained on it.")
  split.add_argument("folder", nargs="+", help="archives: folders with motions.npz and captions.jsonl")
  split.add_argument("--out", required=True, metavar="FOLDER", help="folder to write, with a folder for each archive")
  split.add_argument("--by", choices=("captions", "subjects"), default="captions",
                     help="split so that training has not seen the captions, or the subjects, of the test (captions)")
  split.add_argument("--overwrite", action="store_true", help="replace existing folders")
  split.set_defaults(run=_split)
  compose = data.add_parser("compose", help="make training clips with a model: sampled, checked, the failures left out",
                            description="Samples prompts by the whole pipeline and keeps the motions that meet all "
                            "requirements of their prompts, with sound bones and feet, as an archive. A run that was "
                            "interrupted continues; the same choices give the same archive.")
  compose.add_argument("out", help="folder to write, or to continue")
  compose.add_argument("--model", default="cmdm-small", help="a shipped model or a run folder (cmdm-small)")
  compose.add_argument("--number", type=whole(1, 1_000_000), default=8000, metavar="N", help="number of prompts (8000)")
  compose.add_argument("--seed", type=whole(0, 2**31 - 1), default=0, metavar="N",
                       help="seed of prompts and motions (0)")
  compose.add_argument("--sentences", metavar="FILE", default="", help="people's sentences to use with those of the "
                       "grammar: a .jsonl with text and split, a .tsv, or one a line")
  compose.add_argument("--apart", metavar="FILE", nargs="+", default=(), help="evaluation sentences: prompts within "
                       "three words of one are left out")
  compose.add_argument("--attempts", type=whole(1, 100), default=3, metavar="N", help="samples per prompt at most (3)")
  compose.add_argument("--group", type=whole(2, 1000), default=0, metavar="N",
                       help="instead: sample each prompt N times in one pass, and keep all with their rewards, for "
                       "--config cmdm_scored")
  compose.set_defaults(run=_compose)
  doctor = data.add_parser("doctor", help="check a data folder and suggest fixes")
  doctor.add_argument("folder", help="a data folder of any supported data set")
  doctor.set_defaults(run=_doctor)


def _build(args):
  from motion_jax.data import build
  faults = []
  print(build.build(args.source, args.out, captions=args.captions, mapping=args.mapping, mode=args.mode,
                    mirror=not args.no_mirror, fps=args.resample, source_fps=args.fps,
                    overwrite=args.overwrite, faults=faults))
  print(f"check it: motion-jax data doctor {shlex.quote(args.out)}")
  return _left_out(faults)


def _split(args):
  from motion_jax.data import split
  print(split.split(args.folder, args.out, args.by, args.overwrite))
  print("judge a model on it: motion-jax evaluate --model cmdm-small --data "
        + " ".join(str(pathlib.Path(args.out) / pathlib.Path(folder).name) for folder in args.folder)
        if args.by == "captions" else
        "train on it before you judge a model on it: those that ship have seen all subjects")


def _left_out(faults):
  """Prints the errors of files that were left out; returns the exit status."""
  for name, what in faults:
    print(f"not read: {name}: {what}", file=sys.stderr)
  return 1 if faults else 0


def _records(args):
  from motion_jax.data import records
  print(records.write(args.folder, args.out, args.layout, args.mode, not args.no_mirror, args.overwrite))
  print(f"train on it: motion-jax train --data {shlex.quote(args.out)} ...")


def _encode(args):
  config = config_of(args)
  from motion_jax import fit
  from motion_jax.utils import cache
  cache.keep_in_user_cache()
  print(fit.encode(config, args.out))
  print(f"train on it: motion-jax train --config {args.config} ... --config.data.store={shlex.quote(args.out)}")


def _describe(args):
  from motion_jax.data import describe_folders, merged_warnings
  if args.out:
    describe_folders.check_table(args.out)
  rows, faults = [], []
  with merged_warnings.merged():
    for name, start, end, sentences in describe_folders.describe_folder(args.folder, args.fps, args.mapping, faults):
      rows.append((name, start, end, sentences))
      print(f"{name} ({start:.1f} to {end:.1f} s): {sentences[0] if sentences else '-'}", flush=True)
  silent = sum(not sentences for *_, sentences in rows)
  print(f"{len(rows)} motions, {silent} of them without a certain action")
  if args.out:
    print(f"wrote {describe_folders.write_table(rows, args.out)} captions to {args.out}\n"
          f"next: motion-jax data build {shlex.quote(args.folder)} FOLDER --captions {shlex.quote(args.out)}")
  return _left_out(faults)


def _compose(args):
  from motion_jax.utils import cache
  from motion_jax_studio.composing.compose import compose
  cache.keep_in_user_cache()
  print(compose(args.out, args.model, args.number, args.seed, args.sentences, args.apart, args.attempts,
                args.group))
  print(f"train on it: motion-jax train --data {shlex.quote(args.out)} "
        + ("--config cmdm_scored:small ..." if args.group else "FURTHER_ARCHIVES ..."))


def _doctor(args):
  from motion_jax.data import doctor, store
  if (pathlib.Path(args.folder) / store.ABOUT).is_file():
    damaged = store.Store(args.folder).damage()
    print(f"{args.folder}: a store of latents and text embeddings; "
          + (f"damaged: {', '.join(damaged)}: write it again with motion-jax data encode" if damaged else "whole"))
    return 1 if damaged else 0
  report = doctor.examine(args.folder)
  print(doctor.format_report(report))
  return 0 if report.ok else 1
