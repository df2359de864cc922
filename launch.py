"""Trains a stage: python launch.py --config configs/X.py --workdir runs/x [--resume] [--config.data.batch_size=32]"""
import pathlib
import sys

from absl import app, flags, logging
from ml_collections import config_flags

from motion_jax.inputs import overrides
from motion_jax.runtime import stopping

_CONFIG = config_flags.DEFINE_config_file("config", None, "Experiment, as configs/X.py or configs/X.py:tiny.")
_WORKDIR = flags.DEFINE_string("workdir", None, "Run folder: made if need be; holds all that loading needs.")
_RESUME = flags.DEFINE_bool("resume", False, "Go on with the run in workdir, exactly where it stopped.")
_SECONDS = flags.DEFINE_float("max_seconds", None, "Stop and save after so long: one slice of a long run.")
flags.register_validator("max_seconds", lambda seconds: seconds is None or 0 < seconds < 1e9,
                         message="expected a number of seconds over 0")
flags.mark_flags_as_required(["config", "workdir"])


def parse(argv):
  """The arguments that are no flags; a mistake in the others, or in the config, ends the program with one line."""
  try:
    given = overrides.value_of("config", argv[1:])
    if given is not None and not {"--help", "-h", "--helpfull", "-help", "-?"} & set(argv):
      overrides.check(argv[1:], overrides.config_of(given))
    return flags.FLAGS(argv)
  except (flags.Error, ValueError, OSError, AttributeError, KeyError, TypeError) as error:
    sys.exit(f"launch.py: {' '.join(str(error).split())}")


def main(argv):
  if len(argv) > 1:
    sys.exit(f"launch.py: got the stray arguments {' '.join(argv[1:])}; overrides are written --config.name=value")
  logging.set_verbosity(logging.WARNING)  # orbax tells every step of a save
  stop = stopping.Stop()
  try:
    from motion_jax import fit as training
    from motion_jax.runtime import cache
    cache.keep_in_user_cache()  # a run that goes on does not wait for the compiler again
    training.run(_CONFIG.value, pathlib.Path(_WORKDIR.value), resume=_RESUME.value, max_seconds=_SECONDS.value,
                 stop=stop)
  except BrokenPipeError:
    sys.exit(stopping.pipe_closed())
  except (ValueError, OSError, FloatingPointError) as error:
    sys.exit(f"launch.py: {error}")
  sys.exit(stopping.flush() or stop.status)


if __name__ == "__main__":
  with stopping.at_once("launch.py"):
    app.run(main, flags_parser=parse)
