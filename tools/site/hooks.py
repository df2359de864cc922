"""Hooks of `mkdocs build`: the navigation, pages made from the code, links that leave docs/, and motions that move."""
import functools
import pathlib
import shutil
import sys

from mkdocs.structure.files import File

sys.path.insert(0, str(pathlib.Path(__file__).parents[2]))
from tools.site import api, nav, viewers  # noqa: E402

ROOT, SITE = nav.ROOT, nav.ROOT / "site"
TRY = SITE / "try"  # the model in the visitor's own tab, a static page of its own


def on_config(config):
  """The navigation, from the tables of the manual and the lab notebook."""
  config.nav = nav.build(api.configs())
  return config


def on_files(files, config):
  """Adds pages that are not in docs/. docs/README.md is the manual's first page, not the site's."""
  manual = files.get_file_from_path("README.md")
  manual.dest_uri, manual.url = "manual/index.html", "manual/"
  origins = {file.src_uri: f"docs/{file.src_uri}" for file in files.documentation_pages()}

  def add(uri, text, origin=None):
    if old := files.get_file_from_path(uri):
      files.remove(old)
    files.append(File.generated(config, uri, content=text))
    if origin:
      origins[uri] = origin

  for path in sorted(SITE.glob("*.md")):
    add(path.name, path.read_text(encoding="utf-8").replace("<!-- gallery -->", viewers.gallery()), f"site/{path.name}")
  for path in sorted((SITE / "assets").iterdir()):
    add(f"assets/{path.name}", path.read_bytes())
  for name, text in made().items():
    add(name, text)
  for name in nav.outside(origins.values()):
    path = ROOT / name
    if path.suffix == ".md":
      add(nav.uri_of(name), path.read_text(encoding="utf-8"), name)
    else:
      add(nav.uri_of(name), api.source_of(path), name)
  config.extra["origins"] = origins
  return files


@functools.cache
def made():
  """{path on the site: contents} of what the library makes; once a process, so that `mkdocs serve` rebuilds quickly."""
  return {f"reference/{name}": text for name, text in api.pages().items()} | viewers.files()


def on_page_markdown(markdown, page, config, files):
  """Links as they are on the site; a column's bar within code is written without the backslash that GitHub needs."""
  origin = config.extra["origins"].get(page.file.src_uri)
  return nav.relinked(markdown, origin, page.file.src_uri) if origin else markdown


def on_post_build(config):
  """The page with the model in the tab, where it has been built."""
  if (TRY / "index.html").is_file():
    shutil.copytree(TRY, pathlib.Path(config.site_dir) / "try", dirs_exist_ok=True)
