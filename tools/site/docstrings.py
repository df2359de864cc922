"""A griffe extension: docstrings as Markdown, in which drawings and tables whose spacing counts stay as they are.

A class gets its fields as a block behind its docstring, in place of a heading for each.
"""
import griffe

from tools.site.api import as_markdown


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
