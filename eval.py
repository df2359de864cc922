"""Judges runs by a protocol: python eval.py --run runs/x --data DIR [--protocol NAME] [--controls] [--report OUT]"""
import pathlib
import sys

from motion_jax.cli.parser import Parser
from motion_jax.inputs.numerals import GUIDANCE, SEEDS, NumberError, is_number, real, whole
from motion_jax.runtime import stopping


def parse(argv=None):
  parser = Parser(prog="eval.py", description="Judges trained models by a named protocol: real data first, then each "
                                   "run; writes results.json, tables.md and tables.tex.")
  add = parser.add_argument
  add("--run", action="append", default=[], help="run folder, or a model that ships (cmdm-small); may be repeated")
  add("--data", action="append", nargs="+", help="data folder; several make one test set. A file of timelines (mtt) "
      "or of FlowMDM's stories (.json: long-horizon, babel) goes with them")
  add("--protocol", help="by default the one that fits the data and the first run; see evaluation/protocols.py")
  add("--evaluator", help="folder or name of the evaluator; by default the protocol's")
  add("--clip-evaluator", help="of the CLIP-type evaluator, or none")
  add("--repeats", type=whole(1, 1000), help="by default the protocol's, 10 or 20")
  add("--seed", type=whole(*SEEDS), help="of all draws; by default the protocol's")
  add("--out", help="folder for results; by default eval/PROTOCOL in the run folder")
  add("--samples", help="folder where motions are kept, for several evaluations to share")
  add("--guidance", type=real(*GUIDANCE), nargs="+", action="extend", default=[],
      help="guidance scales, a row for each")
  add("--sampling", nargs="+", action="extend", default=[], metavar="KEY=VALUE", help="such as schedule=ar "
      "num_steps=20, rounds=10")
  add("--vary", nargs="+", action="extend", default=[], metavar="KEY=VALUE[,..]", help="choices of sampling, a row for "
      "each, such as schedule=fss schedule=ar num_steps=20,lag=1")
  add("--motions", action="append", default=[], metavar="NAME=DIR", help="motions that another program made, a row for "
      "each folder; may be repeated")
  add("--ask", metavar="DIR", help="judge nothing, write what such a program has to make into DIR/prompts.jsonl")
  add("--limit", type=whole(1, 1_000_000), help="use fewer samples, for a trial")
  add("--controls", action="store_true", help="also damage real motions and see that the metrics notice; the "
      "exit status is 1 where one does not")
  add("--no-multimodality", action="store_true", help="leave out the metric that takes most of the time")
  add("--force", action="store_true", help="go on though real data does not look right")
  add("--allow-shared", action="store_true", help="judge test clips that train has, too, and name them in the record")
  add("--recompute", action="store_true", help="only from samples that exist: nothing is generated (reconstructions "
      "are made anew)")
  add("--raw", action="store_true", help="the last weights of a run, not the average kept beside them")
  add("--report", metavar="OUT", help="folder for one HTML page of tables, curves and motions")
  add("--beside", nargs="+", action="extend", default=[], metavar="DIR", help="folders of earlier results, shown on "
      "the same page; without --data the page is of these alone")
  add("--printed", nargs="*", metavar="TABLE", help="judge nothing, print what the papers' tables print: one, such as "
      "cmdm 4 or cdamd 6, or all")
  add("--devices", type=whole(1, 4096), help="use so many devices; they change the time, not the numbers")
  args = parser.parse_args(argv)
  if args.printed is not None:
    return args
  if not args.data and not args.beside:
    parser.error("give --data, or with --report the folders of earlier results as --beside")
  if args.beside and not args.report:
    parser.error("--beside is for the page; give --report OUT, too")
  return args


def value_of(text):
  """A value of --sampling: a number, true or false, or a word."""
  for read in (whole(), real()):
    try:
      return read(text)
    except NumberError as error:
      wrong = error
  if is_number(text):
    raise ValueError(f"in a choice of sampling: {wrong}")
  return {"true": True, "false": False}.get(text.lower(), text)


def options_of(texts):
  """{KEY: value} of texts KEY=VALUE."""
  pairs = [text.partition("=") for text in texts]
  wrong = [key for key, equals, _ in pairs if not equals]
  if wrong:
    raise ValueError(f"got the choice of sampling {wrong[0]!r}, expected KEY=VALUE")
  return {key: value_of(value) for key, _, value in pairs}


def pairs_of(texts):
  """[(NAME, DIR)] of texts NAME=DIR."""
  pairs = [text.partition("=") for text in texts]
  names = [name for name, _, _ in pairs]
  for name, equals, folder in pairs:
    if not (name and equals and folder) or names.count(name) > 1 or name in ("real", "shuffled"):
      raise ValueError(f"got --motions {name}{equals}{folder}, expected NAME=DIR, each with a name of its own other "
                       "than real and shuffled")
  return [(name, folder) for name, _, folder in pairs]


def printed(tables, name):
  """What the papers' tables print, as Markdown: of one, name [system, table], or of all."""
  if len(name) not in (0, 2):
    raise ValueError(f"got --printed {' '.join(name)}, expected a paper and a table such as cmdm 4, or nothing for all")
  keys = [name] if name else tables.paper_tables()
  return "\n".join(tables.markdown(tables.printed_table(*key)) for key in keys)


def main(argv=None):
  args = parse(argv)
  try:
    sampling, vary = options_of(args.sampling), [options_of(one.split(",")) for one in args.vary]
    motions = pairs_of(args.motions)
  except ValueError as error:
    sys.exit(f"eval.py: {error}")
  import jax

  from motion_jax.evaluation import run
  from motion_jax.evaluation.report import page as report
  from motion_jax.evaluation.report import tables
  if args.printed is not None:
    try:
      print(printed(tables, args.printed))
    except ValueError as error:
      sys.exit(f"eval.py: {error}")
    return
  if not args.data:
    try:
      print(f"wrote {report.write_folders(args.beside, args.report)}")
    except (ValueError, FileNotFoundError) as error:
      sys.exit(f"eval.py: {error}")
    return
  devices = jax.local_devices()
  if args.devices and args.devices > len(devices):
    sys.exit(f"eval.py: got --devices {args.devices}, there are {len(devices)}")
  folders = [folder for some in args.data for folder in some]
  try:
    if args.ask:
      print("wrote", run.ask(folders, args.ask, args.protocol, evaluator=args.evaluator, repeats=args.repeats,
                             seed=args.seed, limit=args.limit, multimodality=not args.no_multimodality,
                             allow_shared=args.allow_shared))
      return
    protocol = run.protocols_lib.get_protocol(args.protocol or run.guess_protocol(args.run, folders))
    out = pathlib.Path(args.out) if args.out else run.default_out(args.run, protocol)
    result = run.evaluate(
        args.run, folders, protocol, evaluator=args.evaluator, clip_evaluator=args.clip_evaluator, out=args.out,
        repeats=args.repeats, seed=args.seed, guidance=args.guidance,
        sampling=sampling, vary=vary, limit=args.limit, controls=args.controls,
        multimodality=not args.no_multimodality, force=args.force, only_read=args.recompute,
        raw=args.raw, devices=devices[:args.devices], samples=args.samples, motions=motions,
        allow_shared=args.allow_shared)
    print(tables.markdown(result))
    written = [out / name for name in ("results.json", "tables.md", "tables.tex", "tables.csv")]
    if args.report:
      written.append(report.write_folders([out, *args.beside], args.report))
  except BrokenPipeError:
    raise
  except (ValueError, OSError, FloatingPointError) as error:
    sys.exit(f"eval.py: {error}")
  print("wrote " + ", ".join(map(str, written)))
  failures = (result["controls"] or {}).get("failures", [])
  if failures:
    sys.exit("\n".join(f"eval.py: control: {failure}" for failure in failures))


if __name__ == "__main__":
  with stopping.at_once("eval.py", "stopped; the same command goes on with the samples that are made"):
    try:
      main()
      status = stopping.flush()
    except BrokenPipeError:
      status = stopping.pipe_closed()
    sys.exit(status)
