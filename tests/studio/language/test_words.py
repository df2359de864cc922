"""Words are read in one room: no other room of the application has patterns, or knows actions by their address."""
import re

import pytest

from motion_jax_studio.language.words import has_phrase, lookup, normalize, several_people, tokens, until
from tests.conftest import ROOT

ROOMS = ("checks", "planning", "posing", "blending.py", "constraining.py", "editing.py", "pipeline.py", "resampling.py",
         "steps.py", "streaming.py")
# Names of files and flags are no sentences: cli/control.py, cli/parser.py, cli/prompts.py, cli/shared.py,
# server/exporting.py and server/mmcp.py have patterns of their own.
_PATTERN, _IDENTITY = re.compile(r"^\s*(?:import re\b|from re import)", re.MULTILINE), re.compile(r"\bid\(")
STUDIO = ROOT / "motion_jax_studio"


def _files(room):
  return [STUDIO / room] if room.endswith(".py") else sorted((STUDIO / room).rglob("*.py"))


@pytest.mark.parametrize("room", ROOMS)
def test_no_regular_expression_outside_language(room):
  assert _files(room) and not [path.name for path in _files(room) if _PATTERN.search(path.read_text(encoding="utf-8"))]


def test_no_action_is_known_by_its_address():
  assert not [path.name for path in sorted(STUDIO.rglob("*.py")) if _IDENTITY.search(path.read_text(encoding="utf-8"))]


def test_phrases_are_whole_words_without_articles():
  text = normalize("Holds the arms out, at his sides.")
  assert text == " holds arms out , at sides " and tokens("A, b-c") == ("a", ",", "b-c")
  assert has_phrase(text, "at sides") and has_phrase(text, "side*") and not has_phrase(text, "at side, out at")
  assert lookup((("a", "at side"), ("b", "arms"), ("c", "holds")), text) == "b" and lookup((), text, "") == ""
  assert until(("walks", "with", "it"), {"with"}) == ("walks",) and until(("walks",), {"walks"}) == ("walks",)


def test_several_people_are_named():
  assert several_people("Two old men fight") == "Two old men" and several_people("a person waves at a friend")
  assert not several_people("a man walks and a dog barks")
