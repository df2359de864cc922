"""Trains a stage: python launch.py --config configs/X.py --workdir runs/x [--resume] [--config.data.batch_size=32]"""
import pathlib
import sys

from absl import app, flags, logging
from ml_collections import config_flags

from motion_jax import training

_CONFIG = config_flags.DEFINE_config_file("config", None, "Experiment, as configs/X.py or configs/X.py:tiny.")
_WORKDIR = flags.DEFINE_string("workdir", None, "Run folder: made if need be; holds all that loading needs.")
_RESUME = flags.DEFINE_bool("resume", False, "Go on with the run in workdir, exactly where it stopped.")
_SECONDS = flags.DEFINE_float("max_seconds", None, "Stop and save after so long: one slice of a long run.")
flags.mark_flags_as_required(["config", "workdir"])


def main(argv):
  if len(argv) > 1:
    raise app.UsageError(f"got the stray arguments {argv[1:]}; overrides are written --config.name=value")
  logging.set_verbosity(logging.WARNING)  # orbax tells every step of a save
  try:
    training.run(_CONFIG.value, pathlib.Path(_WORKDIR.value), resume=_RESUME.value, max_seconds=_SECONDS.value)
  except (ValueError, FileNotFoundError, FloatingPointError) as error:
    sys.exit(f"launch.py: {error}")


if __name__ == "__main__":
  app.run(main)
