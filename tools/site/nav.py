"""The site's navigation, read from the tables of docs/README.md and docs/lab/README.md, and the repository's links.

Needs nothing that is not in the standard library, so that tests check it without the extra `docs`.
"""
import os.path
import pathlib
import re

from tools.site import reference

ROOT = pathlib.Path(__file__).parents[2]
DOCS, NOTEBOOKS = ROOT / "docs", ROOT / "examples" / "notebooks"
LINK = re.compile(r"(\]\()(?!\w+:|#)([^)#\s]+)")  # a relative link's target, without its heading


def prose(text):
  """A Markdown text without its code blocks."""
  return re.sub(r"(?ms)^```.*?^```", "", text)


def targets(path):
  """Files and folders of the repository that a page links to, as paths relative to it, in order."""
  folder = path.parent
  paths = [os.path.relpath(os.path.normpath(folder / target), ROOT)
           for _, target in LINK.findall(prose(path.read_text(encoding="utf-8")))]
  return list(dict.fromkeys(paths))


def uri_of(path):
  """Where a file or folder of the repository stands on the site, such as "papers/cmdm.md" of "docs/papers/cmdm.md"."""
  if path == "README.md":
    return "index.md"
  for folder in ("docs", "site"):
    if path.startswith(f"{folder}/") and (ROOT / path).is_file() and (folder == "docs" or path.endswith(".md")):
      return path.removeprefix(f"{folder}/")
  if path.startswith("examples/notebooks/") and path.endswith(".md"):
    return path.removeprefix("examples/")
  return f"repository/{path if path.endswith('.md') else path + '.md'}"


def relinked(text, path, uri):
  """The text of a repository's page with its links as they are on the site, where the page is `uri`."""
  def moved(link):
    target = os.path.relpath(os.path.normpath(ROOT / pathlib.Path(path).parent / link[2]), ROOT)
    return link[1] + os.path.relpath(uri_of(target), pathlib.PurePosixPath(uri).parent)

  pieces = re.split(r"(?ms)(^```.*?^```)", text)
  return "".join(piece if piece.startswith("```") else LINK.sub(moved, piece) for piece in pieces)


def outside(paths):
  """Files and folders that pages link to and that are no pages by themselves, and those that these link to in turn."""
  linked, queue = [], list(paths)
  while queue:
    for target in targets(ROOT / queue.pop()):
      if uri_of(target).startswith("repository/") and target not in linked:
        linked.append(target)
        if (ROOT / target).is_dir():
          folder = ROOT / target
          inner = [path.relative_to(ROOT).as_posix() for path in (*sorted(folder.glob("*.py")),
                                                                  *sorted(folder.rglob("README.md")))]
          linked += [path for path in inner if path not in linked and uri_of(path).startswith("repository/")]
          queue += [path for path in inner if path.endswith(".md")]
        elif target.endswith(".md"):
          queue.append(target)
  return linked


def notebooks():
  """The notebooks of examples/notebooks in the order of their names, as pages of the site."""
  return [uri_of(path.relative_to(ROOT).as_posix()) for path in sorted(NOTEBOOKS.glob("*.md"))]


def pages():
  """The pages of docs/ that are written by hand or reports of ours, as pages of the site."""
  return sorted(path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")
                if path.read_text(encoding="utf-8").startswith("# "))


def _linked(page, section=None):
  """Pages of docs/ that a page, or one of its sections, links to."""
  text = prose((DOCS / page).read_text(encoding="utf-8"))
  if section:
    text = re.split(r"(?m)^## ", text.partition(f"## {section}\n")[2])[0]
  folder = pathlib.PurePosixPath(page).parent
  paths = [os.path.normpath(folder / target) for _, target in LINK.findall(text) if target.endswith(".md")]
  return list(dict.fromkeys(target for target in paths if not target.startswith("..")))


def build(configs=()):
  """The value of `nav` in mkdocs.yml: every page once. configs: names of the pages of configs."""
  sections = re.findall(r"(?m)^## (.+)$", (DOCS / "README.md").read_text(encoding="utf-8"))
  of_section = {section: _linked("README.md", section) for section in sections}
  apart = [page for pages_ in of_section.values() for page in pages_ if "/" in page]
  lab = [page for page in _linked("lab/README.md") if page not in ("README.md", "lab/README.md")]
  lab += [page for page in apart if page.startswith("benchmark/") and page not in lab]
  return [
      {"Home": "index.md"},
      {"Gallery": "gallery.md"},
      {"Manual": [{"Overview": "README.md"}, *(
          {section: [page for page in linked if "/" not in page and page != "reference.md"]}
          for section, linked in of_section.items())]},
      *([{"Notebooks": notebooks()}] if notebooks() else []),
      {"Reference": ["reference.md",
                     {"Packages": [f"reference/{room}.md" for room in reference.rooms()]},
                     {"Commands": [f"reference/{page}" for page in sorted(reference.command_pages())]},
                     *([{"Configs": [f"reference/configs/{name}.md" for name in configs]}] if configs else [])]},
      {"Papers": [page for page in apart if page.startswith("papers/")]},
      {"Lab notebook": ["lab/README.md", *lab]}]


def flat(nav):
  """The pages of a navigation in order."""
  if isinstance(nav, str):
    return [nav]
  return [page for entry in (nav.values() if isinstance(nav, dict) else nav) for page in flat(entry)]
