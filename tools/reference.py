"""Writes docs/reference: a page for each room with an `__all__`, and a page for each command with its flags.

  python tools/reference.py            write the pages
  python tools/reference.py --check    name the pages that are out of date; exit status 1 if there are any

Rooms are read from their source, without importing them: signatures stand in the pages as they stand in the code.
Commands are read from the parsers of motion_jax_studio.cli.
"""
import argparse
import ast
import functools
import pathlib
import re
import sys
import textwrap
from typing import NamedTuple

ROOT = pathlib.Path(__file__).parents[1]
OUT = ROOT / "docs" / "reference"
PACKAGES = ("motion_jax", "motion_jax_studio")
HIDDEN = ("motion_jax.utils", "motion_jax_studio.cli")  # helpers of our own; the commands have pages
NOTE = "<!-- Written by tools/reference.py from the source; edit the docstrings instead. -->"
LONGEST = 100  # characters of a constant's value that are shown


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
  """Names of the modules and packages that state their public names in `__all__` and are found from outside."""
  found = []
  for package in PACKAGES:
    for path in sorted((ROOT / package).rglob("*.py")):
      parts = path.relative_to(ROOT).with_suffix("").parts
      name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
      is_room = parts[-1] == "__init__" or len(parts) == 2
      if is_room and not name.startswith(HIDDEN) and public_names(name):
        found.append(name)
  return found


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


def signature(node):
  """`(x, y=1) -> Array` of a function as its source has it."""
  returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
  return f"({ast.unparse(node.args)}){returns}"


def bodies(doc):
  """A docstring as Markdown: its first paragraph, then the rest as it stands."""
  first, _, rest = doc.strip().partition("\n\n")
  lines = [" ".join(first.split()), ""]
  if rest.strip():
    lines += ["```text", *textwrap.dedent(rest).strip().splitlines(), "```", ""]
  return lines


def _class_lines(entry):
  bases = [ast.unparse(base) for base in entry.node.bases]
  lines = ["```python", f"class {entry.name}({', '.join(bases)})" if bases else f"class {entry.name}", "```", ""]
  lines += bodies(entry.doc)
  fields = [node for node in entry.node.body if isinstance(node, ast.AnnAssign)
            and not node.target.id.startswith("_")]
  if fields:
    lines += ["```python", *map(ast.unparse, fields), "```", ""]
  for node in entry.node.body:
    if isinstance(node, ast.FunctionDef) and (node.name == "__call__" or not node.name.startswith("_")) and (
        node.name != "setup"):
      doc = (ast.get_docstring(node) or "").strip().partition("\n\n")[0]
      decorators = {getattr(one, "id", "") for one in node.decorator_list}
      shown = node.name if "property" in decorators else node.name + signature(node).replace("(self, ", "(").replace(
          "(self)", "()")
      lines.append(f"- `{' '.join(shown.split())}`" + (f": {' '.join(doc.split())}" if doc else ""))
  return [*lines, ""] if lines[-1] else lines


def _entry_lines(entry):
  lines = [f"## {entry.name}", ""]
  if entry.kind == "module":
    page = f"{entry.module}.md"
    link = f"[`{entry.module}`]({page})" if entry.module in rooms() else f"Module `{entry.module}`"
    return [*lines, f"{link}. {' '.join(entry.doc.partition(chr(10) * 2)[0].split())}", ""]
  if entry.kind == "function":
    lines += ["```python", f"{entry.name}{signature(entry.node)}", "```", "", *bodies(entry.doc)]
  elif entry.kind == "class":
    lines += _class_lines(entry)
  else:
    value = " ".join(ast.unparse(entry.node.value).split()) if entry.node.value else ""
    lines += [f"Constant: `{value if len(value) <= LONGEST else value[:LONGEST] + ' ...'}`", ""]
  return [*lines, f"Defined in `{entry.module.replace('.', '/')}.py`."
          if tree_of(entry.module)[0].name != "__init__.py" else f"Defined in `{entry.module}`.", ""]


def room_page(room):
  """The page of a room, as Markdown."""
  _, tree = tree_of(room)
  entries = [resolve(room, name) for name in public_names(room)]
  lines = [f"# {room}", "", NOTE, "", *bodies(ast.get_docstring(tree) or "")]
  for entry in entries:
    lines += _entry_lines(entry)
  return joined(lines)


def commands():
  """{"data build": (its parser, what it does), ...} of all commands."""
  from motion_jax_studio import cli

  def below(parser, words, about):
    nested = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    if not nested:
      yield " ".join(words), (parser, parser.description or about)
    for action in nested:
      helps = {choice.dest: choice.help for choice in action._choices_actions}
      own_names = {id(inner): name for name, inner in reversed(action.choices.items())}  # without aliases
      for inner, name in ((action.choices[name], name) for name in reversed(own_names.values())):
        yield from below(inner, [*words, name], helps.get(name) or "")

  return dict(below(cli._parser(), [], ""))


def command_page(name, parser, about):
  """The page of a command: what it does, its arguments, its flags by group."""
  formatter = parser._get_formatter()
  text = lambda action: escaped(formatter._expand_help(action)) if action.help else ""
  lines = [f"# motion-jax {name}", "", NOTE, "", escaped(about), ""]
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


def index_page(room_names, command_names):
  """docs/reference/README.md: all pages, each with its first line."""
  lines = ["# Reference", "", NOTE, "",
           "Every public name and every flag. How to use them is in the [manual](../README.md).", "",
           "## Packages", "", "| room | contents |", "| --- | --- |"]
  for room in room_names:
    doc = " ".join((ast.get_docstring(tree_of(room)[1]) or "").partition("\n\n")[0].split())
    lines.append(f"| [`{room}`]({room}.md) | {escaped(doc)} |")
  lines += ["", "## Commands", "", "Dashes and underscores in flags are the same.", "", "| command | what it does |",
            "| --- | --- |"]
  for name, (_, about) in command_names.items():
    lines.append(f"| [`motion-jax {name}`](commands/{name.replace(' ', '-')}.md) | {escaped(about)} |")
  return joined(lines)


def pages():
  """{path below docs/reference: text} of all pages."""
  of_rooms, of_commands = rooms(), commands()
  made = {"README.md": index_page(of_rooms, of_commands)}
  made |= {f"{room}.md": room_page(room) for room in of_rooms}
  return made | {f"commands/{name.replace(' ', '-')}.md": command_page(name, *found)
                 for name, found in of_commands.items()}


def stale(made):
  """Pages that differ from those on disk, and pages on disk that belong to no room or command any more."""
  there = {str(path.relative_to(OUT)): path.read_text(encoding="utf-8") for path in OUT.rglob("*.md")}
  return sorted(name for name in {*made, *there} if made.get(name) != there.get(name))


def main(argv=None):
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--check", action="store_true", help="name the pages that are out of date and write none")
  args = parser.parse_args(argv)
  sys.path.insert(0, str(ROOT))
  made = pages()
  differ = stale(made)
  if args.check:
    print(*differ, sep="\n")
    return int(bool(differ))
  for name in differ:
    path = OUT / name
    if name not in made:
      path.unlink()
      continue
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(made[name], encoding="utf-8")
  print(f"{len(made)} pages, {len(differ)} written or deleted")
  return 0


if __name__ == "__main__":
  sys.exit(main())
