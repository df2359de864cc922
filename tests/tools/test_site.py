"""The site without its extra: the navigation names every page once, and every link leads to a page of the site."""
import re

import pytest

from tests.conftest import ROOT
from tools import reference
from tools.site import api, fields, links, nav, notebooks, viewers


@pytest.fixture(scope="module")
def navigation():
  return nav.flat(nav.build(api.configs()))


def test_the_navigation_names_every_page_once(navigation):
  assert len(set(navigation)) == len(navigation)
  missing = {*nav.pages(), *nav.notebooks()} - set(navigation)
  assert not missing, f"link them in docs/README.md or docs/lab/README.md: {sorted(missing)}"
  of_reference = {f"reference/{name}" for name in (*reference.pages(), *api.pages())}
  assert {page for page in navigation if page.startswith("reference/")} == of_reference


def test_every_page_of_the_navigation_exists(navigation):
  made = {f"reference/{name}" for name in api.pages()}
  for page in set(navigation) - made:
    assert any((folder / page).is_file() for folder in (ROOT / "docs", ROOT / "site", ROOT / "examples")), page


def test_every_link_of_the_site_leads_to_a_page():
  """Of docs/, of the pages in site/, of notebooks, and of what they link to elsewhere in the repository."""
  pages = [path.relative_to(ROOT).as_posix() for folder in ("docs", "site", "examples/notebooks")
           for path in sorted((ROOT / folder).rglob("*.md")) if "node_modules" not in path.parts]
  outside = nav.outside(pages)
  there = {nav.uri_of(path) for path in (*pages, *outside)}
  for path in (*pages, *(path for path in outside if path.endswith(".md"))):
    for target in nav.targets(ROOT / path):
      assert (ROOT / target).exists(), f"{path} links to {target}"
      uri = nav.uri_of(target)
      assert uri in there or (ROOT / "docs" / uri).is_file(), f"{path} links to {target}, which is not on the site"


def test_links_are_moved_with_their_page():
  text = "[a](../NOTICE) [b](training.md#x) [c](../README.md) [d](https://x.org)\n```\n[e](../NOTICE)\n```\n"
  moved = nav.relinked(text, "docs/models.md", "models.md")
  assert moved == ("[a](repository/NOTICE.md) [b](training.md#x) [c](index.md) [d](https://x.org)\n"
                   "```\n[e](../NOTICE)\n```\n")
  assert nav.relinked("[b](docs/training.md)", "CONTRIBUTING.md", "repository/CONTRIBUTING.md") == "[b](../training.md)"


def test_a_room_page_has_a_directive_for_each_name():
  page = api.room_page("motion_jax.nets")
  assert '<a id="causaldit"></a>\n\n::: motion_jax.nets.causal_dit.CausalDiT\n' in page
  assert page.count("\n::: ") == len(reference.public_names("motion_jax.nets"))


def test_a_name_is_described_on_one_page():
  """Of the rooms that have it the nearest; MkDocs refuses two descriptions of one name."""
  described = [line for room in reference.rooms() for line in api.room_page(room).splitlines()
               if line.startswith("::: ")]
  assert len(set(described)) == len(described)
  assert "[`motion_jax.data`](motion_jax.data.md#clip)" in api.room_page("motion_jax")


def test_a_config_page_states_fields_values_and_meanings():
  page = api.config_page("cmdm_denoiser")
  row = next(line for line in page.splitlines() if line.startswith("| `sampler.lag` |"))
  assert "`2`" in row
  row = next(line for line in page.splitlines() if line.startswith("| `model.depth` |"))
  assert "`8`" in row and "tiny: `1`" in row
  row = next(line for line in page.splitlines() if line.startswith("| `train.keep_last` |"))
  assert "how many training states stay" in row


def test_the_landing_page_names_what_the_model_in_the_tab_weighs(tmp_path):
  """Of the files that a visitor loads without WebGPU; a site without the tab's page has no field for it."""
  for name in ("index.html", "ort/a.wasm.gz", "ort/a.asyncify.wasm.gz", "ort/ort.webgpu.min.mjs"):
    (tmp_path / "tab" / name).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / "tab" / name).write_bytes(bytes(1_000_000))
  shown = viewers.tab(tmp_path / "tab")
  assert "loads 2 MB" in shown and 'action="try/index.html"' in shown and 'name="prompt"' in shown
  assert viewers.tab(tmp_path / "none") == ""
  script = (ROOT / "site" / "assets" / "site.js").read_text(encoding="utf-8")
  assert "form.try" in script and "<!-- tab -->" in (ROOT / "site" / "index.md").read_text(encoding="utf-8")


def test_a_draft_takes_what_an_earlier_build_kept(tmp_path, monkeypatch):
  monkeypatch.setattr(viewers, "KEPT", tmp_path)
  assert viewers.newest("walk") == ""
  (tmp_path / "walk-1a").write_text("kept", encoding="utf-8")
  assert viewers.newest("walk") == "kept" and viewers.newest("wal") == ""
  assert viewers.kept("wave", "code", lambda: "made") == viewers.newest("wave") == "made"
  path = notebooks.paths()[0]
  text, marks = notebooks.page(path, "[]")
  assert not marks and text.count("```python") == len(notebooks.blocks(path, "site"))


def test_dead_links_of_a_built_site_are_found(tmp_path):
  (tmp_path / "a").mkdir()
  (tmp_path / "index.html").write_text(
      '<h2 id="here">x</h2><a class="k" href="#here">1</a><a href="#gone">2</a><a href="a/">3</a><a href="a/#top">4</a>'
      '<a href="b/">5</a><iframe data-src="m.html"></iframe><a href="https://x.org/y">6</a><!-- <a href="no"> -->')
  (tmp_path / "a" / "index.html").write_text('<a href="../#here">1</a><a href="../#there">2</a>')
  assert links.dead(tmp_path) == ["a/index.html: ../#there", *(f"index.html: {link}" for link in (
      "#gone", "a/#top", "b/", "m.html"))]


def test_pages_that_docstrings_name_become_links():
  there = {"papers/cmdm.md", "README.md"}.__contains__
  text = "<p>(docs/papers/cmdm.md#masks), docs/README.md, docs/none.md</p><pre>docs/papers/cmdm.md</pre>"
  assert links.mentions(text, "reference/motion_jax/", there) == (
      '<p>(<a href="../../papers/cmdm/#masks">docs/papers/cmdm.md#masks</a>), '
      '<a href="../../manual/">docs/README.md</a>, docs/none.md</p><pre>docs/papers/cmdm.md</pre>')


def test_a_config_page_shows_every_value_in_its_row():
  page = api.config_page("cmdm_denoiser")
  rows = page.partition("| --- |")[2].partition("\n\n")[0].splitlines()[1:]
  assert "| `alignment_teacher` | `{}` |" in page and all(row.count(" | ") >= 2 for row in rows if row.strip())


def test_the_meanings_of_fields_are_of_fields_that_configs_have():
  named = {field for name in api.configs() for field in re.findall(r"(?m)^\| `([\w.]+)`", api.config_page(name))}
  assert set(fields.MEANINGS) <= named
