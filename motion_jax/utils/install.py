"""Commands that install extras, for hints in errors and pages."""

SOURCE = "."  # what pip is given in a clone of the repository, until the package stands in an index


def pip_install(extra) -> str:
  """The command that adds an extra of pyproject.toml, as a hint of an error or a page has it."""
  return f'pip install -q "{SOURCE}[{extra}]" (in a clone of motion-jax)'
