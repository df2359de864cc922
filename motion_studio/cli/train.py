"""motion-jax train: a stage of a paper, from a config to a run folder."""
import pathlib
import sys

from motion_jax.utils import config_files
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import NumberError, real, shortened, whole
from motion_studio.cli import shared, sweep


def add_to(commands):
  """Adds this sub-command to those of `motion-jax`."""
  train = commands.add_parser(
      "train", help="a config and data in, a trained run folder out",
      description="Trains one stage of a paper. Any field of the config is set by --config.SECTION.FIELD=VALUE, such "
                  "as --config.data.batch_size=32.",
      epilog=f"Configs that ship: {', '.join(config_files.names())}. Sizes: tiny (two steps, seconds), mini, laptop, "
             "small, and without one the paper's; docs/configs.md has them all.")
  add = train.add_argument
  shared.add_config(train, required=False)
  add("--sweep", metavar="NAME[:SIZE]",
      help="in the place of --config: all runs of a sweep, one that ships or a Python file with get_sweep(size), one "
           "after another in folders of --workdir, or the one of this task of a SLURM array")
  add("--workdir", required=True, metavar="FOLDER", help="run folder: made if need be; holds all that loading needs")
  add("--resume", nargs="?", const="yes", choices=("yes", "no", "auto"),
      help="go on with the run in the folder, exactly where it stopped; --resume=auto does if there is one and starts "
           "one if not, as several processes do by themselves")
  add("--no-resume", action="store_const", const="no", dest="resume", help="start a run, in an empty folder (default)")
  add("--allow-changes", action="store_true",
      help="go on although the config, or the data, are not those that the run began with")
  add("--max-seconds", type=real(above=0, high=1e9, unit="seconds"), metavar="S",
      help="stop and save after so long: one slice of a long run")
  add("--profile-steps", type=_steps, metavar="A:B",
      help="trace the steps A to B by JAX's profiler into the run folder's profile/, such as 10:20; step 1 "
           "waits for the compiler")
  add("--coordinator", metavar="HOST:PORT",
      help="address of the first of several processes, each started with this command and a number of its own; "
           "without it JAX finds them under Slurm, Open MPI and on TPU slices; auto: it must (docs/pods.md)")
  add("--process-id", type=whole(0, 1_000_000), metavar="I", help="the number of this process, from 0")
  add("--num-processes", type=whole(1, 1_000_000), metavar="N", help="how many processes there are")
  add("--simulate-devices", type=whole(1, 1024), metavar="N", default=0,
      help="train on so many CPU devices, which share the cores: to try out what several devices do")
  train.set_defaults(run=_train, overrides=[])


def _steps(text):
  first, colon, last = text.partition(":")
  try:
    found = tuple(whole(1, 10**9)(side) for side in (first, last))
  except NumberError as error:
    raise NumberError(f"got {shortened(text)!r}, expected steps A:B such as 10:20" +
                      (f" ({error})" if colon else "")) from None
  if found[0] > found[1]:
    raise NumberError(f"got {text!r}, expected steps A:B with A no later than B, such as 10:20")
  return found


def _train(args):
  if (args.config is None) == (args.sweep is None):
    raise InputError("got " + ("both --config and --sweep" if args.config else "neither --config nor --sweep")
                     + "; give one of them")
  if args.sweep:
    return sweep.run(args.sweep, args.workdir, _of_each_run(args))
  from motion_jax.utils import exit_status, stopping
  with stopping.Stop(args.program) as stop:
    _run(args, stop)
  if stop.status == exit_status.PREEMPTED and not stop.quiet:
    print(f"{args.program}: preempted, resumable", file=sys.stderr)
  return stop.status


def _of_each_run(args):
  """The arguments that each run of a sweep gets, too."""
  found = ["--data", *args.data] if args.data else []
  found += ["--allow-changes"] if args.allow_changes else []
  found += [f"--max-seconds={args.max_seconds}"] if args.max_seconds else []
  found += ["--profile-steps={}:{}".format(*args.profile_steps)] if args.profile_steps else []
  found += [f"--simulate-devices={args.simulate_devices}"] if args.simulate_devices else []
  return found + list(args.overrides)


def _run(args, stop):
  config = shared.config_of(args)

  import jax
  from absl import logging

  from motion_jax import fit
  from motion_jax.training import distributed
  logging.set_verbosity(logging.WARNING)  # orbax tells every step of a save
  distributed.start(args.coordinator, args.process_id, args.num_processes, args.simulate_devices)
  stop.quiet = not distributed.is_first()
  stop.nothing_to_lose(distributed.end_together)
  shared.cache_compiled_code()  # a run that goes on does not wait for the compiler again
  resume = {"yes": True, "no": False, "auto": "auto", None: "auto" if jax.process_count() > 1 else False}[args.resume]
  with distributed.as_one():
    fit.run(config, pathlib.Path(args.workdir), resume, args.max_seconds, stop, args.allow_changes,
            args.profile_steps)
