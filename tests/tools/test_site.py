"""The site without its extra: the navigation names every page once, and every link leads to a page of the site."""
import re

import pytest

from tests.conftest import ROOT
from tools import build_docs, drawings
from tools.site import api, fields, links, nav, notebooks, reference, viewers


@pytest.fixture(scope="module")
def navigation():
  return nav.flat(nav.build(api.configs()))


@pytest.fixture(scope="module")
def generated():
  """{page of the site: text} of the reference."""
  return {f"reference/{name}": text for name, text in api.pages().items()}


def test_the_navigation_names_every_page_once(navigation, generated):
  assert len(set(navigation)) == len(navigation)
  missing = {*nav.pages(), *nav.notebooks()} - set(navigation)
  assert not missing, f"link them in docs/README.md or docs/lab/README.md: {sorted(missing)}"
  assert {page for page in navigation if page.startswith("reference/")} == set(generated)


def test_every_page_of_the_navigation_exists(navigation, generated):
  for page in set(navigation) - set(generated):
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


def test_a_name_is_described_on_one_page():
  """Of the rooms that have it the nearest; MkDocs refuses two descriptions of one name."""
  rooms = {room: api.room_page(room) for room in reference.rooms()}
  described = [line for page in rooms.values() for line in page.splitlines() if line.startswith("::: ")]
  assert len(set(described)) == len(described)
  nets = rooms["motion_jax.nets"]
  assert '<a id="causaldit"></a>\n\n::: motion_jax.nets.causal_dit.CausalDiT\n' in nets
  assert nets.count("\n::: ") == len(reference.public_names("motion_jax.nets"))
  assert "[`motion_jax.data`](motion_jax.data.md#clip)" in rooms["motion_jax"]


def test_a_config_page_states_fields_values_and_meanings():
  pages = {name: api.config_page(name) for name in api.configs()}
  rows = {match[1]: match[0] for match in re.finditer(r"(?m)^\| `([\w.]+)`.*", pages["cmdm_denoiser"])}
  assert "`8`" in rows["model.depth"] and "tiny: `1`" in rows["model.depth"] and "`2`" in rows["sampler.lag"]
  assert "how many training states stay" in rows["train.keep_last"] and "| `{}` |" in rows["alignment_teacher"]
  assert all(row.count(" | ") >= 2 for row in rows.values())
  assert set(fields.MEANINGS) <= {name for page in pages.values() for name in re.findall(r"(?m)^\| `([\w.]+)`", page)}


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


# --- generated files in git ------------------------------------------------------------------------------------------

HINT = "run python tools/build_docs.py --files"


@pytest.mark.slow
def test_the_drawings_are_those_of_the_code():
  shown = {path.name: path.read_text(encoding="utf-8") for path in drawings.OUT.glob("*.svg")}
  assert drawings.drawings() == shown, HINT


def test_the_viewer_was_built_from_its_source():
  """By digests, without node; `tools/build_docs.py --check` builds it again and compares the bytes."""
  viewer = build_docs.VIEWER.read_bytes()
  assert build_docs.viewer_digests(viewer) == build_docs.RECORD.read_text(), HINT
  assert build_docs.viewer_digests(viewer + b" ") != build_docs.RECORD.read_text()


# --- the reference ---------------------------------------------------------------------------------------------------


def test_public_names_have_docstrings():
  assert not reference.undocumented()


def test_every_name_and_flag_has_its_place_in_the_reference(generated):
  missing = {name for name, page in generated.items() if str(ROOT) in page}
  for room in reference.rooms():
    page = generated[f"reference/{room}.md"]
    missing |= {f"{room}.{name}" for name in reference.public_names(room)
                if f"## {name}\n" not in page and f'<a id="{name.lower()}"></a>' not in page}
  for name, (parser, _) in reference.commands().items():
    page = generated[f"reference/commands/{name.replace(' ', '-')}.md"]
    missing |= {(name, flag) for action in parser._actions for flag in action.option_strings
                if action.help not in (None, "==SUPPRESS==") and action.dest != "help" and flag not in page}
  assert not missing


def test_the_page_of_the_reference_has_room_for_its_tables():
  text = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
  for name, table in reference.tables().items():
    assert text.count(f"<!-- {name}: a table on the site -->") == 1
    assert {target for _, target in nav.LINK.findall(table)} <= {f"reference/{page}" for page in api.pages()}


def test_a_name_that_is_defined_nowhere_is_refused():
  with pytest.raises(LookupError, match="motion_jax.nets.__all__ names 'CausalDoT'"):
    reference.resolve("motion_jax.nets", "CausalDoT")
