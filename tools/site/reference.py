"""The public names and commands that the site's reference has pages for, read from the source and the parsers.

Packages are read without importing them; their pages are made by mkdocstrings (tools/site/api.py). Pages of commands
are made here, from the parsers of motion_jax_studio.cli.
"""
import argparse
import ast
import functools
import pathlib
import re
from typing import NamedTuple

ROOT = pathlib.Path(__file__).parents[2]
PACKAGES = ("motion_jax", "motion_jax_studio")
HIDDEN = ("motion_jax.utils", "motion_jax_studio.cli")  # internal helpers; the commands have pages


class Entry(NamedTuple):
  """One public name. kind: "function", "class", "module" or "constant"; node: where it is defined."""
  name: str
  kind: str
  module: str
  node: ast.AST
  doc: str


@functools.cache
def tree_of(module):
  """(path, syntax tree) of a module or package, or None where the name is neither."""
  base = ROOT.joinpath(*module.split("."))
  path = next((path for path in (base / "__init__.py", base.with_suffix(".py")) if path.is_file()), None)
  if path is None:
    return None
  tree, stub = ast.parse(path.read_text(encoding="utf-8")), path.with_suffix(".pyi")
  if stub.is_file():  # of a package whose names are imported when they are first used
    tree.body += ast.parse(stub.read_text(encoding="utf-8")).body
  return path, tree


def rooms():
  """Names of the packages and top-level modules that list their public names in `__all__`."""
  names = []
  for package in PACKAGES:
    for path in sorted((ROOT / package).rglob("*.py")):
      parts = path.relative_to(ROOT).with_suffix("").parts
      name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
      is_room = parts[-1] == "__init__" or len(parts) == 2
      if is_room and not name.startswith(HIDDEN) and public_names(name):
        names.append(name)
  return names


def public_names(module):
  """The strings of `__all__`, sorted; those that it takes over from other modules are left out."""
  _, tree = tree_of(module)
  for node in tree.body:
    if isinstance(node, ast.Assign) and any(getattr(target, "id", "") == "__all__" for target in node.targets):
      return sorted({item.value for item in ast.walk(node.value) if isinstance(item, ast.Constant)},
                    key=lambda name: (name.lower(), name))
  return []


def resolve(module, name, seen=()):
  """The Entry of a public name of a module; imports are followed to where the name is defined."""
  path, tree = tree_of(module)
  for node in ast.walk(tree):
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name == name and node in tree.body:
      kind = "class" if isinstance(node, ast.ClassDef) else "function"
      return Entry(name, kind, module, node, ast.get_docstring(node) or "")
    if isinstance(node, (ast.Assign, ast.AnnAssign)) and node in tree.body:
      targets = node.targets if isinstance(node, ast.Assign) else [node.target]
      if any(getattr(part, "id", "") == name for target in targets for part in ast.walk(target)):
        return Entry(name, "constant", module, node, "")
    if isinstance(node, ast.ImportFrom) and (module, name) not in seen:
      source = ".".join(filter(None, (module if node.level else "", node.module)))
      for alias in node.names:
        if (alias.asname or alias.name) != name:
          continue
        if tree_of(f"{source}.{alias.name}"):
          return _module_entry(name, f"{source}.{alias.name}")
        if tree_of(source):
          return resolve(source, alias.name, (*seen, (module, name)))._replace(name=name)
  if tree_of(f"{module}.{name}"):
    return _module_entry(name, f"{module}.{name}")
  raise LookupError(f"{module}.__all__ names {name!r}, which stands nowhere in {path}; take it out or define it")


def _module_entry(name, module):
  _, tree = tree_of(module)
  return Entry(name, "module", module, tree, ast.get_docstring(tree) or "")


def undocumented():
  """Public functions, classes and modules without a docstring, as "room.name"."""
  return [f"{room}.{name}" for room in rooms() for name in public_names(room)
          if (entry := resolve(room, name)).kind != "constant" and not entry.doc]


@functools.cache
def commands():
  """{"data build": (its parser, what it does), ...} of all commands."""
  from motion_jax_studio import cli

  def below(parser, words, about):
    nested = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not nested:
      yield " ".join(words), (parser, parser.description or about)
    for action in nested:
      helps = {choice.dest: choice.help for choice in action._choices_actions}
      without_aliases = {id(inner): name for name, inner in reversed(action.choices.items())}
      for inner, name in ((action.choices[name], name) for name in reversed(without_aliases.values())):
        yield from below(inner, [*words, name], helps.get(name) or "")

  return dict(below(cli._parser(), [], ""))


def command_page(name, parser, about):
  """The page of a command: what it does, its arguments, its flags by group."""
  formatter = parser._get_formatter()
  text = lambda action: escaped(formatter._expand_help(action)) if action.help else ""
  lines = [f"# motion-jax {name}", "", escaped(about), ""]
  for group in parser._action_groups:
    actions = [action for action in group._group_actions
               if action.help is not argparse.SUPPRESS and action.dest != "help"]
    if not actions:
      continue
    title = {"positional arguments": "Arguments", "options": "Flags"}.get(group.title, group.title)
    title, _, note = title.partition(": ")
    lines += [f"## {title[0].upper()}{title[1:]}", ""]
    if note:
      lines += [escaped(note[0].upper() + note[1:] + "."), ""]
    lines += ["| name | meaning |", "| --- | --- |"]
    for action in actions:
      value = formatter._format_args(action, formatter._get_default_metavar_for_optional(action)
                                     if action.option_strings else action.dest)
      shown = ", ".join(action.option_strings) if action.option_strings else ""
      named = " ".join(part for part in (shown, value) if part).replace("|", "\\|")
      lines.append(f"| `{named}` | {text(action)} |")
    lines.append("")
  if parser.epilog:
    lines += [escaped(parser.epilog), ""]
  return joined(lines)


def escaped(text):
  """Text in one line for a cell of a Markdown table."""
  return " ".join(text.replace("|", "\\|").replace("<", "&lt;").split())


def joined(lines):
  """The text of a page: never two empty lines in a row, and one line's end at its end."""
  return re.sub(r"\n{3,}", "\n\n", "\n".join(line.rstrip() for line in lines)).strip() + "\n"


def command_pages():
  """{path of a page under reference/: text} of all commands."""
  return {f"commands/{name.replace(' ', '-')}.md": command_page(name, *command)
          for name, command in commands().items()}


def tables():
  """{"packages": table, "commands": table}: Markdown links to all pages, as seen from the page `reference.md`."""
  summaries = {room: " ".join((ast.get_docstring(tree_of(room)[1]) or "").partition("\n\n")[0].split())
               for room in rooms()}
  packages = [f"| [`{room}`](reference/{room}.md) | {escaped(summary)} |" for room, summary in summaries.items()]
  entries = [f"| [`motion-jax {name}`](reference/commands/{name.replace(' ', '-')}.md) | {escaped(about)} |"
             for name, (_, about) in commands().items()]
  return {"packages": joined(["| package | contents |", "| --- | --- |", *packages]),
          "commands": joined(["| command | what it does |", "| --- | --- |", *entries])}
