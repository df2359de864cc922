"""Names of a package that are imported when they are first asked for: one module of it is read without the others."""
import importlib
import importlib.util


def names(where) -> dict[str, str]:
  """{name: module} of {module: "its names with spaces between"}."""
  return {name: module for module, said in where.items() for name in said.split()}


def find(package, where, name):
  """What `package.name` is, for the package's `__getattr__`: a name of where {name: module}, or a module itself."""
  if name not in where and not name.startswith("_") and importlib.util.find_spec(f"{package}.{name}"):
    return importlib.import_module(f"{package}.{name}")
  if name not in where:
    raise AttributeError(f"{package} has no {name!r}; it has {', '.join(sorted(where))}")
  return getattr(importlib.import_module(f"{package}.{where[name]}"), name)
