"""Builds everything that is generated from the code: the site, and the few generated files that are in git.

  python tools/build_docs.py             writes the files in git, then the site with the model for a browser tab
  python tools/build_docs.py --files     writes the files in git alone: seconds
  python tools/build_docs.py --draft     writes the site alone, with outputs of an earlier build: about a minute
  python tools/build_docs.py --check     writes nothing; names files in git that are out of date and exits with 1

In git: the drawings of docs/papers, and motion_jax/export/assets/viewer.js, which `pip install .` of a clone needs
where there is no node. On the site alone: reference, gallery, outputs of notebooks.
The site needs the extra `docs`; the viewer and the tab need node and npm, the tab the extra `onnx` as well.
"""
import argparse
import hashlib
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from tools import drawings  # noqa: E402

VIEWER, VIEWER_SOURCE = ROOT / "motion_jax" / "export" / "assets" / "viewer.js", ROOT / "tools" / "viewer"
RECORD = VIEWER_SOURCE / "built.txt"  # digests of the viewer's source and of the viewer that was built from it
TAB = ROOT / "build" / "tab"


def viewer_digests(viewer):
  """The text of `RECORD` for the viewer's source as it is now and a built viewer (bytes)."""
  files = [VIEWER_SOURCE / "package.json", VIEWER_SOURCE / "build.sh", *sorted((VIEWER_SOURCE / "src").glob("*.js"))]
  source = hashlib.sha256(b"\0".join(path.name.encode() + b"\0" + path.read_bytes() for path in files))
  return f"source {source.hexdigest()}\nviewer {hashlib.sha256(viewer).hexdigest()}\n"


def built_viewer():
  """The viewer (bytes) bundled from its source by node; three.js and esbuild come from npm, in fixed versions."""
  with tempfile.TemporaryDirectory() as folder:
    shutil.copytree(VIEWER_SOURCE, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("node_modules"))
    subprocess.run(["npm", "install", "--no-package-lock", "--silent"], cwd=folder, check=True)
    subprocess.run(["sh", "build.sh", "viewer.js"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return pathlib.Path(folder, "viewer.js").read_bytes()


def pages():
  """{path: contents} of the generated drawings that the pages on the papers show."""
  return {drawings.OUT / name: drawing.encode() for name, drawing in drawings.drawings().items()}


def files():
  """{path: contents} of all generated files that are in git; without npm, the viewer's are left out with a note."""
  if not shutil.which("npm"):
    print("the viewer is left out: it needs node and npm", file=sys.stderr)
    return pages()
  viewer = built_viewer()
  return pages() | {VIEWER: viewer, RECORD: viewer_digests(viewer).encode()}


def stale(contents):
  """Paths of `contents` whose file differs or is missing, and drawings that nothing draws any more."""
  differ = [path for path, content in contents.items() if not path.is_file() or path.read_bytes() != content]
  return sorted([*differ, *(set(drawings.OUT.glob("*.svg")) - set(contents))])


def write(contents):
  """Writes what is stale and deletes what is no longer generated."""
  for path in stale(contents):
    print(f"{'wrote' if path in contents else 'deleted'} {path.relative_to(ROOT)}")
    if path in contents:
      path.write_bytes(contents[path])
    else:
      path.unlink()


def main(argv=None):
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  kind = parser.add_mutually_exclusive_group()
  kind.add_argument("--check", action="store_true", help="write nothing and name the files in git that are out of date")
  kind.add_argument("--files", action="store_true", help="write the files in git and no site")
  kind.add_argument("--draft", action="store_true", help="write the site alone, with outputs of an earlier build")
  args = parser.parse_args(argv)
  if args.check:
    differ = stale(files())
    print(*(path.relative_to(ROOT) for path in differ), sep="\n", end="\n" * bool(differ))
    return int(bool(differ))
  if not args.draft:
    write(files())
    if args.files:
      return 0
    if shutil.which("npm"):
      subprocess.run([sys.executable, "site/try/build.py", str(TAB)], cwd=ROOT, check=True)
  environment = os.environ | {"SITE_DRAFT": "1" if args.draft else "", "NO_MKDOCS_2_WARNING": "1"}
  return subprocess.run([sys.executable, "-m", "mkdocs", "build", "--strict"], cwd=ROOT, env=environment).returncode


if __name__ == "__main__":
  sys.exit(main())
