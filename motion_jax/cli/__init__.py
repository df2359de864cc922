"""motion-jax: words to moving bodies, from the command line. A module per group of commands, one function per command.

Nothing heavy is imported before a command runs: `--help` and a mistyped command answer at once.
"""
import sys
import warnings

import motion_jax
from motion_jax.cli import convert, data, make, retrieve, show
from motion_jax.cli.parser import Parser
from motion_jax.cli.prompts import read_prompts, read_stories
from motion_jax.runtime import progress, stopping

__all__ = ["main", "read_prompts", "read_stories"]

# What this package raises itself. What a library stumbles over is translated where that happens (`errors.reading`), so
# any other error is a fault of the program, and a traceback says where.
KNOWN_ERRORS = (ValueError, OSError, FloatingPointError)


def main(argv=None):
  """Runs a sub-command; returns the exit status. An error that the user can mend is one line, not a traceback."""
  with stopping.at_once("motion-jax"):
    try:
      status = _run(_parser().parse_args(argv))
    except BrokenPipeError:
      return stopping.pipe_closed()
    except SystemExit:  # --help and mistakes in the arguments
      stopping.flush()
      raise
    return stopping.flush() or status


def _run(args):
  said = set()  # each once, however often it is met on the way

  def tell(message, *_, **__):
    if str(message) not in said:
      said.add(str(message))
      print(f"note: {message}", file=sys.stderr)

  warnings.showwarning = tell
  progress.show()
  try:
    return args.run(args) or 0
  except BrokenPipeError:
    raise
  except KNOWN_ERRORS as error:
    print(f"motion-jax {args.command}: {error}", file=sys.stderr)
    return 1
  except Exception as error:
    if not _out_of_memory(error):
      raise
    print(f"motion-jax {args.command}: this takes more memory than there is; ask for fewer or shorter motions",
          file=sys.stderr)
    return 1


def _out_of_memory(error):
  """Whether numpy or jax, which says so in a runtime error's words, found no memory."""
  return isinstance(error, MemoryError) or isinstance(error, RuntimeError) and "RESOURCE_EXHAUSTED" in str(error)


def _parser():
  parser = Parser(prog="motion-jax", description="Make people move from words.")
  parser.add_argument("--version", action="version", version=f"motion-jax {motion_jax.__version__}",
                      help="the version of this program")
  commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
  for group in (make, show, data, convert, retrieve):
    group.add_to(commands)
  return parser
