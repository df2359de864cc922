"""python -m motion_jax_studio.cli: the command line, without installing the package."""
import sys

from motion_jax_studio.cli import main

sys.exit(main())
