"""Verbs that a model does not know mean those that it knows: by the text encoder, and by WordNet for other words."""
import types

import pytest

from motion_jax.text.encoder import load_text_encoder
from motion_jax_studio.language import parse
from motion_jax_studio.language.meaning import Meanings, is_a, kind_of
from tests.studio.sentences import table

CAPTIONS = 20 * ["a person walks backward", "a person runs", "someone turns left", "a person raises both hands"]
NO_WORDS = types.SimpleNamespace(known_words=frozenset())  # an encoder that knows no word


@pytest.fixture(scope="module")
def meanings():
  return Meanings(CAPTIONS, load_text_encoder("words"))


def test_a_verb_means_a_known_one_with_its_manner_or_stays_as_it_is(meanings):
  plans = {sentence: parse(sentence, lambda text: False, meanings) for sentence, _ in table("meanings")}
  assert {text: "" if plan.is_plain else plan.summary for text, plan in plans.items()} == dict(table("meanings"))
  assert all(plan.text == sentence for sentence, plan in plans.items())


def test_known_actions_follow_from_the_captions():
  few = Meanings(CAPTIONS, NO_WORDS)
  assert few.of("hop") is None and few.of("amble").verb == "walk"
  more = Meanings([*CAPTIONS, *20 * ["a person ambles"], *20 * ["someone jumps lightly"]], NO_WORDS)
  assert more.of("amble") is None and more.of("hop") == ("jump", ("lightly",), pytest.approx(0.9))
  assert Meanings([], NO_WORDS).of("amble") is None


def test_the_requirements_are_those_of_the_meaning(meanings):
  kinds = lambda text: [(one.kind, one.side) for one in parse(text, lambda text: False, meanings).requirements]
  assert kinds("a person retreats") == [("walk", "backward")]
  assert kinds("a person pivots to the left") == [("stays", ""), ("turn", "left")]
  assert ("slowly", "walk") in kinds("a person ambles")


def test_kinds_of_walking_and_running():
  kinds = dict(stroll="walk", sprint="run", walk="walk", wander="walk", lope="run", swing="", wave="")
  for verb, kind in kinds.items():
    target = kind_of(verb, "walk", "run")
    assert (target.verb if target else "") == kind and is_a(verb, "walk", "run") == bool(kind), verb
