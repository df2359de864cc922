"""Sentences that differ in one word: nothing else differs, what counts is marked, and no held-out word is said."""
import importlib
import re
import sys

import pytest

from tests.conftest import ROOT


@pytest.fixture(scope="module")
def tools():
  """The two grammars, which import each other by their plain names as tools do."""
  sys.path.insert(0, str(ROOT / "tools"))
  try:
    yield importlib.import_module("contrast_sentences"), importlib.import_module("movement_sentences")
  finally:
    sys.path.remove(str(ROOT / "tools"))


def test_pairs_differ_in_the_gap_alone(tools):
  contrasts, _ = tools
  found = contrasts.pairs(20 * len(contrasts.CONTRASTS), seed=3)
  assert found == contrasts.pairs(20 * len(contrasts.CONTRASTS), seed=3)
  assert {name for name, *_ in found} == set(contrasts.CONTRASTS)
  for name, one, other, alike in found:
    meanings = [meaning.replace("*", "").split(";") for meaning in contrasts.CONTRASTS[name].meanings]
    # What is left of both where a phrase of a meaning is taken out: the same, by phrases of one meaning or of two.
    left = [{(marked.text[:place.start()] + "{x}" + marked.text[place.end():], number)
             for number, meaning in enumerate(meanings) for phrase in meaning
             for place in re.finditer(re.escape(phrase.strip()), marked.text)} for marked in (one, other)]
    assert one.text != other.text
    assert any(text == also and (number == its) == alike for text, number in left[0] for also, its in left[1])
    assert all(re.fullmatch(r"[\w-]+", marked.text[a:b]) for marked in (one, other) for a, b in marked.spans)
    assert one.spans and other.spans and "*" not in one.text + other.text


def test_a_marked_phrase_counts_by_its_marks(tools):
  contrasts, _ = tools
  marked = contrasts._marked("a person walks {x}.", "at a *slow* pace")
  assert marked.text == "a person walks at a slow pace." and [marked.text[a:b] for a, b in marked.spans] == ["slow"]
  marked = contrasts._marked("a person {x}", "stands still")
  assert [marked.text[a:b] for a, b in marked.spans] == ["stands", "still"]


def test_no_held_out_word_is_trained_on(tools):
  contrasts, movement = tools
  said = [marked.text for _, *both, _ in contrasts.pairs(3000) for marked in both]
  said += contrasts.event_sentences(300) + contrasts.composed(300)
  assert not [text for text in said if movement.is_held_out(re.sub(r"[^\w ]", "", text))]


def test_drawn_sentences_are_seeded_and_of_their_kinds(tools):
  contrasts, _ = tools
  events = contrasts.event_sentences(300, seed=2)
  assert events == contrasts.event_sentences(300, seed=2) and len(set(events)) == 300
  for words in ("kicks", "waves", "turns", "degrees", "stands still", "zigzag", "both hands", "slowly", "quickly"):
    assert any(words in text for text in events), words
  together = contrasts.composed(200, seed=2)
  assert len(set(together)) == 200 and max(len(text.split()) for text in together) < 26
  assert sum(" then " in text for text in together) > 40
