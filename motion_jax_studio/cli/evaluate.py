"""motion-jax evaluate: judge models with a named protocol."""
import os
import sys

from motion_jax.utils import stopping
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import GUIDANCE, SEEDS, NumberError, is_number, real, whole


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  evaluate = commands.add_parser(
      "evaluate", help="evaluate models on a data set with the papers' metrics",
      description="Evaluates trained models with a named protocol: real data first, then each model. Writes "
                  "results.json, tables.md and tables.tex.")
  add = evaluate.add_argument
  add("--model", dest="runs", action="append", default=[], metavar="MODEL", help="a run folder or a shipped "
      "model; repeatable")
  add("--data", dest="folders", action="extend", nargs="+", default=[], metavar="DIR", help="data folders; several "
      "form one test set. Files of timelines (mtt) or of FlowMDM's multi-prompt sequences (.json: long-horizon, babel) "
      "follow the folder")
  add("--protocol", help="evaluation protocol (default: by data and first model); docs/evaluation.md lists them")
  add("--evaluator", help="folder or name of the evaluator (default: the protocol's)")
  add("--clip-evaluator", help="folder or name of the CLIP-type evaluator, or none")
  add("--replications", type=whole(1, 1000), help="number of repetitions with new random draws (default: the "
      "protocol's, 10 or 20)")
  add("--seed", type=whole(*SEEDS), help="random seed of all draws (default: the protocol's)")
  add("--out", help="folder for results (default: eval/PROTOCOL in the run folder)")
  add("--samples", help="folder that keeps the generated motions, to share them between evaluations")
  add("--guidance-scale", dest="guidance_scales", type=real(*GUIDANCE), nargs="+", action="extend", default=[],
      help="classifier-free guidance scales; one table row per scale")
  add("--sampling", nargs="+", action="extend", default=[], metavar="KEY=VALUE", help="sampling choices "
      "for all models, such as schedule=ar num_steps=20; docs/sampling.md lists them")
  add("--vary", nargs="+", action="extend", default=[], metavar="KEY=VALUE[,..]", help="sampling choices to compare, "
      "one table row each, such as schedule=fss schedule=ar num_steps=20,lag=1")
  add("--motions", action="append", default=[], metavar="NAME=DIR", help="folder of motions from another program; one "
      "table row each; repeatable")
  add("--as-given", action="store_true", help="evaluate motions of --motions with their own bones and floor (default: "
      "retarget those that differ, as for real motions)")
  add("--export-prompts", metavar="DIR", help="write the prompts and lengths that another program has to generate to "
      "DIR/prompts.jsonl, and stop")
  add("--limit", type=whole(1, 1_000_000), help="evaluate at most this many samples, for a quick trial")
  add("--controls", action="store_true", help="also evaluate damaged real motions to verify that the metrics notice; "
      "exit status 1 if one does not")
  add("--no-multimodality", dest="multimodality", action="store_false", help="skip the multimodality metric, which "
      "takes most of the time")
  add("--force", action="store_true", help="continue even if real motions fail the sanity checks")
  add("--allow-shared", action="store_true", help="include test clips that are also in the training split, and list "
      "them in the provenance")
  add("--recompute", action="store_true", help="compute the tables from stored samples; generate nothing "
      "(reconstructions are computed again)")
  add("--weights", choices=("ema", "model"), default="ema", help="weights of a run: ema, the moving average, or model, "
      "the weights of the last step")
  add("--report", metavar="OUT", help="folder for one HTML page of tables, curves and motions")
  add("--compare-with", nargs="+", action="extend", default=[], metavar="DIR", help="folders of earlier results to "
      "show on the same page; without --data the page has these alone")
  add("--paper-tables", nargs="*", metavar="TABLE", help="print the papers' tables and stop: one, such as cmdm 4 or "
      "cdamd 6, or all")
  add("--devices", type=whole(1, 4096), help="number of devices; affects the time, not the results")
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
      raise InputError(f"got --motions {name}{equals}{folder}, expected NAME=DIR with unique names other than "
                       "real and shuffled")
  return [(name, folder) for name, _, folder in pairs]


def printed(tables, name):
  """The papers' tables in Markdown: one, name [system, table], or all. A number selects all parts of its table: cmdm 3
  is 3-humanml3d and 3-snapmogen."""
  if len(name) not in (0, 2):
    raise InputError(f"got --paper-tables {' '.join(name)}, expected a paper and a table such as cmdm 4, or nothing "
                     "for all")
  keys = tables.paper_tables()
  if name:
    system, number = name[0].lower(), name[1]
    keys = [key for key in keys if key[0] == system and key[1].partition("-")[0] == number] or [(system, number)]
  return "\n".join(tables.markdown(tables.printed_table(*key)) for key in keys)


def _evaluate(args):
  if args.paper_tables is not None:
    from motion_jax.evaluation.report import tables
    print(printed(tables, args.paper_tables))
    return 0
  if not args.folders and not args.compare_with:
    raise InputError("got no --data; give --data FOLDER, or --report with the folders of earlier results as "
                     "--compare-with")
  if args.compare_with and not args.report:
    raise InputError("got --compare-with without --report; give --report OUT, the folder of the page")
  with stopping.at_once(args.program, "stopped; the same command continues with the samples that exist"):
    return _judge(args) if args.folders else _page(args, args.compare_with)


def _page(args, folders):
  from motion_jax.evaluation.report import page
  print(f"wrote {page.write_folders(folders, args.report)}")
  return 0


def _judge(args):
  sampling, vary = options_of(args.sampling), [options_of(choices.split(",")) for choices in args.vary]
  motions = pairs_of(args.motions)
  # Must be set before numpy is loaded. Many small matrices are factored; with several threads, which wait for a busy
  # core, that takes up to a hundred times longer than with one.
  os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
  import jax

  from motion_jax.evaluation import run
  from motion_jax.evaluation.report import page
  from motion_jax.evaluation.request import Request
  from motion_jax.evaluation.result import FILE
  devices = jax.local_devices()
  if args.devices and args.devices > len(devices):
    raise InputError(f"got --devices {args.devices}, there are {len(devices)}")
  given = {name: value for name, value in vars(args).items() if name in Request.__dataclass_fields__}
  request = Request(**given | {"sampling": sampling, "vary": vary, "motions": motions,
                               "devices": devices[:args.devices]})
  if args.export_prompts:
    print("wrote", run.export_prompts(request, args.export_prompts))
    return 0
  result = run.evaluate(request)
  print(run.TABLES["tables.md"](result))
  written = [result.folder / name for name in (FILE, *run.TABLES)]
  if args.report:
    written.append(page.write_folders([result.folder, *args.compare_with], args.report))
  print("wrote " + ", ".join(map(str, written)))
  failures = result.controls["failures"] if result.controls else []
  for failure in failures:
    print(f"{args.program}: control: {failure}", file=sys.stderr)
  return 1 if failures else 0
