"""An argument parser that reports a mistake in one line and suggests the flag that was probably meant."""
import argparse
import re
import shlex

from motion_jax.models.arguments import OTHERS
from motion_jax.utils.nearest import did_you_mean
from motion_jax.utils.numerals import shortened

_QUOTES = "; a sentence goes in quotes, several go in a file"


def typed(read):
  """`read` as the type of a flag: argparse prints the message of its ValueErrors, with the flag's value."""
  def convert(text):
    try:
      return read(text)
    except ValueError as error:
      where = "" if shortened(text) in str(error) else f"in {shortened(text)}: "
      raise argparse.ArgumentTypeError(f"{where}{error}") from None

  return convert


class HelpAll(argparse.Action):
  """--help-all: prints the help with all flags."""

  def __call__(self, parser, namespace, values, option_string=None):
    parser.shown = None
    parser.print_help()
    parser.exit()


class Parser(argparse.ArgumentParser):
  """An argparse parser with one-line errors; `--two_words` and `--two-words` are the same flag, unabbreviated.

  A command whose defaults contain `overrides` receives all `--config.KEY=VALUE` arguments there.

  shown(arguments) -> {dest: help text} of the flags that --help shows, given the command's arguments; None shows all.
  """

  def __init__(self, *args, **kwargs):
    super().__init__(*args, **{"allow_abbrev": False} | kwargs)
    self.shown, self._given = None, []

  def format_help(self):
    texts = [(action, action.help) for action in self._actions]
    if self.shown is not None:
      shown = self.shown(self._given) | {action.dest: action.help for action in self._actions
                                         if not action.option_strings or action.dest in ("help", "help_all")}
      for action in self._actions:
        action.help = shown.get(action.dest, argparse.SUPPRESS)
    try:
      return super().format_help()
    finally:
      for action, text in texts:
        action.help = text

  def parse_args(self, args=None, namespace=None):
    parsed, rest = self.parse_known_args(args, namespace)
    takes_overrides = hasattr(parsed, "overrides")
    unknown = [argument for argument in rest if not takes_overrides or (
        argument.startswith("--") and not argument.startswith(("--config.", "--noconfig.")))]
    if unknown:
      advice = _QUOTES * (unknown[0][:1] != "-")
      self._of_command(parsed).error(f"unrecognized arguments: {shlex.join(unknown)}{advice}")
    if takes_overrides:
      parsed.overrides = rest
    return parsed

  def parse_known_args(self, args=None, namespace=None):
    if args is not None:
      self._given = args = self._joined(map(self._with_dashes, args))
    return super().parse_known_args(args, namespace)

  def _of_command(self, parsed):
    """The parser of the sub-command that was parsed, or this one."""
    for action in self._actions:
      if isinstance(action, argparse._SubParsersAction) and getattr(parsed, action.dest, None) in action.choices:
        return action.choices[getattr(parsed, action.dest)]._of_command(parsed)
    return self

  def _joined(self, arguments):
    """The arguments with "--up -z" as "--up=-z": argparse would take a value that begins with a dash for a flag."""
    joined: list[str] = []
    for argument in arguments:
      action = self._option_string_actions.get(joined[-1]) if joined else None
      if action is not None and action.nargs is None and (
          re.match(r"-[\d.]", argument) or argument[:1] == "-" and argument in (action.choices or ())):
        joined[-1] += f"={argument}"
      else:
        joined.append(argument)
    return joined

  def _with_dashes(self, argument):
    """The argument with dashes for underscores in its flag's name, if that makes it a flag of this parser."""
    name, equals, value = argument.partition("=")
    flag = "--" + name.lstrip("-").replace("_", "-")
    return flag + equals + value if name.startswith("-") and flag in self._option_string_actions else argument

  def error(self, message):
    unknown = re.match(r"unrecognized arguments: (-\S+)", message)
    if unknown:
      message += _suggestion(unknown[1].partition("=")[0], set(self._option_string_actions))
    chosen = re.search(r"invalid choice: '([^']*)'(?= \(choose from (.*)\))", message)
    if chosen:
      message = message.replace(chosen[0], chosen[0] + did_you_mean(chosen[1], re.findall(r"[\w.-]+", chosen[2])), 1)
    self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _suggestion(flag, known):
  """" (did you mean --num-samples?)" for a flag of another program, or a misspelled one; "" for others."""
  name = flag.lstrip("-").replace("_", "-").lower()
  meant = [f"--{other.replace('_', '-')}" for other in OTHERS.get(name.replace("-", "_"), ())]
  meant = [candidate for candidate in meant if candidate in known]
  # Without the dashes, which all flags have in common.
  return (f" (did you mean {meant[0]}?)" if meant else
          did_you_mean(name, [candidate.lstrip("-") for candidate in known]).replace("mean ", "mean --"))

