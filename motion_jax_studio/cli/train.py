"""motion-jax train: trains a stage from a config into a run folder."""
import pathlib
import sys

from motion_jax.utils import config_files
from motion_jax.utils.numerals import NumberError, real, shortened, whole
from motion_jax_studio.cli.configs import add_config, config_of


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  train = commands.add_parser(
      "train", help="train a stage from a config",
      description="Trains one stage. --config.SECTION.FIELD=VALUE sets any field of the config, such as "
                  "--config.data.batch_size=32.",
      epilog=f"Shipped configs: {', '.join(config_files.names())}; recipes of the shipped models: "
             f"{', '.join(config_files.recipes())}. Sizes: tiny (two steps), mini, laptop, small; "
             "default: the paper's. docs/configs.md lists them all.")
  add = train.add_argument
  add_config(train)
  add("--workdir", required=True, metavar="FOLDER", help="run folder; created if missing")
  add("--resume", nargs="?", const="yes", choices=("yes", "no", "auto"),
      help="resume the run in the folder exactly where it stopped; --resume=auto starts a run if there is none "
           "(default for several processes)")
  add("--no-resume", action="store_const", const="no", dest="resume", help="start a run in an empty folder (default)")
  add("--allow-changes", action="store_true",
      help="resume although the config or the data have changed")
  add("--max-seconds", type=real(above=0, high=1e9, unit="seconds"), metavar="S",
      help="save and stop after this time")
  add("--cpu-seconds", type=real(above=0, high=1e9, unit="processor seconds"), metavar="S",
      help="save and stop after this much processor time of training steps, those before a resume included "
           "(train.cpu_seconds)")
  add("--profile-steps", type=_steps, metavar="A:B",
      help="profile steps A to B with JAX's profiler into profile/ of the run folder, such as 10:20; step 1 "
           "includes compilation")
  add("--coordinator", metavar="HOST:PORT",
      help="address of the first of several processes; default: detected under Slurm, Open MPI and on TPU slices; "
           "auto: detection must succeed (docs/pods.md)")
  add("--process-id", type=whole(0, 1_000_000), metavar="I", help="index of this process, from 0")
  add("--num-processes", type=whole(1, 1_000_000), metavar="N", help="number of processes")
  add("--simulate-devices", type=whole(1, 1024), metavar="N", default=0,
      help="train on this many CPU devices that share the cores, to test multi-device training")
  train.set_defaults(run=_train, overrides=[])


def _steps(text):
  first, colon, last = text.partition(":")
  try:
    bounds = tuple(whole(1, 10**9)(side) for side in (first, last))
  except NumberError as error:
    raise NumberError(f"got {shortened(text)!r}, expected steps A:B such as 10:20" +
                      (f" ({error})" if colon else "")) from None
  if bounds[0] > bounds[1]:
    raise NumberError(f"got {text!r}, expected steps A:B with A no later than B, such as 10:20")
  return bounds


def _train(args):
  if args.cpu_seconds:
    args.overrides = [*args.overrides, f"--config.train.cpu_seconds={args.cpu_seconds}"]
  from motion_jax.utils import exit_status, stopping
  with stopping.Stop(args.program) as stop:
    _run(args, stop)
  if stop.status == exit_status.PREEMPTED and not stop.quiet:
    print(f"{args.program}: preempted, resumable", file=sys.stderr)
  return stop.status


def _run(args, stop):
  config = config_of(args)

  import jax
  from absl import logging

  from motion_jax import fit
  from motion_jax.training import distributed
  from motion_jax.utils import cache
  logging.set_verbosity(logging.WARNING)  # orbax logs every step of a save
  distributed.start(args.coordinator, args.process_id, args.num_processes, args.simulate_devices)
  stop.quiet = not distributed.is_first()
  stop.nothing_to_lose(distributed.end_together)
  cache.keep_in_user_cache()  # a resumed run does not compile again
  resume = {"yes": True, "no": False, "auto": "auto", None: "auto" if jax.process_count() > 1 else False}[args.resume]
  with distributed.as_one():
    fit.run(config, pathlib.Path(args.workdir), resume, args.max_seconds, stop, args.allow_changes,
            args.profile_steps)
