"""docs/reference says what the code says: no page is stale, public names have docstrings, every flag is there."""
import ast

import pytest

from tests.conftest import ROOT
from tools import reference


@pytest.fixture(scope="module")
def made():
  return reference.pages()


def test_the_pages_are_up_to_date(made):
  differ = reference.stale(made)
  assert not differ, f"run python tools/reference.py: {differ}"


def test_public_names_have_docstrings():
  assert not reference.undocumented()


def test_every_component_room_has_a_page(made):
  for room in ("nets", "quant", "diffusion", "motion", "metrics", "text", "control", "data", "export"):
    page = made[f"motion_jax.{room}.md"]
    assert all(f"## {name}\n" in page for name in reference.public_names(f"motion_jax.{room}")), room


def test_every_flag_stands_in_the_page_of_its_command(made):
  for name, (parser, _) in reference.commands().items():
    page = made[f"commands/{name.replace(' ', '-')}.md"]
    missing = [flag for action in parser._actions if action.help not in (None, "==SUPPRESS==") and action.dest != "help"
               for flag in action.option_strings if flag not in page]
    assert not missing, (name, missing)


def test_signatures_are_those_of_the_source():
  node = ast.parse('def f(x: Float[Array, "b l c"], *, scale=1.0) -> int: pass').body[0]
  assert reference.signature(node) == "(x: Float[Array, 'b l c'], *, scale=1.0) -> int"


def test_a_name_that_is_defined_nowhere_is_refused():
  with pytest.raises(LookupError, match="motion_jax.nets.__all__ names 'CausalDoT'"):
    reference.resolve("motion_jax.nets", "CausalDoT")


def test_pages_do_not_name_this_machine(made):
  assert not [name for name, page in made.items() if str(ROOT) in page]
