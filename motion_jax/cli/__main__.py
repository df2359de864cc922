"""python -m motion_jax.cli: the command line where the package is not installed."""
import sys

from motion_jax.cli import main

sys.exit(main())
