"""python -m motion_studio.cli: the command line where the package is not installed."""
import sys

from motion_studio.cli import main

sys.exit(main())
