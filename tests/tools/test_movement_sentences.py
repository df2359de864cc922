"""The grammar behind the shipped text encoder: forms, synonym labels, and words that it must never say."""
import importlib.util
import pathlib
import re

import pytest

PATH = pathlib.Path(__file__).parents[2] / "tools" / "movement_sentences.py"
spec = importlib.util.spec_from_file_location("movement_sentences", PATH)
grammar_file = importlib.util.module_from_spec(spec)
spec.loader.exec_module(grammar_file)


@pytest.mark.parametrize("base, third, gerund", [
    ("take a seat", "takes a seat", "taking a seat"), ("jog", "jogs", "jogging"), ("punch", "punches", "punching"),
    ("carry", "carries", "carrying"), ("do a dance", "does a dance", "doing a dance"), ("box", "boxes", "boxing"),
    ("lie down", "lies down", "lying down"), ("tiptoe", "tiptoes", "tiptoeing")])
def test_inflection(base, third, gerund):
  assert grammar_file.inflect(base) == (base, third, gerund)


def test_the_longest_phrase_names_the_movement():
  text = "A person takes a seat, then turns left and swings a fist"
  found = [(text[a:b], concept) for a, b, concept in grammar_file.Grammar().spans(text)]
  assert found == [("takes a seat", "sit"), ("turns", "turn"), ("left", "left"), ("swings a fist", "punch")]


def test_sentences_are_seeded_and_say_no_held_out_word():
  grammar = grammar_file.Grammar()
  sentences = grammar.sentences(500, seed=3)
  assert sentences == grammar_file.Grammar().sentences(500, seed=3) and len(set(sentences)) == 500
  stems = "|".join(word.rstrip("e") for word in grammar_file.HELD_OUT_WORDS if word not in ("bound", "furious"))
  assert not re.search(rf"\b({stems})", " ".join(sentences + grammar.minimal()).replace("haughtily", ""))
  assert any("amble" in sentence for sentence in grammar_file.unseen_sentences())
