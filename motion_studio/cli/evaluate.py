"""motion-jax evaluate: models judged by a named protocol."""
import os
import sys

from motion_jax.utils import stopping
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import GUIDANCE, SEEDS, NumberError, is_number, real, whole


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  evaluate = commands.add_parser(
      "evaluate", help="models and data in, tables of the papers' metrics out",
      description="Judges trained models by a named protocol: real data first, then each model; writes results.json, "
                  "tables.md and tables.tex.")
  add = evaluate.add_argument
  add("--model", action="append", default=[], help="a run folder or the name of a model that ships; may be repeated")
  add("--data", action="append", nargs="+", metavar="DIR", help="data folders; several make one test set. A file of "
      "timelines (mtt) or of FlowMDM's multi-prompt sequences (.json: long-horizon, babel) goes with them")
  add("--protocol", help="by default the one that fits the data and the first model; docs/evaluation.md lists them")
  add("--evaluator", help="folder or name of the evaluator; by default the protocol's")
  add("--clip-evaluator", help="folder or name of the CLIP-type evaluator, or none")
  add("--replications", type=whole(1, 1000), help="how often all is drawn and judged anew; by default the "
      "protocol's, 10 or 20")
  add("--seed", type=whole(*SEEDS), help="seed of all draws; by default the protocol's")
  add("--out", help="folder for results; by default eval/PROTOCOL in the run folder")
  add("--samples", help="folder where motions are kept, for several evaluations to share")
  add("--guidance", type=real(*GUIDANCE), nargs="+", action="extend", default=[],
      help="guidance scales, a row for each")
  add("--sampling", nargs="+", action="extend", default=[], metavar="KEY=VALUE", help="choices of sampling "
      "for all models, such as schedule=ar num_steps=20; docs/sampling.md lists them")
  add("--vary", nargs="+", action="extend", default=[], metavar="KEY=VALUE[,..]", help="choices of sampling, a row for "
      "each, such as schedule=fss schedule=ar num_steps=20,lag=1")
  add("--motions", action="append", default=[], metavar="NAME=DIR", help="motions that another program made, a row for "
      "each folder; may be repeated")
  add("--ask", metavar="DIR", help="judge nothing; write what another program has to make into DIR/prompts.jsonl")
  add("--limit", type=whole(1, 1_000_000), help="use fewer samples, for a trial")
  add("--controls", action="store_true", help="also damage real motions and see that the metrics notice; the "
      "exit status is 1 where one does not")
  add("--no-multimodality", action="store_true", help="leave out the metric that takes most of the time")
  add("--force", action="store_true", help="go on although real motions fail the sanity checks")
  add("--allow-shared", action="store_true", help="judge test clips that stand in the training split, too, and name "
      "them in the provenance")
  add("--recompute", action="store_true", help="compute the tables from samples that are on disk and generate nothing "
      "(reconstructions are made anew)")
  add("--weights", choices=("ema", "model"), default="ema", help="which weights of a run: ema, their running average, "
      "or model, the last ones")
  add("--report", metavar="OUT", help="folder for one HTML page of tables, curves and motions")
  add("--beside", nargs="+", action="extend", default=[], metavar="DIR", help="folders of earlier results, shown on "
      "the same page; without --data the page is of these alone")
  add("--printed", nargs="*", metavar="TABLE", help="judge nothing, print what the papers' tables print: one, such as "
      "cmdm 4 or cdamd 6, or all")
  add("--devices", type=whole(1, 4096), help="how many devices to use; it changes the time, not the numbers")
  evaluate.set_defaults(run=_evaluate)


def value_of(text):
  """A value of --sampling: a number, true or false, or a word."""
  for read in (whole(), real()):
    try:
      return read(text)
    except NumberError as error:
      wrong = error
  if is_number(text):
    raise InputError(f"in a choice of sampling: {wrong}")
  return {"true": True, "false": False}.get(text.lower(), text)


def options_of(texts):
  """{KEY: value} of texts KEY=VALUE."""
  pairs = [text.partition("=") for text in texts]
  wrong = [key for key, equals, _ in pairs if not equals]
  if wrong:
    raise InputError(f"got the choice of sampling {wrong[0]!r}, expected KEY=VALUE")
  return {key: value_of(value) for key, _, value in pairs}


def pairs_of(texts):
  """[(NAME, DIR)] of texts NAME=DIR."""
  pairs = [text.partition("=") for text in texts]
  names = [name for name, _, _ in pairs]
  for name, equals, folder in pairs:
    if not (name and equals and folder) or names.count(name) > 1 or name in ("real", "shuffled"):
      raise InputError(f"got --motions {name}{equals}{folder}, expected NAME=DIR, each with a name of its own other "
                       "than real and shuffled")
  return [(name, folder) for name, _, folder in pairs]


def printed(tables, name):
  """What the papers' tables print, as Markdown: of one, name [system, table], or of all. A number stands for all parts
  of its table: cmdm 3 for 3-humanml3d and 3-snapmogen."""
  if len(name) not in (0, 2):
    raise InputError(f"got --printed {' '.join(name)}, expected a paper and a table such as cmdm 4, or nothing for all")
  keys = tables.paper_tables()
  if name:
    system, number = name[0].lower(), name[1]
    keys = [key for key in keys if key[0] == system and key[1].partition("-")[0] == number] or [(system, number)]
  return "\n".join(tables.markdown(tables.printed_table(*key)) for key in keys)


def _evaluate(args):
  if args.printed is not None:
    from motion_jax.evaluation.report import tables
    print(printed(tables, args.printed))
    return 0
  if not args.data and not args.beside:
    raise InputError("give --data, or with --report the folders of earlier results as --beside")
  if args.beside and not args.report:
    raise InputError("--beside is for the page; give --report OUT, too")
  with stopping.at_once(args.program, "stopped; the same command goes on with the samples that are made"):
    return _judge(args) if args.data else _page(args, args.beside)


def _page(args, folders):
  from motion_jax.evaluation.report import page
  print(f"wrote {page.write_folders(folders, args.report)}")
  return 0


def _judge(args):
  sampling, vary = options_of(args.sampling), [options_of(one.split(",")) for one in args.vary]
  motions = pairs_of(args.motions)
  # Before numpy is loaded: small matrices are factored many times, by several threads that wait for a busy core up to a
  # hundred times slower than by one.
  os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
  import jax

  from motion_jax.evaluation import run
  from motion_jax.evaluation.report import page
  from motion_jax.evaluation.result import FILE
  devices = jax.local_devices()
  if args.devices and args.devices > len(devices):
    raise InputError(f"got --devices {args.devices}, there are {len(devices)}")
  folders = [folder for some in args.data for folder in some]
  if args.ask:
    print("wrote", run.ask(folders, args.ask, args.protocol, evaluator=args.evaluator, replications=args.replications,
                           seed=args.seed, limit=args.limit, multimodality=not args.no_multimodality,
                           allow_shared=args.allow_shared))
    return 0
  result = run.evaluate(
      args.model, folders, args.protocol, evaluator=args.evaluator, clip_evaluator=args.clip_evaluator, out=args.out,
      replications=args.replications, seed=args.seed, guidance=args.guidance, sampling=sampling, vary=vary,
      limit=args.limit, controls=args.controls, multimodality=not args.no_multimodality, force=args.force,
      only_read=args.recompute, raw=args.weights == "model", devices=devices[:args.devices], samples=args.samples,
      motions=motions, allow_shared=args.allow_shared)
  print(run.TABLES["tables.md"](result))
  written = [result.folder / name for name in (FILE, *run.TABLES)]
  if args.report:
    written.append(page.write_folders([result.folder, *args.beside], args.report))
  print("wrote " + ", ".join(map(str, written)))
  failures = result.controls["failures"] if result.controls else []
  for failure in failures:
    print(f"{args.program}: control: {failure}", file=sys.stderr)
  return 1 if failures else 0
