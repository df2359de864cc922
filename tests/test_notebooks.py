"""The notebooks of examples/ run from top to bottom at small sizes, and say how long they take and on what."""
import pytest

from tools.site import nav, notebooks

PATHS = notebooks.paths()
RUN = ("2_components",)  # test_smoke.py looks at the names in the others


@pytest.mark.parametrize("path", [pytest.param(path, id=path.stem, marks=pytest.mark.slow if path.stem in RUN else
                                               pytest.mark.exhaustive) for path in PATHS])
def test_a_notebook_runs(path, tmp_path, monkeypatch):
  monkeypatch.chdir(tmp_path)
  scope = {"__name__": "notebook"}
  for block in notebooks.blocks(path, "tests"):
    exec(compile(block, path.name, "exec"), scope)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_a_notebook_says_how_long_it_takes(path):
  text = path.read_text(encoding="utf-8")
  assert text.startswith("---\njupyter:\n") and "\n**Takes** " in text
  assert nav.uri_of(f"examples/notebooks/{path.name}") in nav.notebooks()


def test_choices_are_those_of_a_size():
  code = 'steps = 4000  # tests: 2, site: 60\nsize = "laptop"   # tests: "tiny"\nother = 3  # latents\n'
  assert notebooks.at_size(code, "tests") == (
      'steps = 2  # tests: 2, site: 60\nsize = "tiny"   # tests: "tiny"\nother = 3  # latents\n')
  assert notebooks.at_size(code, "site").startswith("steps = 60  #") and '"laptop"' in notebooks.at_size(code, "site")
