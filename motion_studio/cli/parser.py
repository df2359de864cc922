"""Arguments read by argparse, with mistakes told in one line that names the nearest right word."""
import argparse
import re

from motion_jax.utils.nearest import did_you_mean


class Parser(argparse.ArgumentParser):
  """argparse's parser whose errors are one line.

  --two_words is --two-words. A command whose defaults have `overrides` finds there all --config.KEY=VALUE, and what is
  no flag.
  """

  def parse_args(self, args=None, namespace=None):
    found, rest = self.parse_known_args(args, namespace)
    takes_overrides = hasattr(found, "overrides")
    strange = [one for one in rest if not takes_overrides or (
        one.startswith("--") and not one.startswith(("--config.", "--noconfig.")))]
    if strange:
      self.error(f"unrecognized arguments: {' '.join(strange)}")
    if takes_overrides:
      found.overrides = rest
    return found

  def parse_known_args(self, args=None, namespace=None):
    return super().parse_known_args(args if args is None else list(map(self._as_called, args)), namespace)

  def _as_called(self, argument):
    name, equals, value = argument.partition("=")
    if not name.startswith("-"):
      return argument
    spelled = "--" + name.lstrip("-").replace("_", "-")
    return spelled + equals + value if spelled in self._option_string_actions else argument

  def error(self, message):
    strange = re.match(r"unrecognized arguments: (\S+)", message)
    if strange:
      message += did_you_mean(strange[1].partition("=")[0], _options(self))
    chosen = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
    if chosen:
      message += did_you_mean(chosen[1], re.findall(r"[\w.-]+", chosen[2]))
    self.exit(2, f"{self.prog}: {message}; {self.prog} --help tells more\n")


def _options(parser):
  """The options of a parser and of its sub-commands."""
  found = set(parser._option_string_actions)
  for action in parser._actions:
    if isinstance(action, argparse._SubParsersAction):
      found |= set().union(*map(_options, action.choices.values()))
  return found
