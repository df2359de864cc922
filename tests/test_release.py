"""What a release states in several places is the same everywhere: versions, licences, ranges of dependencies."""
import re
import tomllib

import motion_jax
from tests.conftest import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def text_of(path):
  return (ROOT / path).read_text(encoding="utf-8")


def table_row(page, name):
  """The cells of the row of a Markdown table that begins with a name."""
  return re.search(rf"(?m)^\| {re.escape(name)} \|(.*)\|$", text_of(page))[1]


def test_versions_of_the_stability_page_are_those_of_the_project_and_of_ci():
  page = "docs/stability.md"
  ranges = dict(re.match(r"([\w.-]+)(.*)", dependency).groups() for dependency in PROJECT["dependencies"])
  for name in ("jax", "flax"):
    assert f"`{ranges[name]}`" in table_row(page, name)
    locked = re.findall(rf"(?m)^{name}==(\S+)", text_of(".ci/constraints.txt"))
    assert len(locked) == 2 and re.findall(r"with (?:Python )?3\.1[12]: ([\d.]+\d)", table_row(page, name)) == locked
    lowest = re.match(r">=([\d.]+)", ranges[name])[1]
    assert lowest == locked[0]  # CI tests the lower bound
  python = PROJECT["requires-python"].removeprefix(">=")
  assert f"{python} or newer" in table_row(page, "Python") and f"Python {python} or newer" in text_of("README.md")
  tested = re.findall(r'python: \[(.*)\]', text_of(".github/workflows/library.yml"))[0].replace('"', "")
  assert tested.replace(", ", " and ") in table_row(page, "Python")


def test_the_stability_page_speaks_of_this_version():
  assert f"Version {motion_jax.__version__} is not released yet" in text_of("docs/stability.md")
  assert re.search(r"(?m)^## (\S+)", text_of("CHANGELOG.md"))[1] == motion_jax.__version__
