"""The command line `motion-jax`: a module per group of commands, a function per command.

Nothing heavy is imported before a command runs, so that `--help` and a mistyped command answer at once.
"""
import errno
import gc
import importlib
import sys
import warnings

import motion_jax
from motion_jax.utils import progress, stopping
from motion_jax.utils.numerals import shortened
from motion_jax_studio.cli.parser import Parser

# {command: its module}, in the order of --help.
MODULES = {"generate": "generating", "multi-prompt": "generating", "extend": "generating", "edit": "generating",
           "render": "render", "blend": "render", "studio": "studio", "make": "studio", "models": "listing",
           "rigs": "listing", "data": "data",
           "train": "train", "evaluate": "evaluate", "convert": "convert", "export": "export", "retrieve": "retrieve",
           "retarget": "robot"}
__all__ = ["main", "parse"]

# Errors that a user can fix. Errors of libraries are translated where they occur (`errors.reading`); any other
# exception is a fault of the program and keeps its traceback.
_KNOWN_ERRORS = (ValueError, OSError, FloatingPointError)


def main(argv=None, command=None, program=None):
  """Run a sub-command; returns the exit status. An error that the user can fix is printed in one line.

  command: the only sub-command, to which all arguments belong, as for the script `program`.
  """
  # Imported modules are never freed; collecting them again and again would take a fifth of the start-up time.
  gc.set_threshold(50_000, 20, 50)
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
  """The parsed arguments of `main`; a mistake in them ends the program with a message of one line."""
  argv = list(sys.argv[1:] if argv is None else argv)
  parser = _parser(command or next(iter(argv), None))
  if command is not None:
    parser = _commands_of(parser)[command]
    parser.prog = program
    parser.set_defaults(command=command)
  args = parser.parse_args(argv)
  args.program = program or f"motion-jax {args.command}"
  return args


def _run(args):
  shown = set()  # each warning is printed once

  def show(message, *_, **__):
    if str(message) not in shown:
      shown.add(str(message))
      print(f"note: {message}", file=sys.stderr)

  warnings.showwarning = show
  if getattr(args, "command", None) not in ("train", "evaluate"):  # these print their own progress
    progress.show()
  try:
    return args.run(args) or 0
  except BrokenPipeError:
    raise
  except Exception as error:
    if (message := _message(error)) is None:
      raise
    print(f"{args.program}: {message}", file=sys.stderr)
    return 1


def _message(error):
  """The line to print for an error that the user can fix; None for a fault of the program."""
  number, name = getattr(error, "errno", None), str(getattr(error, "filename", None) or "")
  if number in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
    return (f"no space left on the disk to write {name or 'to'}, or a file is larger than it may be; free some, or "
            "write to another folder. Nothing half-written is left")
  if number == errno.ENAMETOOLONG:
    return (f"got the file name {shortened(name)!r} of {len(name)} characters, longer than a file's may be; give a "
            "shorter one")
  if isinstance(error, MemoryError) or isinstance(error, RuntimeError) and "RESOURCE_EXHAUSTED" in str(error):
    return "this takes more memory than there is; try fewer or shorter motions"
  return str(error) if isinstance(error, _KNOWN_ERRORS) else None


def _parser(command=None):
  """The parser of a command, or of all where there is no such command."""
  parser = Parser(prog="motion-jax", description="Text-to-motion generation in JAX. Flags may be "
                  "written with dashes or underscores.")
  parser.add_argument("--version", action="version", version=f"motion-jax {motion_jax.__version__}",
                      help="print the version")
  commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
  for module in dict.fromkeys([MODULES[command]] if command in MODULES else MODULES.values()):
    importlib.import_module(f"motion_jax_studio.cli.{module}").add_to(commands)
  return parser


def _commands_of(parser):
  """{name: its parser} of the sub-commands."""
  return next(action.choices for action in parser._actions if action.dest == "command")
