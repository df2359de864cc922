"""Reference pages of the site: rooms by mkdocstrings, with source and shapes; configs with fields and values."""
import ast
import functools
import pathlib
import re
import textwrap

from ml_collections import ConfigDict

from motion_jax.utils import config_files
from motion_jax.utils.errors import InputError
from tools.site import reference
from tools.site.fields import MEANINGS

SIZES = ("full", "small", "laptop", "mini", "tiny")
_NAMES = r"\w+(?:(?:, | and )\w+)*"  # of fields that a comment or docstring explains: "name, fields: ..."
_WHERE = r"(?:, where \w+ is)?: "
_MEANING = re.compile(rf"(?:^|[.;]\s)({_NAMES}){_WHERE}(.+?)(?=[.;]\s+{_NAMES}{_WHERE}|[.;]?$)")

_SPACED = re.compile(r"^ |\S {2,}\S|^[-|]|^\d+[.)] |: *$", re.MULTILINE)  # columns, lists, drawings: not prose


def as_markdown(doc):
  """A docstring as Markdown: paragraphs of prose as such, all others word for word."""
  first, *rest = re.split(r"\n\s*\n", textwrap.dedent(doc).strip())
  parts, verbatim = [" ".join(first.split())], []
  for paragraph in [*rest, None]:
    if paragraph is not None and _SPACED.search(paragraph):
      verbatim.append(paragraph)
      continue
    if verbatim:
      parts.append("```text\n" + "\n\n".join(verbatim) + "\n```")
      verbatim = []
    if paragraph is not None:
      parts.append(" ".join(paragraph.split()).replace("][", "]\\["))
  return "\n\n".join(parts)


@functools.cache
def homes():
  """{where a name is defined: the room whose page describes it}: of several rooms that have it, the nearest."""
  home_of = {}
  for room in reference.rooms():
    for name in reference.public_names(room):
      path = path_of(reference.resolve(room, name))
      if path not in home_of or path.startswith(f"{room}.") and len(room) > len(home_of[path]):
        home_of[path] = room
  return home_of


def path_of(entry):
  """Where a public name is defined, such as "motion_jax.data.clip.Clip"."""
  return f"{entry.module}.{getattr(entry.node, 'name', entry.name)}"


def room_page(room):
  """The page of a room: what it is for, then each public name by mkdocstrings, behind the anchor that links name."""
  lines = [f"# {room}", "", as_markdown(ast.get_docstring(reference.tree_of(room)[1]) or "")]
  for name in reference.public_names(room):
    entry = reference.resolve(room, name)
    if entry.kind == "module":
      page = f"[`{entry.module}`]({entry.module}.md)" if entry.module in reference.rooms() else f"`{entry.module}`"
      lines += [f"## {name}", "", f"Module {page}. {' '.join(entry.doc.partition(chr(10) * 2)[0].split())}", ""]
    elif (home := homes()[path_of(entry)]) != room:
      lines += [f"## {name}", "", f"Described in [`{home}`]({home}.md#{name.lower()}).", ""]
    else:
      path = path_of(entry)
      lines += [f'<a id="{name.lower()}"></a>', "", f"::: {path}", ""]
  return reference.joined(lines)


@functools.cache
def meanings(source):
  """{field: what it means} of the comments and docstrings of a config file that say "field: meaning"."""
  comments = re.sub(r"\n *#", "", "\n".join(re.findall(r"(?m)(?:^ *#.*\n)+", source)))
  texts = [*re.findall(r'"""(.*?)"""', source, flags=re.DOTALL), *re.findall(r"#\s*(\w+: .*)", comments)]
  by_field = {}
  for text in texts:
    for names, meaning in _MEANING.findall(" ".join(text.replace("#", "").split())):
      for name in re.split(r", | and ", names):
        by_field.setdefault(name, meaning.strip())
  return by_field


def fields(config, before=""):
  """{"section.field": value} of a config."""
  values = {}
  for name, value in config.items():
    if isinstance(value, ConfigDict) and len(value):
      values |= fields(value, f"{before}{name}.")
    else:
      values[before + name] = value.to_dict() if isinstance(value, ConfigDict) else value
  return values


def config_page(name):
  """The page of a config that ships: what its docstring says, each field with its value in every size, its source."""
  path = config_files.FOLDER / f"{name}.py"
  source = path.read_text(encoding="utf-8")
  docstring = re.match(r'"""(.*?)"""', source, flags=re.DOTALL)[1]
  lines = [f"# {name}", "", as_markdown(docstring)]
  by_size = {}
  for size in SIZES:
    try:
      by_size[size] = fields(config_files.load(f"{name}:{size}"))
    except (ValueError, InputError):
      continue
  meaning = meanings((config_files.FOLDER / "common.py").read_text(encoding="utf-8")) | meanings(source)
  lines += ["## Fields", "", "`--config.FIELD=VALUE` sets a field. A size that is not named has the first value.", "",
            "| field | value | meaning |", "| --- | --- | --- |"]
  for field in dict.fromkeys(field for of_size in by_size.values() for field in of_size):
    if field.startswith("paper_row"):
      continue
    values = {}
    for size, of_size in by_size.items():
      if field in of_size:
        values.setdefault(repr(of_size[field]), []).append(size)
    (first, _), *others = values.items()
    shown = [f"`{first}`", *(f"{', '.join(sizes)}: `{value}`" for value, sizes in others)]
    meant = meaning.get(field.split(".")[-1]) or MEANINGS.get(field, "")
    lines.append(f"| `{field}` | {'<br>'.join(shown)} | {reference.escaped(meant)} |")
  return reference.joined([*lines, "", "## Source", "", "```python", *source.strip().splitlines(), "```"])


def configs():
  """Names of the configs that have pages; rows of ablation tables are variants of these."""
  return [name for name in config_files.names() if "/" not in name]


def pages():
  """{path of a page under reference/: text} of packages, commands and configs."""
  return {f"{room}.md": room_page(room) for room in reference.rooms()} | reference.command_pages() | {
      f"configs/{name}.md": config_page(name) for name in configs()}


def source_of(path: pathlib.Path) -> str:
  """A page that shows a file of the repository, or what a folder holds, with links as from beside the folder."""
  name = path.relative_to(reference.ROOT).as_posix()
  if path.is_dir():
    inner = sorted(entry for entry in path.iterdir() if not entry.name.startswith((".", "__pycache__")))
    link = lambda entry: f"[{entry.name}]({path.name}/{entry.name + '/README.md' * entry.is_dir()})"
    lines = [f"- {link(entry)}" if entry.suffix == ".py" or entry.name == "README.md" or (entry / "README.md").is_file()
             else f"- {entry.name}" for entry in inner]
    return reference.joined([f"# {name}/", "", *lines])
  language = "python" if path.suffix == ".py" else "text"
  return reference.joined([f"# {name}", "", f"````{language}", *path.read_text(encoding="utf-8").splitlines(), "````"])
