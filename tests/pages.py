"""The pages of the manual, and what a reader would type from them."""
import pathlib
import re
import shlex
from collections.abc import Iterator

from tests.conftest import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
LANDING = ROOT / "site" / "index.md"  # of the site: what a newcomer types first is the README's
MORE = [ROOT / "CONTRIBUTING.md", ROOT / "docs" / "benchmark" / "README.md",
        *sorted((ROOT / "docs" / "papers").glob("*.md"))]  # pages with a command here and there
TYPED = ("control.md", "command-line.md")  # pages whose commands follow from one another
CARDS = sorted((ROOT / "motion_jax" / "pretrained").glob("*/README.md"))  # of the models that ship


def name_of(page: pathlib.Path) -> str:
  return page.parent.name if page in CARDS else page.stem


def blocks(page: pathlib.Path, language: str) -> list[str]:
  return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), flags=re.DOTALL)


def commands(page: pathlib.Path) -> Iterator[list[str]]:
  """The words of each command of a page that is one of ours, with what the block's variables stand for."""
  for block in blocks(page, "bash"):
    variables = {}
    for line in block.replace("\\\n", " ").splitlines():
      assigned = re.fullmatch(r'(\w+)="(.*)"', line)
      if assigned:
        variables["$" + assigned[1]] = shlex.split(assigned[2].replace('\\"', '"'), posix=False)
        continue
      for part in line.split(" && "):
        words = [word for written in shlex.split(part.rstrip().removesuffix("&"), comments=True)
                 for word in variables.get(written, [written])]
        if words and (words[0].endswith("motion-jax") or words[0].endswith("python") and words[1].endswith(".py")):
          yield words[1:] if words[0].endswith("python") else ["motion-jax", *words[1:]]


def shell_lines(page: pathlib.Path) -> Iterator[str]:
  """The lines of a page's bash blocks as a reader would type them, each with what it continues or reads to its END."""
  for block in blocks(page, "bash"):
    end = None
    lines = []
    for line in block.replace("\\\n", " ").splitlines():
      if end:
        lines[-1] += "\n" + line
        end = None if line == end else end
      elif line.strip():
        lines.append(line)
        here = re.search(r"<<'(\w+)'", line)
        end = here and here[1]
    yield from lines
