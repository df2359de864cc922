"""docs/reference says what the code says: no page is stale, public names have docstrings, every flag is there."""
import ast

import pytest

from tests.conftest import ROOT
from tools import drawings, reference, sentences_page


@pytest.fixture(scope="module")
def made():
  return reference.pages()


def test_the_pages_are_up_to_date(made):
  """The reference, and the grammar in docs/sentences.md."""
  stale = reference.stale(made)
  assert not stale, f"run python tools/reference.py: {stale}"
  assert sentences_page.made() == sentences_page.PAGE.read_text(encoding="utf-8"), "run python tools/sentences_page.py"


@pytest.mark.slow
def test_the_drawings_are_up_to_date():
  drawn = {path.name: path.read_text(encoding="utf-8") for path in drawings.OUT.glob("*.svg")}
  assert drawings.drawings() == drawn, "run python tools/drawings.py"


def test_public_names_have_docstrings():
  assert not reference.undocumented()


def test_every_name_and_flag_stands_in_its_page(made):
  missing = {name for name, page in made.items() if str(ROOT) in page}
  for room in ("nets", "quant", "diffusion", "motion", "metrics", "text", "control", "data", "export"):
    missing |= {name for name in reference.public_names(f"motion_jax.{room}")
                if f"## {name}\n" not in made[f"motion_jax.{room}.md"]}
  for name, (parser, _) in reference.commands().items():
    page = made[f"commands/{name.replace(' ', '-')}.md"]
    missing |= {(name, flag) for action in parser._actions for flag in action.option_strings
                if action.help not in (None, "==SUPPRESS==") and action.dest != "help" and flag not in page}
  assert not missing


def test_signatures_are_those_of_the_source():
  node = ast.parse('def f(x: Float[Array, "b l c"], *, scale=1.0) -> int: pass').body[0]
  assert reference.signature(node) == "(x: Float[Array, 'b l c'], *, scale=1.0) -> int"


def test_a_name_that_is_defined_nowhere_is_refused():
  with pytest.raises(LookupError, match="motion_jax.nets.__all__ names 'CausalDoT'"):
    reference.resolve("motion_jax.nets", "CausalDoT")
