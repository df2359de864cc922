"""python -m motion_studio.cli: the command line, without installing the package."""
import sys

from motion_studio.cli import main

sys.exit(main())
