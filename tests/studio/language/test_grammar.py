"""The examples of docs/sentences.md are parsed as the page says, and each rule of the parser is needed for one."""
import re

import pytest

from motion_jax_studio.language import ellipsis, light_verbs, parse
from tests.conftest import ROOT

_EXAMPLE = re.compile(r"^(.+?)\s+→  (.+)$", re.MULTILINE)  # "sentence  →  parse", the parse also on a line of its own


@pytest.fixture(scope="module")
def examples():
  page = (ROOT / "docs" / "sentences.md").read_text(encoding="utf-8")
  return dict(_EXAMPLE.findall(page[page.index("## The grammar"):page.index("## Postures")]))


def _differing(examples):
  return {sentence: parsed for sentence in examples if (parsed := parse(sentence).summary) != examples[sentence]}


def test_sentences_are_parsed_as_the_page_says(examples):
  assert len(examples) > 100 and not _differing(examples)


@pytest.mark.parametrize("module, name", [
    (light_verbs, "_RULES"), (ellipsis, "_CONTINUATIONS"), (ellipsis, "_VERBLESS")])
def test_no_other_rule_does_what_a_rule_does(examples, monkeypatch, module, name):
  rules = getattr(module, name)
  for place, rule in enumerate(rules):
    monkeypatch.setattr(module, name, rules[:place] + rules[place + 1:])
    assert _differing(examples), rule.__name__
