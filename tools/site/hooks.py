"""Hooks of `mkdocs build`: the navigation, pages made from the code, links that leave docs/, and motions that move."""
import functools
import logging
import os
import pathlib
import shutil
import sys

from mkdocs.structure.files import File

sys.path.insert(0, str(pathlib.Path(__file__).parents[2]))
from motion_jax import look  # noqa: E402
from tools.site import api, links, nav, notebooks, reference, viewers  # noqa: E402

ROOT, SITE = nav.ROOT, nav.ROOT / "site"
TAB = ROOT / "build" / "tab"  # the model in the visitor's own tab, built by `python site/try/build.py build/tab`


DRAFT = os.environ.get("SITE_DRAFT", "") or "serve" in sys.argv  # outputs of any earlier build, or none


def on_config(config):
  """The navigation, from the tables of the manual and the lab notebook."""
  config.nav = nav.build(api.configs())
  return config


def on_files(files, config):
  """Adds pages that are not in docs/. docs/README.md is the manual's first page, not the site's."""
  manual = files.get_file_from_path("README.md")
  manual.dest_uri, manual.url = "manual/index.html", "manual/"
  shown = {}
  origins = {file.src_uri: f"docs/{file.src_uri}" for file in files.documentation_pages()}

  def add(uri, text, origin=None):
    if old := files.get_file_from_path(uri):
      files.remove(old)
    files.append(File.generated(config, uri, content=text))
    if origin:
      origins[uri] = origin

  for path in sorted(SITE.glob("*.md")):
    text = path.read_text(encoding="utf-8").replace("<!-- gallery -->", viewers.gallery())
    add(path.name, text.replace("<!-- tab -->", viewers.tab(TAB)), f"site/{path.name}")
  for path in sorted((SITE / "assets").iterdir()):
    add(f"assets/{path.name}", path.read_bytes())
  add("assets/colors.css", "".join(f'[data-md-color-scheme="{scheme}"], [data-md-color-scheme="{scheme}"] .mj-drawing '
                                   f'{{ {look.variables(colors, "--mj-")} }}\n'
                                   for scheme, colors in (("default", look.LIGHT), ("slate", look.DARK))))
  for name, text in made().items():
    add(name, text)
  for path in notebooks.paths():
    code = "\n".join(notebooks.blocks(path, "site"))
    results = (viewers.newest(path.stem) or "[]") if DRAFT else viewers.kept(
        path.stem, code, functools.partial(notebooks.outputs, path))
    text, outputs = notebooks.page(path, results)
    name = path.relative_to(ROOT).as_posix()
    add(nav.uri_of(name), text, name)
    shown[nav.uri_of(name)] = outputs
  for name in nav.outside(origins.values()):
    path = ROOT / name
    if path.suffix == ".md":
      add(nav.uri_of(name), path.read_text(encoding="utf-8"), name)
    else:
      add(nav.uri_of(name), api.source_of(path), name)
  config.extra.update(origins=origins, shown=shown)
  return files


@functools.cache
def made():
  """{path on the site: contents} of what the library makes; once a process, so that `mkdocs serve` rebuilds quickly."""
  return {f"reference/{name}": text for name, text in api.pages().items()} | viewers.files(DRAFT)


def on_page_markdown(markdown, page, config, files):
  """Links as they are on the site; a column's bar within code is written without the backslash that GitHub needs."""
  origin = config.extra["origins"].get(page.file.src_uri)
  markdown = nav.relinked(markdown, origin, page.file.src_uri) if origin else markdown
  if page.file.src_uri == "reference.md":
    for name, table in reference.tables().items():
      markdown = markdown.replace(f"<!-- {name}: a table on the site -->", table)
  return markdown


def on_page_content(content, page, config, files):
  """Pages that docstrings name become links; the outputs of a notebook stand in place of their marks."""
  if page.file.src_uri.startswith("reference/"):
    content = links.mentions(content, page.url, lambda name: files.get_file_from_path(name) is not None)
  for mark, output in config.extra["shown"].get(page.file.src_uri, {}).items():
    content = content.replace(mark, output)
  return content


def on_post_build(config):
  """The page with the model in the tab, where it has been built. Then warns of dead links, which --strict refuses."""
  if TAB.is_dir():
    shutil.copytree(TAB, pathlib.Path(config.site_dir) / "try", dirs_exist_ok=True)
  for link in links.dead(config.site_dir):
    logging.getLogger("mkdocs.plugins.links").warning("dead link in %s", link)
