"""Additions by other packages: entry points of methods, data sets, representations, formats and protocols.

A package names them in its pyproject.toml, and nothing of motion_jax is edited (docs/adding.md):

  [project.entry-points."motion_jax.datasets"]
  my_dataset = "my_package.my_dataset:MyDataset"
"""
import functools
import importlib
import pathlib
import sys
from collections.abc import Callable, Iterator, MutableMapping
from typing import Any, TypeVar

T = TypeVar("T")


class Registry(MutableMapping[str, T]):
  """A table {name: object} of what is built in and what entry points of a group add.

  Built-in names win, and are found without a look at other packages. An entry point is imported when its object is
  first needed. read: makes the object of an entry point; by default what it names, a class called without arguments.
  """

  def __init__(self, group: str, known: dict[str, T], read: Callable[[Any], T] | None = None) -> None:
    self.group, self._known, self._read = group, known, read or _object

  def __getitem__(self, name: str) -> T:
    if name not in self._known:
      entry = _entry_points(self.group, tuple(sys.path))[name]
      try:
        self._known[name] = self._read(entry)
      except Exception as error:
        raise ImportError(f"got {type(error).__name__}: {error} from {entry.value}, the entry point {name!r} of "
                          f"{self.group}; update or uninstall the package that has it") from error
    return self._known[name]

  def __setitem__(self, name: str, value: T) -> None:
    self._known[name] = value

  def __delitem__(self, name: str) -> None:
    del self._known[name]

  def __contains__(self, name: object) -> bool:
    return name in self._known or name in _entry_points(self.group, tuple(sys.path))

  def __iter__(self) -> Iterator[str]:
    yield from dict.fromkeys([*self._known, *_entry_points(self.group, tuple(sys.path))])

  def __len__(self) -> int:
    return len(list(iter(self)))


def import_modules(config: Any) -> None:
  """Imports the modules that a config names as `module` and `data.module`, a name or several with commas between.

  A module adds to a registry when it is imported: DATASETS["my_dataset"] = MyDataset().
  """
  for section in (config, config.get("data", {})):
    for name in filter(None, str(section.get("module", "") or "").split(",")):
      try:
        importlib.import_module(name.strip())
      except ImportError as error:
        raise ValueError(f"got the module {name.strip()!r} in the config, which cannot be imported ({error}); install "
                         "its package or put its folder on PYTHONPATH") from error


def _object(entry):
  value = entry.load()
  return value() if isinstance(value, type) else value


@functools.lru_cache(maxsize=64)
def _entry_points(group, path):
  """{name: entry point} of a group; looked for once for each sys.path."""
  if not _may_be_added(group, path):
    return {}
  import importlib.metadata
  return {entry.name: entry for entry in importlib.metadata.entry_points(group=group)}


def _may_be_added(group, path):
  """Whether a package on sys.path may have entry points of a group; importing importlib.metadata would take longer."""
  tables = _tables_of_entry_points(path)
  return tables is None or any(f"[{group}]".encode() in table for table in tables)


@functools.lru_cache(maxsize=64)
def _tables_of_entry_points(path):
  """The entry points of the packages on sys.path, as bytes; None where only importlib.metadata can read them."""
  folders = [pathlib.Path(folder or ".") for folder in path]
  try:
    return None if any(folder.is_file() for folder in folders) else [
        table for folder in folders for file in folder.glob("*-info/entry_points.txt")
        if b"[motion_jax" in (table := file.read_bytes())]
  except OSError:
    return None
