"""motion-jax: words to moving bodies, from the command line. A module per group of commands, one function per command.

Nothing heavy is imported before a command runs: `--help` and a mistyped command answer at once.
"""
import errno
import sys
import warnings

import motion_jax
from motion_jax.utils import progress, stopping
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import shortened
from motion_studio.cli import blend, convert, data, evaluate, make, retrieve, show, studio, train
from motion_studio.cli.parser import Parser
from motion_studio.cli.prompts import read_prompts, read_sequences

__all__ = ["main", "parse", "read_prompts", "read_sequences"]

# What this package raises itself. What a library stumbles over is translated where that happens (`errors.reading`), so
# any other error is a fault of the program, and a traceback says where.
KNOWN_ERRORS = (ValueError, OSError, FloatingPointError)


def main(argv=None, command=None, program=None):
  """Runs a sub-command; returns the exit status. An error that the user can mend is one line, not a traceback.

  command: the arguments are those of this sub-command alone, for the script `program` that is it and no other.
  """
  trains = "train" in (command, *(sys.argv[1:] if argv is None else argv)[:1])
  with stopping.at_once(program or "motion-jax", resumable=trains):
    try:
      args = parse(argv, command, program)
      status = _run(args)
    except BrokenPipeError:
      return stopping.pipe_closed()
    except SystemExit:  # --help and mistakes in the arguments
      stopping.flush()
      raise
    return stopping.flush() or status


def parse(argv=None, command=None, program=None):
  """The arguments that `main` is given, read; mistakes in them end the program with one line."""
  parser, argv = _parser(), list(sys.argv[1:] if argv is None else argv)
  if command is not None:
    parser = _commands_of(parser)[command]
    parser.prog = program
    parser.set_defaults(command=command)
  args = parser.parse_args(argv)
  args.program = program or f"motion-jax {args.command}"
  return args


def _run(args):
  said = set()  # each once, however often it is met on the way

  def tell(message, *_, **__):
    if str(message) not in said:
      said.add(str(message))
      print(f"note: {message}", file=sys.stderr)

  warnings.showwarning = tell
  if getattr(args, "command", None) not in ("train", "evaluate"):  # these show progress of their own
    progress.show()
  try:
    return _called(args) or 0
  except BrokenPipeError:
    raise
  except KNOWN_ERRORS as error:
    print(f"{args.program}: {error}", file=sys.stderr)
    return 1
  except Exception as error:
    if not _out_of_memory(error):
      raise
    print(f"{args.program}: this takes more memory than there is; ask for fewer or shorter motions", file=sys.stderr)
    return 1


def _called(args):
  """The command's own exit status. Refuses names longer than any file's, from every lookup."""
  try:
    return args.run(args)
  except OSError as error:
    if error.errno != errno.ENAMETOOLONG:
      raise
    name = str(error.filename or "")
    raise InputError(f"got the file name {shortened(name)!r} of {len(name)} characters, longer than a file's may be; "
                     "give a shorter one") from error


def _out_of_memory(error):
  """Whether numpy or jax, which says so in a runtime error's words, found no memory."""
  return isinstance(error, MemoryError) or isinstance(error, RuntimeError) and "RESOURCE_EXHAUSTED" in str(error)


def _parser():
  parser = Parser(prog="motion-jax", description="Text-to-motion generation: sentences become moving bodies.")
  parser.add_argument("--version", action="version", version=f"motion-jax {motion_jax.__version__}",
                      help="the version of this program")
  commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
  for group in (make, blend, studio, show, data, train, evaluate, convert, retrieve):
    group.add_to(commands)
  return parser


def _commands_of(parser):
  """{name: its parser} of the sub-commands."""
  return next(action.choices for action in parser._actions if action.dest == "command")
