"""Steps of a release, as .github/workflows/release.yml runs them.

  python tools/release.py check v0.2.0                           the tag, the files and the changelog agree
  python tools/release.py prepare https://HOST/OWNER/NAME v0.2.0   before a build: links that an index can follow

`prepare` writes the address of the repository, which no file of it states, into pyproject.toml and CITATION.cff, and
makes the links of README.md absolute. It is for a checkout that is built and then deleted.
"""
import argparse
import json
import os.path
import pathlib
import re

ROOT = pathlib.Path(__file__).parents[1]
VERSIONED = {  # {file: pattern of the version that it states}
    "motion_jax/__init__.py": r'(?m)^__version__ = "(.+)"$', "CITATION.cff": r"(?m)^version: (.+)$",
    ".zenodo.json": r'(?m)^ "version": "(.+)",$', "CHANGELOG.md": r"(?m)^## (\S+)"}
_LINK = re.compile(r"(!?)(\[(?:[^\]\[]|\[[^\]]*\])*\]\()(?!\w+:|#)([^)\s]+)\)")


def versions(root=ROOT):
  """{file: the version that it states}; "" for a file that states none."""
  texts = {path: (root / path).read_text(encoding="utf-8") for path in VERSIONED}
  matches = {path: re.search(VERSIONED[path], text) for path, text in texts.items()}
  return {path: match[1] if match else "" for path, match in matches.items()}


def faults(tag, root=ROOT):
  """Sentences about what is not ready for a release with this tag."""
  lines = [f"{path} states version {version or 'nothing'}, the tag is {tag}"
           for path, version in versions(root).items() if f"v{version}" != tag]
  changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
  if "(unreleased)" in changelog or "Nothing has been released" in changelog:
    lines.append('CHANGELOG.md says "(unreleased)" or "Nothing has been released": write the date')
  if "is not released yet" in (root / "docs" / "stability.md").read_text(encoding="utf-8"):
    lines.append("docs/stability.md says that the version is not released yet")
  return lines


def absolute_links(text, repository, tag):
  """A Markdown text of the repository's root with addresses for its relative links and pictures."""
  def address(link):
    picture, label, target = link.groups()
    path, *heading = target.split("#")
    place = "#".join([os.path.normpath(path), *heading])
    return f"{picture}{label}{repository}/{'raw' if picture else 'blob'}/{tag}/{place})"

  pieces = re.split(r"(?ms)(^```.*?^```)", text)
  return "".join(piece if piece.startswith("```") else _LINK.sub(address, piece) for piece in pieces)


def prepare(repository, tag, root=ROOT):
  """Writes the repository's address into the files that a package is built from. Raises SystemExit the second time."""
  repository = repository.rstrip("/")
  project = (root / "pyproject.toml").read_text(encoding="utf-8")
  if "[project.urls]" in project:
    raise SystemExit("pyproject.toml has [project.urls] already: prepare a fresh checkout")
  urls = {"Repository": repository, "Documentation": f"{repository}/blob/{tag}/docs/README.md",
          "Changelog": f"{repository}/blob/{tag}/CHANGELOG.md", "Issues": f"{repository}/issues"}
  table = "[project.urls]\n" + "".join(f"{name} = {json.dumps(url)}\n" for name, url in urls.items())
  (root / "pyproject.toml").write_text(
      project.replace("[project.scripts]", f"{table}\n[project.scripts]", 1), encoding="utf-8")
  citation = root / "CITATION.cff"
  citation.write_text(citation.read_text(encoding="utf-8").replace(
      "type: software\n", f"type: software\nrepository-code: {json.dumps(repository)}\n", 1), encoding="utf-8")
  readme = root / "README.md"
  readme.write_text(absolute_links(readme.read_text(encoding="utf-8"), repository, tag), encoding="utf-8")


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  commands = parser.add_subparsers(dest="command", required=True)
  commands.add_parser("check").add_argument("tag")
  preparing = commands.add_parser("prepare")
  preparing.add_argument("repository")
  preparing.add_argument("tag")
  args = parser.parse_args()
  if args.command == "prepare":
    prepare(args.repository, args.tag)
  elif lines := faults(args.tag):
    raise SystemExit("\n".join(lines))


if __name__ == "__main__":
  main()
