"""A griffe extension: docstrings as Markdown, in which drawings and tables whose spacing counts stay as they are.

A class gets its fields as a block behind its docstring, in place of a heading for each.
"""
import re
import textwrap

import griffe

_SPACED = re.compile(r"^ |\S {2,}\S|^[-|\d]|: *$", re.MULTILINE)  # columns, lists, drawings: not prose


def as_markdown(doc):
  """A docstring as Markdown: paragraphs of prose as such, all others word for word."""
  first, *rest = re.split(r"\n\s*\n", textwrap.dedent(doc).strip())
  made, kept = [" ".join(first.split())], []
  for paragraph in [*rest, None]:
    if paragraph is not None and _SPACED.search(paragraph):
      kept.append(paragraph)
      continue
    if kept:
      made.append("```text\n" + "\n\n".join(kept) + "\n```")
      kept = []
    if paragraph is not None:
      made.append(" ".join(paragraph.split()).replace("][", "]\\["))
  return "\n\n".join(made)


class Docstrings(griffe.Extension):
  """Rewrites each docstring once, when its object has been read."""

  def on_instance(self, *, obj, **_):
    if obj.docstring:
      obj.docstring.value = as_markdown(obj.docstring.value)

  def on_class_members(self, *, cls, **_):
    fields = [name for name, member in cls.members.items() if member.is_attribute and member.annotation
              and not member.docstring and "property" not in member.labels]
    shown = [f"{name}: {cls.members[name].annotation}" + (f" = {value}" if (value := cls.members[name].value) else "")
             for name in fields if not name.startswith("_")]
    for name in fields:
      del cls.members[name]
    if shown:
      before = f"{cls.docstring.value}\n\n" if cls.docstring else ""
      cls.docstring = griffe.Docstring(before + "\n".join(["```python", *shown, "```"]), parent=cls)
