"""Verbs that a model does not know mean those that it knows: by the text encoder, and by WordNet for other words."""
import types

import pytest

from motion_jax.text.encoder import load_text_encoder
from motion_studio.language import parse
from motion_studio.language.clause import clause_of
from motion_studio.language.meaning import Meaning, Meanings, is_a, kind_of, pace_of, translated

CAPTIONS = 20 * ["a person walks backward", "a person runs", "someone turns left", "a person raises both hands"]
NO_WORDS = types.SimpleNamespace(known_words=frozenset())  # an encoder that knows no word


@pytest.fixture(scope="module")
def meanings():
  return Meanings(CAPTIONS, load_text_encoder("words"))


@pytest.mark.parametrize("sentence, parsed", {
    # WordNet: with a pace, with a direction, of the same synset
    "a man ambles along": "walks along slowly", "she retreats": "walks backward", "he advances to the door":
    "walks forward to the door", "a person scampers away": "runs away quickly", "a person swivels to the left":
    "turns to the left", "a person hoists both hands": "raises both hands",
    # the encoder, and the manner by WordNet
    "a person scampers on happily": "runs quickly on happily", "a person saunters ahead": "walks ahead slowly",
    "somebody bolts": "runs", "a person pivots right": "turns right",
    "a person sidesteps to the left": "walks sideways to the left",
    # a pace or a way that is given stays
    "a person ambles quickly": "walks quickly", "he retreats sideways": "walks sideways",
    # in sequence, in the participle, and once more
    "a person ambles forward, then pivots": "walks forward slowly | turns",
    "a person ambles, pivots and flees": "walks slowly | turns | runs quickly",
    "a person hurries ahead": "walks ahead quickly", "a person goes for a leisurely stroll": "walks slowly"}.items())
def test_a_verb_means_a_known_one_with_its_manner(meanings, sentence, parsed):
  assert parse(sentence, lambda text: False, meanings).summary == parsed


@pytest.mark.parametrize("sentence", [
    # a look that "walks" does not describe; a verb whose nearest ones no caption has; a known one; no verb
    "a person tiptoes forward", "a person trudges on", "a person limps", "a person totters", "a person kneels",
    "a person claps", "a person rotates the wrists",
    "a person walks", "the cat on the mat"])
def test_below_confidence_the_words_stay_as_they_are(meanings, sentence):
  plan = parse(sentence, lambda text: False, meanings)
  assert plan.is_plain and plan.text == sentence


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


def test_the_manner_follows_the_object():
  pats = types.SimpleNamespace(of=lambda verb: Meaning("strike", ("lightly",), 0.9))
  assert translated(clause_of("pats it with the hand".split()), pats).words == "it lightly with the hand".split()
  ambles = types.SimpleNamespace(of=lambda verb: Meaning("walk", ("slowly",), 0.9))
  assert translated(clause_of("ambles forward to her".split()), ambles).words == "forward slowly to her".split()


@pytest.mark.parametrize("verb, kind", [("stroll", "walk"), ("sprint", "run"), ("walk", "walk"), ("wander", "walk"),
                                        ("lope", "run"), ("swing", ""), ("wave", "")])
def test_kinds_of_walking_and_running(verb, kind):
  found = kind_of(verb, "walk", "run")
  assert (found.verb if found else "") == kind and is_a(verb, "walk", "run") == bool(kind)


def test_words_of_pace():
  assert [pace_of(word) for word in ("leisurely", "brisk", "hastily", "lazily", "happily")] == [
      "slowly", "quickly", "quickly", "", ""]


@pytest.mark.parametrize("sentence, parsed", {
    "a person walks forward and turns left": None, "a person walks forward then makes a left turn on the way": None,
    "a person runs, then turns to the right": None, "a person walks, turns slightly to his left": None,
    "a person walks, turns left and waves": "walks and turns left | waves",
    "a person walks forward, turns left, and walks on": "walks forward | turns left | walks on",
    "a person walks forward for 3 s, then turns left": "walks forward [3] | turns left",
    "a person walks backward, then turns left": "walks backward | turns left",
    "a person walks, then turns around": "walks | turns around",
    "a person walks, stops, then turns left": "walks | stands still | turns left"}.items())
def test_a_turn_on_the_way_is_part_of_the_walk_for_a_model(sentence, parsed):
  plan = parse(sentence, lambda text: False)
  assert (None if plan.is_plain else plan.summary) == parsed
  assert any(one.kind == "turn" for one in plan.requirements)
