"""What the code cites can be found: docs/papers has every heading that is cited, and its links lead on."""
import pathlib
import re
import subprocess

import pytest

ROOT = pathlib.Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs" / "papers").glob("*.md"))
TEXT = {".py", ".md", ".sh", ".toml", ".html", ".js", ".css"}


def _files():
  """The repository's own text files; without git, all that lie there."""
  listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
  names = listed.stdout.splitlines() if listed.returncode == 0 else [p.relative_to(ROOT) for p in ROOT.rglob("*")]
  paths = (ROOT / name for name in names)
  return [path for path in paths if path.suffix in TEXT and path.is_file()]


def anchors(text):
  """The names by which GitHub links to the headings of a Markdown page."""
  text = re.sub(r"(?ms)^```.*?^```", "", text)
  slugs, seen = set(), {}
  for heading in re.findall(r"(?m)^#{1,6} +(.+?) *$", text):
    slug = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
    count = seen.get(slug, 0)
    seen[slug] = count + 1
    slugs.add(f"{slug}-{count}" if count else slug)
  return slugs


def dead_citations(text, pages):
  """Citations "cmdm.md#heading" in a text whose page or heading does not exist. pages: anchors by a page's name."""
  cited = re.findall(r"\b([\w-]+\.md)#([\w-]+)", text)
  return [f"{page}#{anchor}" for page, anchor in cited if page in pages and anchor not in pages[page]]


PAGE_ANCHORS = {page.name: anchors(page.read_text()) for page in PAGES}


def test_anchors_are_those_of_github():
  text = "# A page\n## Frame-wise sampling (FSS)\n```\n# no heading\n```\n### Text\n### Text\n"
  assert anchors(text) == {"a-page", "frame-wise-sampling-fss", "text", "text-1"}
  assert dead_citations("docs/papers/a.md#text, a.md#texts, b.md#c", {"a.md": {"text"}}) == ["a.md#texts"]


def test_every_cited_heading_exists():
  assert {"cmdm.md", "cdamd.md", "paper-and-code.md"} <= set(PAGE_ANCHORS)
  dead = {str(path.relative_to(ROOT)): found for path in _files() if path != pathlib.Path(__file__)
          if (found := dead_citations(path.read_text(), PAGE_ANCHORS))}
  assert not dead, f"no such heading in docs/papers: {dead}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_and_paths_of_a_page_lead_somewhere(page):
  """Links inside a page and to its neighbours; files and folders of this repository that it names."""
  text = page.read_text()
  for target in re.findall(r"\]\((?!http)([^)]+)\)", text):
    name, _, anchor = target.partition("#")
    path = (page.parent / name).resolve() if name else page
    assert path.exists(), f"{page.name} links to {target}"
    assert not anchor or anchor in PAGE_ANCHORS[path.name], f"{page.name} links to {target}"
  for name in re.findall(r"`((?:motion_jax|tests|benchmarks)/[\w/.-]+|configs/[\w/-]+\.py)`", text):
    assert (ROOT / name).exists(), f"{page.name} names {name}"
