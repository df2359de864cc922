"""Trains a stage: python launch.py --config configs/X.py --workdir runs/x ..., the same as `motion-jax train`."""
import sys

from motion_jax_studio import cli

if __name__ == "__main__":
  sys.exit(cli.main(command="train", program="launch.py"))
