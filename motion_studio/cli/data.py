"""motion-jax data: training data made, encoded and checked."""
import pathlib
import sys

from motion_jax.utils.install import pip_install
from motion_jax.utils.numerals import FRAME_RATES, real
from motion_studio.cli import shared


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  data = commands.add_parser("data", help="make and check training data").add_subparsers(
      dest="data_command", required=True, metavar="COMMAND")
  build = data.add_parser("build", help="an archive or a folder of BVH or ASF/AMC files -> a HumanML3D-layout folder")
  build.add_argument("source", help="folder to read: an archive, or BVH or ASF/AMC files, in sub-folders too")
  build.add_argument("out", help="folder to write")
  build.add_argument("--captions", help="CSV, TSV or JSONL: file, caption[, start, end, split]")
  shared.add_mapping(build)
  build.add_argument("--mode", choices=("corrected", "benchmark"), default="corrected",
                     help="features as they should be, or with the slips of the published benchmark")
  build.add_argument("--fps", type=real(*FRAME_RATES), metavar="F",
                     help="the captured files' frames are F a second, whatever they state (.amc state nothing: 120)")
  build.add_argument("--resample", type=real(*FRAME_RATES), metavar="F", help="frames a second of the new folder (20)")
  build.add_argument("--no-mirror", action="store_true", help="leave mirrored copies out")
  build.add_argument("--overwrite", action="store_true", help="replace the folder if it is there already")
  build.set_defaults(run=_build)
  records = data.add_parser("records", help="a data folder -> files of tensorflow-datasets, for data beyond memory",
                            description="Writes the features of a data folder as array_record files, which training "
                            f"reads one clip at a time; needs {pip_install('data')}.")
  records.add_argument("folder", nargs="+", help="a data folder of any data set that is known, or several")
  records.add_argument("--out", required=True, metavar="FOLDER", help="folder to write")
  records.add_argument("--layout", default="full", help="of the features: full, essential, coordinates, ... (full)")
  records.add_argument("--mode", choices=("corrected", "benchmark"), default="corrected",
                       help="features as they should be, or with the slips of the published benchmark")
  records.add_argument("--no-mirror", action="store_true", help="leave mirrored copies out")
  records.add_argument("--overwrite", action="store_true", help="replace the folder if it is there already")
  records.set_defaults(run=_records)
  encode = data.add_parser("encode", help="latents and words of training data, made once and kept",
                           description="Writes a store of what a config trains on: the latents of every cut that may "
                           "be drawn and the features of every caption. Training that names it, "
                           "--config.data.store=FOLDER, does not run these encoders.")
  shared.add_config(encode)
  encode.add_argument("--out", required=True, metavar="FOLDER", help="the store, a folder to write")
  encode.set_defaults(run=_encode)
  describe = data.add_parser("describe", help="sentences about what motions do, by their kinematics",
                             description="Says what each motion of a folder does, measured on its joints: where it "
                             "walks, how far it turns, which foot kicks, which hand waves and how often. What is in "
                             "doubt is not said, so a motion may have no sentence.")
  describe.add_argument("folder", help="BVH or ASF/AMC files, in sub-folders too, one such file, or a data folder")
  describe.add_argument("--out", metavar="FILE.csv", help="write the table that `data build --captions` reads")
  describe.add_argument("--fps", type=real(*FRAME_RATES), metavar="F",
                        help="the captured files' frames are F a second, whatever they state (.amc state nothing: 120)")
  shared.add_mapping(describe)
  describe.set_defaults(run=_describe)
  doctor = data.add_parser("doctor", help="what is wrong with a data folder, and what to do")
  doctor.add_argument("folder", help="a data folder of any data set that is known")
  doctor.set_defaults(run=_doctor)


def _build(args):
  from motion_jax.data import build
  faults = []
  print(build.build(args.source, args.out, captions=args.captions, mapping=args.mapping, mode=args.mode,
                    mirror=not args.no_mirror, fps=args.resample, source_fps=args.fps,
                    overwrite=args.overwrite, faults=faults))
  print(f"check it: motion-jax data doctor {args.out}")
  return _left_out(faults)


def _left_out(faults):
  """Prints what is wrong with files that were left out; the status of a command that did so is 1."""
  for name, what in faults:
    print(f"not read: {name}: {what}", file=sys.stderr)
  return 1 if faults else 0


def _records(args):
  from motion_jax.data import records
  print(records.write(args.folder, args.out, args.layout, args.mode, not args.no_mirror, args.overwrite))
  print(f"train on it: motion-jax train --data {args.out} ...")


def _encode(args):
  config = shared.config_of(args)
  from motion_jax import fit
  shared.cache_compiled_code()
  print(fit.encode(config, args.out))
  print(f"train on it: motion-jax train --config {args.config} ... --config.data.store={args.out}")


def _describe(args):
  from motion_jax.data import describe_folders
  from motion_jax.utils import notes
  if args.out:
    describe_folders.check_table(args.out)
  rows, faults = [], []
  with notes.merged():
    for name, start, end, sentences in describe_folders.describe_folder(args.folder, args.fps, args.mapping, faults):
      rows.append((name, start, end, sentences))
      print(f"{name} ({start:.1f} to {end:.1f} s): {sentences[0] if sentences else '-'}", flush=True)
  silent = sum(not sentences for *_, sentences in rows)
  print(f"{len(rows)} motions, {silent} of them with nothing that is sure")
  if args.out:
    print(f"wrote {describe_folders.write_table(rows, args.out)} captions to {args.out}\n"
          f"next: motion-jax data build {args.folder} FOLDER --captions {args.out}")
  return _left_out(faults)


def _doctor(args):
  from motion_jax.data import doctor, store
  if (pathlib.Path(args.folder) / store.ABOUT).is_file():
    damaged = store.Store(args.folder).damage()
    print(f"{args.folder}: a store of latents and words; "
          + (f"damaged: {', '.join(damaged)}: make it again by motion-jax data encode" if damaged else "whole"))
    return 1 if damaged else 0
  report = doctor.examine(args.folder)
  print(doctor.format_report(report))
  return 0 if report.ok else 1
