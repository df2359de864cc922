"""Judges runs by a protocol: python eval.py --model runs/x --data DIR ..., the same as `motion-jax evaluate`."""
import sys

from motion_jax_studio import cli

if __name__ == "__main__":
  sys.exit(cli.main(command="evaluate", program="eval.py"))
