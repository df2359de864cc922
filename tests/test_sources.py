"""What code and pages cite exists: headings of docs/papers, and the files and headings that pages link to."""
import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs" / "papers").glob("*.md"))
TEXT = {".py", ".md", ".sh", ".toml", ".json", ".html", ".css"}


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
  """Citations "docs/papers/PAGE.md#heading, #heading" of a text whose page or heading does not exist.

  pages: anchors by a page's name.
  """
  cited = re.findall(r"docs/papers/([\w-]+\.md)((?:(?:,\s+|\s+and\s+|;\s+)?#[\w-]+)*)", re.sub(r"\n *# +", "\n", text))
  return [page + anchor for page, headings in cited for anchor in re.findall(r"#[\w-]+", headings) or [""]
          if page not in pages or anchor and anchor[1:] not in pages[page]]


def private_citations(text):
  """Citations of notes outside the repository, such as "(facts: cmdm 2.4)" or "cdamd-facts 4.1"."""
  pattern = r"\bfacts\b[\s:=\"'#]*\b(?:cmdm|cdamd|control|quality)\b|\b(?:cmdm|cdamd|control|quality)-facts\b|\(facts:"
  return [" ".join(found.split()) for found in re.findall(pattern, text, re.IGNORECASE)]


PAGE_ANCHORS = {page.name: anchors(page.read_text()) for page in PAGES}


def test_anchors_are_those_of_github():
  text = "# A page\n## Frame-wise sampling (FSS)\n```\n# no heading\n```\n### Text\n### Text\n"
  assert anchors(text) == {"a-page", "frame-wise-sampling-fss", "text", "text-1"}


def test_a_dead_citation_is_found():
  text = "docs/papers/a.md#text, #texts, docs/papers/a.md#text and #tail; docs/papers/b.md. docs/papers/a.md,\n  # #end"
  assert dead_citations(text, {"a.md": {"text"}}) == ["a.md#texts", "a.md#tail", "b.md", "a.md#end"]
  text = "(facts: x), Facts:\n  # cmdm 2.4, cdamd-facts 4.1, facts=\"cmdm 6.3\"; the facts: none"
  assert private_citations(text) == ["(facts:", "Facts: # cmdm", "cdamd-facts", "facts=\"cmdm"]


def _found(search, *arguments):
  """What a search finds in the repository's files, by file."""
  return {str(path.relative_to(ROOT)): found for path in _files() if path != pathlib.Path(__file__)
          if (found := search(path.read_text(), *arguments))}


def test_every_cited_heading_exists():
  assert {"cmdm.md", "cdamd.md", "paper-and-code.md"} <= set(PAGE_ANCHORS)
  dead = _found(dead_citations, PAGE_ANCHORS)
  assert not dead, f"no such page or heading in docs/papers: {dead}"


def test_sources_lie_in_the_repository():
  private = _found(private_citations)
  assert not private, f"cite the paper's equation or a heading of docs/papers instead: {private}"


def test_every_promise_of_the_page_on_tests_has_its_proof():
  """The tests that its table names exist."""
  page = (ROOT / "docs" / "testing.md").read_text()
  rows = re.findall(r"(?m)^\| .* \| (`.*`) \| .* \|$", page.partition("## What is proved")[2].partition("\n## ")[0])
  named = {name for row in rows for name in re.findall(r"`([\w/.:]+)`", row)}
  for file, _, function in (name.partition("::") for name in named):
    path = ROOT / file if file.startswith("tools/") else ROOT / "tests" / file
    assert path.is_file() and f"def {function}(" in path.read_text() + "def (", f"no test {file}::{function}"
  assert len(rows) > 15


def test_paths_that_the_papers_pages_name_exist():
  named = {(page.name, name) for page in PAGES for name in re.findall(
      r"`((?:motion_jax|tests|benchmarks)/[\w/.-]+|configs/[\w/-]+\.py)`", page.read_text())}
  dead = sorted(f"{page} names {name}" for page, name in named if not (ROOT / name).exists())
  assert len(named) > 20 and not dead, "\n".join(dead)


LINKED = sorted({*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"),
                 *(ROOT / "motion_jax" / "pretrained").glob("*/README.md")})


def dead_links(page):
  """Relative links of a Markdown page whose file or heading does not exist."""
  text = re.sub(r"(?ms)^```.*?^```", "", page.read_text(encoding="utf-8"))
  dead = []
  for target in re.findall(r"\]\((?!\w+:)([^)\s]+)\)", text):
    name, _, heading = target.partition("#")
    path = page.parent / name if name else page
    if not path.exists() or heading and heading not in anchors(path.read_text(encoding="utf-8")):
      dead.append(target)
  return dead


def test_no_relative_link_is_dead():
  dead = [f"{page.relative_to(ROOT)} links to {link}" for page in LINKED for link in dead_links(page)]
  assert len(LINKED) > 60 and not dead, "\n".join(dead)


def test_dead_links_are_found(tmp_path):
  page = tmp_path / "page.md"
  page.write_text("# A heading\n[a](#a-heading) [b](#b) [c](page.md) [d](none.md) [e](https://x.org/y) ![f](g.png)\n")
  assert dead_links(page) == ["#b", "none.md", "g.png"]


def test_workflows_run_every_part_of_the_checks():
  """Those of .ci/run; what `python3.12` shows, library and application show on that version."""
  parts = re.search(r'(?m)^PARTS="(.*)"', (ROOT / ".ci" / "run").read_text())[1].split()
  texts = [path.read_text() for path in sorted((ROOT / ".github" / "workflows").glob("*.yml"))]
  called = {part for text in texts for words in re.findall(r"bash \.ci/run(.*)", text) for part in words.split()}
  assert called == set(parts) - {"python3.12"} and len(texts) == 8
  missing = [path for path in re.findall(r"\btests/[\w/*.]+", (ROOT / ".ci" / "run").read_text())
             if not list(ROOT.glob(path))]
  assert not missing
