"""Arguments read by argparse, with mistakes told in one line that names the nearest right word."""
import argparse
import re

from motion_jax.inputs.nearest import did_you_mean


class Parser(argparse.ArgumentParser):
  """argparse's parser whose errors are one line."""

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
